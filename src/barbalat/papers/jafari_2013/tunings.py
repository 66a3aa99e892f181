"""The tunings of two sides, drawn by one rule, and their comparison."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from barbalat.validate import Array

SEED = 20130821  # an arbitrary fixed number, so the draws are the same on every machine


@dataclass(frozen=True, eq=False)
class Side:
    """One scheme's tunings with their descriptions and objectives (K, objectives). Less is better, so delays are negative."""

    name: str
    tunings: tuple[str, ...]
    reached: Array

    def unbeaten(self, other: Side, objectives: Sequence[int]) -> Array:
        """Return the indices of the tunings that no tuning of the other side beats."""
        mine, theirs = self.reached[:, None, objectives], other.reached[None, :, objectives]
        beaten = ((theirs <= mine).all(axis=2) & (theirs < mine).any(axis=2)).any(axis=1)
        return np.flatnonzero(~beaten & np.isfinite(self.reached[:, 0]))

    def ahead(self, other: Side, objectives: Sequence[int]) -> list[int]:
        """Return the objectives in which this side's best tuning is better than the other side's."""
        return [i for i in objectives if self.reached[:, i].min() < other.reached[:, i].min()]

    def first(self, count: int) -> Side:
        """Return the side with its first tunings only. Half of the points of a Sobol sequence are evenly distributed too."""
        return Side(self.name, self.tunings[:count], self.reached[:count])


def drawn(knobs: Mapping[str, tuple[float, float]], count: int) -> Array:
    """Return (count, knobs) points of Sobol's sequence in the logarithms of the settings."""
    from scipy.stats.qmc import Sobol

    low, high = np.log(np.array(list(knobs.values()))).T
    unit = Sobol(len(knobs), seed=SEED).random(count)
    return np.asarray(np.exp(low + unit * (high - low)))


def ranges(knobs: Mapping[str, tuple[float, float]]) -> str:
    """Return the ranges in words."""
    return ", ".join(f"{name} {low:g} to {high:g}" for name, (low, high) in knobs.items())
