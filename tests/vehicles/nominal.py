"""Schemes and controllers on the nominal vehicles, for flights in the tests' own process."""

from barbalat.run.kernel.sampled_controller import SampledList
from barbalat.vehicles import flying
from barbalat.vehicles.vehicle import Aboard, vehicle_of

QUADROTOR = vehicle_of("quadrotor")


def of_axis(axis, name):
    """A scheme on an axis of the F-16: its problem and its controller."""
    return flying.on_loop(vehicle_of(axis.like), axis, name)


def alone(flyable):
    """The controllers that fly an axis of the F-16."""
    return Aboard(name=flyable.name, loops=(flyable,))


def scheme_on(axes, name, maker=SampledList.of):
    """A scheme on all of the quadrotor's axes."""
    return flying.scheme_aboard(QUADROTOR, axes, name, maker)


def on_axis(name, axis):
    """A scheme on one of the quadrotor's axes."""
    return flying.on_loop(QUADROTOR, axis, name)


def through_failures(axis, flyable, failures):
    """Flights through failures along an axis of the F-16."""
    return flying.flown(vehicle_of(axis.like), axis, alone(flyable), failures)


def quadrotor_through(axes, aboard, failures, timing=None):
    """The quadrotor's flights through failures."""
    return flying.flown(QUADROTOR, axes, aboard, failures, timing)
