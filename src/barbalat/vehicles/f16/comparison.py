"""Controllers through failures on JSBSim's F-16: how they are flown, each in a process of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib import metadata

import numpy as np

from barbalat.protocols import Controller
from barbalat.run.sampled_step import SampledList
from barbalat.run.stepwise import Flyable, Maker
from barbalat.validate import InputError, require_extra, show
from barbalat.vehicles.f16.airframe import FlightCondition
from barbalat.vehicles.f16.axis import AXES, SAMPLE_TIME, Axis
from barbalat.vehicles.f16.equipment import Equipment
from barbalat.vehicles.f16.f16_comparison import FlightComparison
from barbalat.vehicles.f16.failures import FAILURES, Failure
from barbalat.vehicles.f16.flight import Flight, columns_of
from barbalat.vehicles.f16.flying import delay_borne, flown
from barbalat.vehicles.f16.schemes import Flying, available, flying, require_known
from barbalat.vehicles.f16.trim import trimmed
from barbalat.vehicles.isolated import SECONDS_PER_FLIGHT, STARTING_SECONDS, SimulatorFailed, isolated
from barbalat.vehicles.request import Request


def fly(request: Request) -> FlightComparison:
    """On one axis of the F-16; arguments as ``registry.fly`` says."""
    wanted = available() if request.schemes is None else list(request.schemes)
    chosen = chosen_failures(request.name, request.failures)
    require_known(wanted)
    axis = axis_of(request.name, request.condition or FlightCondition(), request.equipment)
    lists, maker = lists_of(axis, wanted, request.controllers), request.software_in_the_loop
    flyables: Sequence[Flyable] = lists if maker is None else _made(axis, wanted, request.controllers, maker)
    flights, borne = [], {}
    for i, (contents, flyable) in enumerate(zip(lists, flyables, strict=True)):
        flights.append(tuple(_flown(axis, flyable, chosen)))
        if request.delays:
            borne[contents.name] = isolated(STARTING_SECONDS + 20 * SECONDS_PER_FLIGHT, delay_borne, axis, contents)
        if request.progress is not None:
            request.progress((i + 1) / len(lists))
    return FlightComparison(
        name=request.name,
        axis=axis,
        failures=chosen,
        jsbsim=metadata.version("jsbsim"),
        flights=tuple(flights),
        delays=borne if request.delays else None,
        exported=maker is not None,
    )


def _flown(axis: Axis, contents: Flyable, failures: Sequence[Failure]) -> list[Flight]:
    """All in one process; where that breaks, each in its own, so that only what breaks is lost."""
    try:
        return isolated(STARTING_SECONDS + SECONDS_PER_FLIGHT * len(failures), flown, axis, contents, failures)
    except SimulatorFailed as error:
        if len(failures) == 1:
            record = np.zeros((1, len(columns_of(axis.followed))))
            flight = Flight(controller=contents.name, failure=failures[0], followed=axis.followed, record=record, lost=str(error))
            return [flight]
        return [flight for failure in failures for flight in _flown(axis, contents, [failure])]


def chosen_failures(name: str, failures: Sequence[str] | None) -> tuple[Failure, ...]:
    """Of a flight, all by default; InputError for what is none."""
    if name not in FAILURES:
        raise InputError(f"NAME must be a flight of the F-16, {' or '.join(FAILURES)}, got {show(name)}")
    known = {one.name: one for one in FAILURES[name]}
    unknown = [one for one in failures or () if one not in known]
    if unknown:
        raise InputError(f"--failure must be of {', '.join(known)}, got {show(unknown[0])}")
    return tuple(known[one] for one in dict.fromkeys(failures or known))


def axis_of(name: str, condition: FlightCondition, equipment: Equipment | None = None) -> Axis:
    """Trimmed in a process of its own."""
    require_extra("jsbsim", "flight", "a flight model")
    followed = AXES[name] if equipment is None else replace(AXES[name], equipment=equipment)
    return Axis(trim=isolated(STARTING_SECONDS, trimmed, condition), followed=followed)


def lists_of(axis: Axis, schemes: Sequence[str], controllers: Sequence[Controller] = ()) -> list[SampledList]:
    """The operations of all that fly; InputError for what does not fit the axis."""
    lists = [SampledList.of(*pair) for pair in _pairs(axis, schemes, controllers)]
    _require_fitting(lists)
    return lists


def _made(axis: Axis, schemes: Sequence[str], controllers: Sequence[Controller], maker: Maker) -> list[Flyable]:
    """The same, by another maker."""
    return [maker(*pair) for pair in _pairs(axis, schemes, controllers)]


def _pairs(axis: Axis, schemes: Sequence[str], controllers: Sequence[Controller]) -> list[Flying]:
    return [*flying(axis, schemes), *(Flying(axis.adaptive_problem, one) for one in controllers)]


def _require_fitting(lists: Sequence[SampledList]) -> None:
    names = [one.name for one in lists]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f"controllers must have different names, got {show(twice[0])} twice")
    for one in lists:
        if one.sample_time != SAMPLE_TIME:
            raise InputError(
                f"{one.name} must have sample_time {SAMPLE_TIME:g} s, that of this flight computer, got {one.sample_time:g}"
            )
