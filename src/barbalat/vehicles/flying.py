"""``fly`` flies controllers through failures on one vehicle, each controller in a separate process."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import metadata
from typing import Any, TypeAlias

from barbalat.budget import Progress
from barbalat.linear.largest import largest_whole
from barbalat.protocols import Controller
from barbalat.run.kernel.sampled_controller import Maker, SampledList
from barbalat.validate import InputError, show
from barbalat.vehicles.comparison import FlightComparison
from barbalat.vehicles.flight import Failing, Flight, Timing
from barbalat.vehicles.isolated import SECONDS_PER_FLIGHT, STARTING_SECONDS, SimulatorFailed, isolated
from barbalat.vehicles.schemes import Loop, OnLoop, available, require_offered
from barbalat.vehicles.vehicle import Aboard, Vehicle, vehicle_of

AnyVehicle: TypeAlias = Vehicle[Any, Any, Any]


def fly(
    name: str = "f16-pitch",
    *,
    schemes: Sequence[str] | None = None,
    controllers: Sequence[Controller] = (),
    failures: Sequence[str] | None = None,
    condition: Any = None,
    equipment: Any = None,
    delays: bool = False,
    software_in_the_loop: Maker | None = None,
    progress: Progress | None = None,
) -> FlightComparison:
    """Fly controllers on a flight model, each through every failure. This requires ``barbalat[flight]``, which contains JSBSim
    and MuJoCo.

    name         "f16-pitch": JSBSim's F-16 tracks a pitch-rate command; "f16-roll": a roll-rate command; "quadrotor": a figure
                 of eight in MuJoCo, flown by a geometric controller with the additions of the schemes; or another installed
                 vehicle
    schemes      names from ``vehicles.registry.vehicles()[name].schemes``; all by default, including "hinf" if the extra
                 ``robust`` is installed
    controllers  further sampled controllers of your own, which are bound to the ``adaptive_problem`` of the F-16's axis or of the
                 quadrotor's roll, pitch and yaw axes
    failures     names from ``vehicles.registry.vehicles()[name].failures``; all by default
    condition    a ``FlightCondition`` at which the F-16's level flight is trimmed; 10013 ft, Mach 0.525 by default
    equipment    an ``Equipment``, the hardware between controller and surface of the F-16; by default that of the axis
    delays       whether to increase the delay until control is lost, which takes about ten more flights per controller
    software_in_the_loop  ``exported_c`` also flies the exported C of each controller, compiled by this machine's compiler, and
                          compares its u and state with those of the simulated controller bit for bit. By default, only the
                          simulated controller flies

    Raises InputError for anything that cannot be flown, and SimulatorFailed if the simulator fails before any flight.
    """
    vehicle, maker = vehicle_of(name), software_in_the_loop
    if maker is not None and not callable(maker):
        raise InputError(f"software_in_the_loop must be exported_c, got {show(maker)}")
    wanted, chosen = chosen_schemes(vehicle, schemes), chosen_failures(vehicle, failures)
    vehicle.require(condition, equipment)
    model = vehicle.nominal(condition, equipment)
    lists = aboard(vehicle, model, wanted, controllers)
    flying = lists if maker is None else aboard(vehicle, model, wanted, controllers, maker)
    flights, tolerated = [], {}
    for i, (one, flies) in enumerate(zip(lists, flying, strict=True)):
        flights.append(tuple(_flown(vehicle, model, flies, chosen)))
        if delays:
            tolerated[one.name] = isolated(STARTING_SECONDS + 20 * SECONDS_PER_FLIGHT, tolerated_delay, vehicle, model, one)
        if progress is not None:
            progress((i + 1) / len(lists))
    return FlightComparison(
        vehicle=vehicle,
        model=model,
        version=metadata.version(vehicle.simulator),
        failures=chosen,
        flights=tuple(flights),
        delays=tolerated if delays else None,
        exported=maker is not None,
    )


def chosen_schemes(vehicle: AnyVehicle, names: Sequence[str] | None) -> list[str]:
    """Return each scheme once, by default all that can be designed on this machine. Raises InputError for a scheme that the
    vehicle does not offer."""
    wanted = list(dict.fromkeys(available(vehicle.schemes) if names is None else names))
    require_offered(wanted, vehicle.schemes)
    return wanted


def chosen_failures(vehicle: AnyVehicle, names: Sequence[str] | None) -> tuple[Failing, ...]:
    """Return the failures, by default all. Raises InputError for a failure that the vehicle does not have."""
    known = {one.name: one for one in vehicle.failures}
    unknown = [one for one in names or () if one not in known]
    if unknown:
        raise InputError(f"--failure must be one of {', '.join(known)}, got {show(unknown[0])}")
    return tuple(known[one] for one in dict.fromkeys(names or known))


def on_loop(vehicle: AnyVehicle, loop: Loop, scheme: str) -> OnLoop:
    """Return a scheme with the parameters that were found for a loop."""
    return vehicle.schemes[scheme].make(loop, vehicle.numbers[loop.like][scheme])


def aboard(
    vehicle: AnyVehicle,
    model: Any,
    schemes: Sequence[str],
    controllers: Sequence[Controller] = (),
    maker: Maker = SampledList.of,
) -> list[Aboard]:
    """Return the controllers to be flown: first the schemes, then your own. Raises InputError for a controller that does not fit
    the vehicle's computer."""
    found = [
        *(scheme_aboard(vehicle, model, name, maker) for name in schemes),
        *(_own(vehicle, model, one, maker) for one in controllers),
    ]
    names = [one.name for one in found]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f"controllers must have different names, got {show(twice[0])} twice")
    return found


def scheme_aboard(vehicle: AnyVehicle, model: Any, name: str, maker: Maker = SampledList.of) -> Aboard:
    """Return a scheme on all loops of a vehicle."""
    several = [on_loop(vehicle, loop, name) for loop in vehicle.loops(model)]
    return Aboard(name=several[0].controller.name, loops=tuple(maker(*one) for one in several))


def _own(vehicle: AnyVehicle, model: Any, controller: Controller, maker: Maker) -> Aboard:
    """Return a user's controller on its loops. The other loops use the vehicle's plain feedback."""
    loops = list(vehicle.loops(model))[: vehicle.own_loops]
    own = tuple(maker(loop.adaptive_problem, controller) for loop in loops)
    for loop, one in zip(loops, own, strict=True):
        if one.sample_time != loop.sample_time:
            raise InputError(
                f"{one.name} must have the sample time of this flight computer, {loop.sample_time:g} s, got {one.sample_time:g}"
            )
    rest = () if vehicle.own_loops is None else scheme_aboard(vehicle, model, vehicle.own_rest, maker).loops[vehicle.own_loops :]
    return Aboard(name=controller.name, loops=own + rest)


def flown(
    vehicle: AnyVehicle, model: Any, one: Aboard, failures: Sequence[Failing], timing: Timing | None = None
) -> list[Flight]:
    """Fly one controller through the failures in this process, for the default duration of the vehicle's flights."""
    return list(vehicle.fly(model, vehicle.pilot(model, one), failures, vehicle.dispersion(), timing or vehicle.timing))


def _flown(vehicle: AnyVehicle, model: Any, one: Aboard, failures: Sequence[Failing]) -> list[Flight]:
    """Fly all flights in one process. If it fails, fly each flight in a separate process, so that only the failing flight is
    lost."""
    try:
        return isolated(STARTING_SECONDS + SECONDS_PER_FLIGHT * len(failures), flown, vehicle, model, one, failures)
    except SimulatorFailed as error:
        if len(failures) == 1:
            return [vehicle.broken(one.name, failures[0], str(error))]
        return [flight for failure in failures for flight in _flown(vehicle, model, one, [failure])]


def tolerated_delay(vehicle: AnyVehicle, model: Any, one: Aboard, timing: Timing | None = None) -> float:
    """Return the largest added delay [s] with which control is kept to the end, found by trials upwards and then by bisection.

    The result is at least one stride of the vehicle's ``DelaySearch`` below a delay with which control was lost, or 0.0. If
    control was never lost, it is the longest delay tried.
    """
    pilot, search = vehicle.pilot(model, one), vehicle.delays

    def kept(steps: int) -> bool:
        (found,) = vehicle.fly(
            model, pilot, [vehicle.delayed(steps * search.step)], vehicle.dispersion(), timing or vehicle.timing
        )
        return not found.lost

    return largest_whole(kept, stride=search.stride, most=search.most) * search.step
