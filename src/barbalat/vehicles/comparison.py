"""Flights of several controllers through several failures: metrics, rankings, pictures and films."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from barbalat.run.kernel.sampled_controller import Agreement
from barbalat.validate import InputError, show
from barbalat.vehicles.flight import Failing, Flight
from barbalat.vehicles.scene import Mover, Scene
from barbalat.vehicles.vehicle import Vehicle

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HELD_BLANK = "\0"
"""A placeholder for a non-breaking space."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class FlightComparison:
    """All flights of some controllers through some failures.

    vehicle   the vehicle
    model     the trimmed flight condition with its linear model: an ``Axis`` of the F-16, the ``Axes`` of the quadrotor
    version   the version of its simulator
    flights   for each controller, its flights through all failures, in the order of the failures
    delays    the largest added delay with which each controller kept control [s], keyed by name; None if it was not requested
    exported  whether the exported C was flown
    """

    vehicle: Vehicle[Any, Any, Any]
    model: Any
    version: str
    failures: tuple[Failing, ...]
    flights: tuple[tuple[Flight, ...], ...]
    delays: dict[str, float] | None = None
    exported: bool = False

    @property
    def name(self) -> str:
        return self.vehicle.name

    @property
    def headline(self) -> str:
        """The title: what flew, and the error by which flights are ranked."""
        return self.vehicle.headline(self.model)

    def facts(self) -> list[tuple[str, str]]:
        """Return labelled facts on the flight condition, the linear model and the computation."""
        return self.vehicle.facts(self.model, self.version)

    def details(self) -> dict[str, Any]:
        """Return the flight condition, the linear model and the computation, for the document of ``--json``."""
        return self.vehicle.details(self.model, self.version)

    @property
    def longest_delay(self) -> float:
        """The largest added delay that is tried [s]."""
        return self.vehicle.delays.most * self.vehicle.delays.step

    def figure(self, failure: Failing, *, narrow: bool = False, shown: bool = False) -> Figure:
        """Draw time histories of all controllers through a failure. The histories of lost controllers are drawn within the range
        of the others."""
        from barbalat.vehicles.picture import figure_of

        return figure_of(self.vehicle, self.all_through(failure), narrow=narrow, shown=shown)

    def scene(self, failure: Failing, controllers: Sequence[str]) -> Scene | None:
        """Return the flight paths of these controllers through a failure, in three dimensions; None if none of them left the
        start."""
        chosen = [
            (i, one) for i, one in enumerate(self.all_through(failure)) if one.controller in controllers and len(one.record) > 1
        ]
        if not chosen:
            return None
        longest = max((one for _, one in chosen), key=lambda one: len(one.record))
        movers = [
            Mover(label=one.controller, colour=i, path=one.path, attitude=one.attitude, lost=bool(one.lost)) for i, one in chosen
        ]
        return Scene(
            title=failure.meaning, unit=self.vehicle.length, t=longest.column("t"), target=longest.target, movers=tuple(movers),
            wire=self.vehicle.wire, fails=longest.since, failing=failure.name != "none", equal=self.vehicle.equal_lengths,
        )  # fmt: skip

    @property
    def controllers(self) -> tuple[str, ...]:
        """The names of the controllers, in the order of the flights."""
        return tuple(several[0].controller for several in self.flights)

    @cached_property
    def agreements(self) -> dict[str, Agreement] | None:
        """The agreement of each controller's exported C with the simulation over all its flights; None if no C flew."""
        if not self.exported:
            return None
        return {several[0].controller: Agreement.together(one.agreement for one in several) for several in self.flights}

    def __repr__(self) -> str:
        lines = [self.headline]
        for failure in self.failures:
            found = (
                f"{one.controller} {f'lost at {one.duration:.1f} s' if one.lost else f'{one.rms_error:.2f}'}".replace(
                    " ", HELD_BLANK
                )
                for one in self.through(failure)
            )
            lines += textwrap.wrap(f"{failure.name}: {', '.join(found)}", 100, subsequent_indent="    ")
        return "\n".join(lines).replace(HELD_BLANK, " ")

    def plot(self, failure: str | None = None) -> Figure:
        """Draw time histories of all controllers through one failure, given by its name; the last one by default."""
        return self.figure(self.failure_of(failure), shown=True)

    def plot_paths(self, failure: str | None = None) -> Figure:
        """Draw the flight paths of all controllers for one failure, in three dimensions. Raises InputError if the records have no
        path."""
        from barbalat.vehicles.picture import paths_figure

        return paths_figure(self._scene(self.failure_of(failure), self.controllers), shown=True)

    def film(self, failure: str | None = None) -> bytes:
        """Return a GIF of the first controller and the best of the others. By default, it shows the failure with the largest
        difference between the two."""
        from barbalat.vehicles.film import film

        chosen = self.most_telling if failure is None else self.failure_of(failure)
        return film(self._scene(chosen, self.pair(chosen)))

    def _scene(self, failure: Failing, controllers: Sequence[str]) -> Scene:
        found = self.scene(failure, controllers)
        if found is None:
            raise InputError(
                f"{self.name} has no flight path for the failure {failure.name}, so there is nothing to draw in space"
            )
        return found

    def failure_of(self, name: str | None) -> Failing:
        """Return the failure with this name, or the last one for None. Raises InputError for a failure that was not flown."""
        found = [one for one in self.failures if name in (None, one.name)]
        if not found:
            raise InputError(
                f"failure must be one that was flown, {', '.join(one.name for one in self.failures)}, got {show(name)}"
            )
        return found[-1]

    def all_through(self, failure: Failing) -> Sequence[Flight]:
        """Return the flights of all controllers through one failure, in the controllers' order."""
        return [flight for several in self.flights for flight in several if flight.failure == failure]

    def through(self, failure: Failing) -> Sequence[Flight]:
        """Return the flights of all controllers through one failure, ordered by error. Lost flights come last, with the earliest
        loss at the end."""
        return sorted(
            self.all_through(failure),
            key=lambda flight: (bool(flight.lost), -flight.duration if flight.lost else flight.rms_error),
        )

    @cached_property
    def losses(self) -> dict[str, int]:
        """The number of lost flights of each controller, the best first."""
        counted = {several[0].controller: sum(bool(flight.lost) for flight in several) for several in self.flights}
        return dict(sorted(counted.items(), key=lambda item: item[1]))

    def pair(self, failure: Failing) -> list[str]:
        """Return the first controller and the best of the others through the failure, which a film shows together."""
        first = self.controllers[0]
        return [first, *[one.controller for one in self.through(failure) if one.controller != first][:1]]

    @property
    def most_telling(self) -> Failing:
        """The failure with the largest difference between these two: a failure that the first controller lost and the other
        survived, or the one with the largest ratio of errors."""

        def told(failure: Failing) -> tuple[bool, float]:
            several = {one.controller: one for one in self.through(failure)}
            first, best = (several[name] for name in (self.pair(failure) * 2)[:2])
            lost = bool(first.lost) and not best.lost
            return lost, 0.0 if first.lost or best.lost or not best.rms_error else first.rms_error / best.rms_error

        return max(self.failures, key=told)
