"""What can fly: a controller from sample to sample, whatever computes it; and how it agrees with the list that is simulated."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.validate import Array


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """How what flew agrees with the simulated list, which was handed the same measurements beside it, sample by sample.

    flights     of which this is known; where a simulator breaks, nothing is
    samples     that were compared
    refused     of them, those that the exported C did not take for what it is made for, and held its last control at
    difference  the first number that is not equal in every bit, in a phrase; empty where all of u and of the state is
    """

    flights: int = 1
    samples: int = 0
    refused: int = 0
    difference: str = ""

    @property
    def equal(self) -> bool | None:
        """None where nothing was compared."""
        return not self.difference if self.samples else None

    @classmethod
    def together(cls, several: Iterable[Agreement | None], *, flights: int | None = None) -> Agreement:
        """Of several flights, of which some may have told nothing; or of several parts that made so many flights."""
        told = [one for one in several if one is not None]
        return cls(
            flights=sum(one.flights for one in told) if flights is None else flights,
            samples=sum(one.samples for one in told),
            refused=sum(one.refused for one in told),
            difference=next((one.difference for one in told if one.difference), ""),
        )


class Step(Protocol):
    """A controller in the process in which it flies. Not for several threads."""

    @property
    def name(self) -> str: ...

    def reset(self) -> None:
        """Back to before the first sample."""

    def __call__(self, y: Array, r: Array | float) -> Array:
        """u, (m,), at the next sample, of what is measured and of the command."""

    def agreement(self) -> Agreement | None:
        """Of the samples since it was last asked for; None where it is the simulated list itself that flies."""


@runtime_checkable
class Resumable(Step, Protocol):
    """A step that goes on from wherever it is put: ``state``, (S,), is all that the next sample follows from."""

    state: Array


class Flyable(Protocol):
    """A controller on its way to the process in which it flies: what can be pickled."""

    @property
    def name(self) -> str: ...

    @property
    def sample_time(self) -> float: ...

    def step(self) -> Step:
        """It, made ready there."""


Maker = Callable[[TrackingProblem, Controller], Flyable]
"""What makes something that flies of a controller: ``SampledList.of``, or ``export.exported_c`` for software in the loop."""
