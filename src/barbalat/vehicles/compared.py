"""Flights of some controllers through some failures, side by side: what all vehicles share, and what each says of its own."""

from __future__ import annotations

import textwrap
from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

from barbalat.run.stepwise import Agreement
from barbalat.validate import Array, InputError, show
from barbalat.vehicles.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HELD_BLANK = "\0"
"""In the place of a blank at which no line ends."""
NO_NUMBER = "its controller gave a command that is no number"
"""Why control was lost, where a flight's controller overflowed and its simulator did not."""


class Failing(Protocol):
    """What fails in a flight, by its name."""

    @property
    def name(self) -> str: ...

    @property
    def meaning(self) -> str: ...


class Flown(Protocol):
    """One flight: a row of its record for each sample, and why control was lost, empty where it was not."""

    @property
    def controller(self) -> str: ...

    @property
    def failure(self) -> Failing: ...

    @property
    def record(self) -> Array: ...

    @property
    def lost(self) -> str: ...

    @property
    def duration(self) -> float: ...

    @property
    def rms_error(self) -> float: ...

    @property
    def figures(self) -> dict[str, float | None]: ...

    @property
    def agreement(self) -> Agreement | None: ...


class Compared(ABC):
    """All flights of some controllers through some failures.

    flights   for each controller those through all failures, in their order
    delays    the largest added delay that each kept control with [s], by name; None where nobody asked
    exported  whether what flew was the exported C
    """

    name: str
    failures: tuple[Failing, ...]
    flights: tuple[tuple[Flown, ...], ...]
    delays: dict[str, float] | None
    exported: bool

    @property
    @abstractmethod
    def headline(self) -> str:
        """Of what is printed: what flies, and which error is ranked."""

    @property
    @abstractmethod
    def columns(self) -> dict[str, str]:
        """What a record holds, in this order, with its units."""

    @property
    @abstractmethod
    def units(self) -> dict[str, str]:
        """The figures of a flight, with their units."""

    @property
    @abstractmethod
    def headings(self) -> tuple[str, ...]:
        """Of a table of figures, after the controller's name."""

    @abstractmethod
    def cells(self, figures: dict[str, float | None]) -> list[str]:
        """A row of that table, of a flight that kept control."""

    @property
    @abstractmethod
    def notes(self) -> tuple[str, ...]:
        """What a reader of the tables has to know."""

    @abstractmethod
    def facts(self) -> list[tuple[str, str]]:
        """Where it flies, what its linear model is, how it is computed."""

    @abstractmethod
    def details(self) -> dict[str, Any]:
        """The same for the document of ``--json``."""

    @property
    @abstractmethod
    def longest_delay(self) -> float:
        """The largest that is tried [s]."""

    @abstractmethod
    def figure(self, failure: Failing, *, narrow: bool = False, shown: bool = False) -> Figure:
        """Time histories of all controllers through a failure; what lost ones do stands as far as the others' ranges reach."""

    @property
    @abstractmethod
    def shown(self) -> str:
        """What these are of, in words."""

    @abstractmethod
    def scene(self, failure: Failing, controllers: Sequence[str]) -> Scene | None:
        """The flights of these controllers through a failure in space; None where the record has no path."""

    @property
    def controllers(self) -> tuple[str, ...]:
        """The names of the controllers, in the order of the flights."""
        return tuple(several[0].controller for several in self.flights)

    @cached_property
    def agreements(self) -> dict[str, Agreement] | None:
        """Of each controller's exported C with the simulated list, over all its flights; None where the list itself flew."""
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
        """Time histories of all controllers through one failure, by its name; the last one by default."""
        return self.figure(self.failure_of(failure), shown=True)

    def plot_paths(self, failure: str | None = None) -> Figure:
        """Where all controllers flew through one failure, in space; InputError where the records have no path."""
        from barbalat.vehicles.path_picture import figure_of

        return figure_of(self._scene(self.failure_of(failure), self.controllers), shown=True)

    def film(self, failure: str | None = None) -> bytes:
        """A GIF of the first controller beside the best of the others; by default through the failure that parts them most."""
        from barbalat.vehicles.film import film

        chosen = self.most_telling if failure is None else self.failure_of(failure)
        return film(self._scene(chosen, self.pair(chosen)))

    def _scene(self, failure: Failing, controllers: Sequence[str]) -> Scene:
        found = self.scene(failure, controllers)
        if found is None:
            raise InputError(f"{self.name} has no path through {failure.name}: there is nothing to be drawn in space")
        return found

    def failure_of(self, name: str | None) -> Failing:
        """The failure of a name, the last one for None; InputError for one that was not flown."""
        found = [one for one in self.failures if name in (None, one.name)]
        if not found:
            raise InputError(
                f"failure must be one that was flown, {', '.join(one.name for one in self.failures)}, got {show(name)}"
            )
        return found[-1]

    def all_through(self, failure: Failing) -> Sequence[Flown]:
        """The flights of all controllers through one failure, in the controllers' order."""
        return [flight for several in self.flights for flight in several if flight.failure == failure]

    def through(self, failure: Failing) -> Sequence[Flown]:
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

    def pair(self, failure: Failing) -> list[str]:
        """The first controller, and the best of the others through the failure: what a film shows side by side."""
        first = self.controllers[0]
        return [first, *[one.controller for one in self.through(failure) if one.controller != first][:1]]

    @property
    def most_telling(self) -> Failing:
        """The failure through which these two differ most: one that the first lost and the other kept, or the largest ratio."""

        def told(failure: Failing) -> tuple[bool, float]:
            several = {one.controller: one for one in self.through(failure)}
            first, best = (several[name] for name in (self.pair(failure) * 2)[:2])
            lost = bool(first.lost) and not best.lost
            return lost, 0.0 if first.lost or best.lost or not best.rms_error else first.rms_error / best.rms_error

        return max(self.failures, key=told)
