"""A scheme's knobs: the settings that a trade-off turns, and how far for a case. A scheme that has some says so itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Protocol, runtime_checkable

import numpy as np

from barbalat.protocols import Controller
from barbalat.validate import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Knobs:
    """A scheme and the settings that are varied, all combinations of them; ``make`` builds the controller."""

    scheme: str
    values: dict[str, Array]
    make: Callable[..., Controller]

    def tunings(self) -> Iterator[dict[str, float]]:
        for combination in product(*self.values.values()):
            yield dict(zip(self.values, map(float, combination), strict=True))


@dataclass(frozen=True, eq=False, kw_only=True)
class Reach:
    """How far knobs are turned for a case.

    highest_gain  that the step resolves
    times         time constants [s], from five steps to the model's slowest
    density       values of a knob beside another one
    """

    highest_gain: float
    times: Array
    density: int

    def gains(self, lowest: float, count: int) -> Array:
        """``count`` gains from ``lowest`` times the highest up to that."""
        return self.highest_gain * np.geomspace(lowest, 1.0, count)


@runtime_checkable
class Tunable(Protocol):
    """A scheme's class that says which of its settings trade tracking for robustness; others enter trade-offs by hand only."""

    def knobs(self, reach: Reach) -> Knobs:
        """Its settings that are varied, and how far."""
        ...
