"""``fly``: controllers through failures on one vehicle, each in a process of its own."""

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
    """Fly controllers on a flight model, each through every failure; the extra ``flight`` has JSBSim and MuJoCo.

    name         "f16-pitch": JSBSim's F-16 follows a pitch-rate command; "f16-roll": a roll-rate command; "quadrotor": a figure
                 of eight in MuJoCo, by a geometric controller and what schemes add to it; or another vehicle that is installed
    schemes      of ``vehicles.registry.vehicles()[name].schemes``; all by default, "hinf" where the extra ``robust`` is installed
    controllers  sampled ones of one's own beside them, bound to the ``adaptive_problem`` of the F-16's axis, or of the
                 quadrotor's roll, pitch and yaw
    failures     of ``vehicles.registry.vehicles()[name].failures``; all by default
    condition    a ``FlightCondition``, where the F-16's level flight is trimmed; 10013 ft, Mach 0.525 by default
    equipment    an ``Equipment``, what lies between controller and surface of the F-16; the axis's own by default
    delays       whether the delay is raised, too, until control is lost: some ten flights more for each controller
    software_in_the_loop  ``exported_c``: each controller flies as its exported C, compiled by this machine's compiler, beside
                 the simulated list, with which u and state are compared in every bit; by default that list flies alone

    Raises InputError for what can't be flown, SimulatorFailed where the simulator breaks before any flight.
    """
    vehicle, maker = vehicle_of(name), software_in_the_loop
    if maker is not None and not callable(maker):
        raise InputError(f"software_in_the_loop must be what makes a controller fly, exported_c, got {show(maker)}")
    wanted, chosen = chosen_schemes(vehicle, schemes), chosen_failures(vehicle, failures)
    vehicle.require(condition, equipment)
    model = vehicle.nominal(condition, equipment)
    lists = aboard(vehicle, model, wanted, controllers)
    flying = lists if maker is None else aboard(vehicle, model, wanted, controllers, maker)
    flights, borne = [], {}
    for i, (one, flies) in enumerate(zip(lists, flying, strict=True)):
        flights.append(tuple(_flown(vehicle, model, flies, chosen)))
        if delays:
            borne[one.name] = isolated(STARTING_SECONDS + 20 * SECONDS_PER_FLIGHT, delay_borne, vehicle, model, one)
        if progress is not None:
            progress((i + 1) / len(lists))
    return FlightComparison(
        vehicle=vehicle,
        model=model,
        version=metadata.version(vehicle.simulator),
        failures=chosen,
        flights=tuple(flights),
        delays=borne if delays else None,
        exported=maker is not None,
    )


def chosen_schemes(vehicle: AnyVehicle, names: Sequence[str] | None) -> list[str]:
    """Each once, by default all that can be designed here; InputError for what the vehicle does not offer."""
    wanted = list(dict.fromkeys(available(vehicle.schemes) if names is None else names))
    require_offered(wanted, vehicle.schemes)
    return wanted


def chosen_failures(vehicle: AnyVehicle, names: Sequence[str] | None) -> tuple[Failing, ...]:
    """All by default; InputError for what is none of the vehicle's."""
    known = {one.name: one for one in vehicle.failures}
    unknown = [one for one in names or () if one not in known]
    if unknown:
        raise InputError(f"--failure must be of {', '.join(known)}, got {show(unknown[0])}")
    return tuple(known[one] for one in dict.fromkeys(names or known))


def on_loop(vehicle: AnyVehicle, loop: Loop, scheme: str) -> OnLoop:
    """A scheme with the numbers found for a loop."""
    return vehicle.schemes[scheme].make(loop, vehicle.numbers[loop.like][scheme])


def aboard(
    vehicle: AnyVehicle,
    model: Any,
    schemes: Sequence[str],
    controllers: Sequence[Controller] = (),
    maker: Maker = SampledList.of,
) -> list[Aboard]:
    """Schemes, then controllers of one's own, as what flies; InputError for what does not fit the vehicle's computer."""
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
    """A scheme on all loops of a vehicle."""
    several = [on_loop(vehicle, loop, name) for loop in vehicle.loops(model)]
    return Aboard(name=several[0].controller.name, loops=tuple(maker(*one) for one in several))


def _own(vehicle: AnyVehicle, model: Any, controller: Controller, maker: Maker) -> Aboard:
    """Somebody's own on its loops; the others are left to the vehicle's plain feedback."""
    loops = list(vehicle.loops(model))[: vehicle.own_loops]
    own = tuple(maker(loop.adaptive_problem, controller) for loop in loops)
    for loop, one in zip(loops, own, strict=True):
        if one.sample_time != loop.sample_time:
            raise InputError(
                f"{one.name} must have sample_time {loop.sample_time:g} s, that of this flight computer, got {one.sample_time:g}"
            )
    rest = () if vehicle.own_loops is None else scheme_aboard(vehicle, model, vehicle.own_rest, maker).loops[vehicle.own_loops :]
    return Aboard(name=controller.name, loops=own + rest)


def flown(
    vehicle: AnyVehicle, model: Any, one: Aboard, failures: Sequence[Failing], timing: Timing | None = None
) -> list[Flight]:
    """One controller through the failures, in this process; for as long as the vehicle's flights are by default."""
    return list(vehicle.fly(model, vehicle.pilot(model, one), failures, vehicle.dispersion(), timing or vehicle.timing))


def _flown(vehicle: AnyVehicle, model: Any, one: Aboard, failures: Sequence[Failing]) -> list[Flight]:
    """All in one process; where that breaks, each in its own, so that only what breaks is lost."""
    try:
        return isolated(STARTING_SECONDS + SECONDS_PER_FLIGHT * len(failures), flown, vehicle, model, one, failures)
    except SimulatorFailed as error:
        if len(failures) == 1:
            return [vehicle.broken(one.name, failures[0], str(error))]
        return [flight for failure in failures for flight in _flown(vehicle, model, one, [failure])]


def delay_borne(vehicle: AnyVehicle, model: Any, one: Aboard, timing: Timing | None = None) -> float:
    """The largest added delay [s] with which control is kept to the end: by trials upwards, then by bisection.

    A stride of the vehicle's ``DelaySearch`` at least, or 0.0, lies between it and a delay that lost control;
    it is the longest one tried where none did.
    """
    pilot, search = vehicle.pilot(model, one), vehicle.delays

    def kept(steps: int) -> bool:
        (found,) = vehicle.fly(
            model, pilot, [vehicle.delayed(steps * search.step)], vehicle.dispersion(), timing or vehicle.timing
        )
        return not found.lost

    return largest_whole(kept, stride=search.stride, most=search.most) * search.step
