"""Tunings of two sides that are drawn by one rule, and which of them the other side beats."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from barbalat.validate import Array

SEED = 20130821  # any fixed number: the draws are the same on every machine


@dataclass(frozen=True, eq=False)
class Side:
    """One scheme's tunings, described, and what they reach: (K, objectives), a delay negative; less is better."""

    name: str
    tunings: tuple[str, ...]
    reached: Array

    def unbeaten(self, other: Side, objectives: Sequence[int]) -> Array:
        """The places of the tunings that no tuning of the other side beats."""
        mine, theirs = self.reached[:, None, objectives], other.reached[None, :, objectives]
        beaten = ((theirs <= mine).all(axis=2) & (theirs < mine).any(axis=2)).any(axis=1)
        return np.flatnonzero(~beaten & np.isfinite(self.reached[:, 0]))

    def ahead(self, other: Side, objectives: Sequence[int]) -> list[int]:
        """The objectives of which this side's best is better than the other side's."""
        return [i for i in objectives if self.reached[:, i].min() < other.reached[:, i].min()]

    def first(self, count: int) -> Side:
        """Only its first tunings: half of the points of a Sobol sequence are evenly distributed too."""
        return Side(self.name, self.tunings[:count], self.reached[:count])


def drawn(knobs: Mapping[str, tuple[float, float]], count: int) -> Array:
    """(count, knobs) points of Sobol's sequence, spaced in the logarithms."""
    from scipy.stats.qmc import Sobol

    low, high = np.log(np.array(list(knobs.values()))).T
    unit = Sobol(len(knobs), seed=SEED).random(count)
    return np.asarray(np.exp(low + unit * (high - low)))


def ranges(knobs: Mapping[str, tuple[float, float]]) -> str:
    """The ranges in words."""
    return ", ".join(f"{name} {low:g} to {high:g}" for name, (low, high) in knobs.items())
