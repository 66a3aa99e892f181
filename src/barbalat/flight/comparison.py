"""``fly``: controllers through failures on a flight model, side by side."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import metadata
from typing import TYPE_CHECKING

import numpy as np

from barbalat.flight.airframe import FlightCondition
from barbalat.flight.axis import AXES, SAMPLE_TIME, Axis
from barbalat.flight.equipment import Equipment
from barbalat.flight.failures import FAILURES, Failure
from barbalat.flight.flight import Flight, columns_of, delay_borne, flown
from barbalat.flight.isolated import SimulatorFailed, isolated
from barbalat.flight.sampled_step import SampledList
from barbalat.flight.schemes import Flying, available, flying, require_known
from barbalat.flight.trim import trimmed
from barbalat.protocols import Controller
from barbalat.run.progress import Progress
from barbalat.validate import InputError, require_extra, show

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FLIGHTS = tuple(AXES)
"""What can be flown, by the names of the command line."""
HELD = "\0"
"""In the place of a blank at which no line ends."""
STARTING_SECONDS, SECONDS_PER_FLIGHT = 120.0, 60.0
"""Time limits: JSBSim loads in one second and flies ``DURATION`` in half of one; a shared machine takes many times that."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FlightComparison:
    """All flights of some controllers through some failures.

    jsbsim   its version
    flights  for each controller those through all failures, in their order
    delays   the largest added delay that each kept control with [s], by name; None where nobody asked
    """

    name: str
    axis: Axis
    failures: tuple[Failure, ...]
    jsbsim: str
    flights: tuple[tuple[Flight, ...], ...]
    delays: dict[str, float] | None = None

    @property
    def controllers(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(several[0].controller for several in self.flights)

    def __repr__(self) -> str:
        lines = [f"{self.name} at {self.axis.trim.condition}: RMS error of the followed rate [deg/s] after each failure"]
        for failure in self.failures:
            found = (
                f"{one.controller} {f'lost at {one.duration:.1f} s' if one.lost else f'{one.rms_error:.2f}'}".replace(" ", HELD)
                for one in self.through(failure)
            )
            lines += textwrap.wrap(f"{failure.name}: {', '.join(found)}", 100, subsequent_indent="    ")
        return "\n".join(lines).replace(HELD, " ")

    def plot(self, failure: str | None = None) -> Figure:
        """Time histories of all controllers through one failure, by its name; the last one by default."""
        from barbalat.flight.picture import figure_of

        found = [one for one in self.failures if failure in (None, one.name)]
        if not found:
            raise InputError(
                f"failure must be one that was flown, {', '.join(one.name for one in self.failures)}, got {show(failure)}"
            )
        return figure_of(self.all_through(found[-1]), shown=True)

    def all_through(self, failure: Failure) -> list[Flight]:
        """The flights of all controllers through one failure, in the controllers' order."""
        return [flight for several in self.flights for flight in several if flight.failure == failure]

    def through(self, failure: Failure) -> list[Flight]:
        """The flights of all controllers through one failure: lost ones last, the sooner the later; the others by error."""
        return sorted(
            self.all_through(failure),
            key=lambda flight: (bool(flight.lost), -flight.duration if flight.lost else flight.rms_error),
        )

    @cached_property
    def losses(self) -> dict[str, int]:
        """How many of its flights each controller lost, the best first."""
        counted = {several[0].controller: sum(bool(flight.lost) for flight in several) for several in self.flights}
        return dict(sorted(counted.items(), key=lambda item: item[1]))


def fly(
    name: str = FLIGHTS[0],
    *,
    schemes: Sequence[str] | None = None,
    controllers: Sequence[Controller] = (),
    failures: Sequence[str] | None = None,
    condition: FlightCondition | None = None,
    equipment: Equipment | None = None,
    delays: bool = False,
    progress: Progress | None = None,
) -> FlightComparison:
    """Fly controllers on a flight model, each through every failure; the extra ``flight`` has JSBSim.

    name         "f16-pitch": JSBSim's F-16 follows a pitch-rate command; "f16-roll": a roll-rate command
    schemes      of ``flight.schemes.SCHEMES``; all by default, "hinf" where the extra ``robust`` is installed
    controllers  sampled ones of one's own beside them, bound to ``Axis.adaptive_problem``
    failures     of ``flight.failures.FAILURES[name]``; all by default
    condition    where level flight is trimmed; 10013 ft, Mach 0.525 by default
    equipment    what lies between controller and surface; the axis's own by default
    delays       whether the delay is raised, too, until control is lost: some ten flights more for each controller

    Raises InputError for what can't be flown, SimulatorFailed where the simulator breaks before any flight.
    """
    wanted = available() if schemes is None else list(schemes)
    chosen = chosen_failures(name, failures)
    require_known(wanted)
    axis = axis_of(name, condition or FlightCondition(), equipment)
    lists = lists_of(axis, wanted, controllers)
    flights, borne = [], {}
    for i, contents in enumerate(lists):
        flights.append(tuple(_flown(axis, contents, chosen)))
        if delays:
            borne[contents.name] = isolated(STARTING_SECONDS + 20 * SECONDS_PER_FLIGHT, delay_borne, axis, contents)
        if progress is not None:
            progress((i + 1) / len(lists))
    return FlightComparison(
        name=name,
        axis=axis,
        failures=chosen,
        jsbsim=metadata.version("jsbsim"),
        flights=tuple(flights),
        delays=borne if delays else None,
    )


def _flown(axis: Axis, contents: SampledList, failures: Sequence[Failure]) -> list[Flight]:
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
    if name not in FLIGHTS:
        raise InputError(f"NAME must be {' or '.join(FLIGHTS)}, got {show(name)}")
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
    pairs = [*flying(axis, schemes), *(Flying(axis.adaptive_problem, one) for one in controllers)]
    lists = [SampledList.of(*pair) for pair in pairs]
    _require_fitting(lists)
    return lists


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
