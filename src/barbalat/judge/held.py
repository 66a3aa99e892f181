"""The commands and disturbances in a run's tail, and the values at which they are held while a suspect is examined."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from barbalat.protocols import Signal
from barbalat.signals.smooth import Clock
from barbalat.validate import Array

INSTANTS = 2**14
"""Number of instants of the tail at which the signals are evaluated."""
RIPPLE = 0.025
"""Fraction of a signal's range in the tail. Smaller movements do not count as turns and do not explain reversals of a control."""


@dataclass(frozen=True, eq=False)
class Held:
    """The signals of a run's tail.

    values  (k,) the value of each signal with the largest magnitude; NaN for the time itself, which continues
    turns   the number of jumps and turns of the signals
    swings  path of the signals between these turns, each as a multiple of its range
    """

    values: Array
    turns: int
    swings: float

    @classmethod
    def of(cls, signals: Sequence[Signal], begin: float, end: float) -> Held:
        """Evaluate the signals between ``begin`` and ``end`` [s].

        The largest values are held, not the last ones, because a vanishing regressor would end any cycle of the adaptation.
        """
        t = np.linspace(begin, end, INSTANTS)
        return cls.along([None if isinstance(one, Clock) else np.asarray(one(t), dtype=float) for one in signals])

    @classmethod
    def along(cls, signals: Iterable[Array | None]) -> Held:
        """Evaluate signals from their values (K,) in the tail. None means the time itself."""
        found, turns, swings = [], 0, 0.0
        for values in signals:
            if values is None:
                found.append(np.nan)
                continue
            found.append(float(values[np.abs(values).argmax()]))
            own_turns, own_swings = _turns(values)
            turns, swings = turns + own_turns, swings + own_swings
        return cls(np.array(found), turns, swings)


def _turns(values: Array) -> tuple[int, float]:
    """Return the number of a signal's jumps and turns, and its path as a multiple of its range."""
    full = float(np.ptp(values))
    width = RIPPLE * full
    steps = np.diff(values)
    jumps = int(((np.abs(steps[1:]) > width) & (steps[:-1] == 0)).sum())
    moving = np.flatnonzero(steps)
    back = moving[1:][np.sign(steps[moving[1:]]) != np.sign(steps[moving[:-1]])]
    extremes = values[[0, *back, len(values) - 1]]  # between two of these instants the signal with backlash is monotonic
    moves = np.diff(_without_ripple(extremes.tolist(), 0.5 * width))
    ways = np.sign(moves[moves != 0])
    turns = int((ways[1:] != ways[:-1]).sum())
    way = float(np.abs(moves).sum()) + width * turns  # the backlash takes its width off each turn
    return jumps + turns, way / full if full > 0 else 0.0


def _without_ripple(values: list[float], half: float) -> list[float]:
    """Return the output of a backlash of this half width that is driven by the values."""

    def followed(last: float, value: float) -> float:
        low, high = value - half, value + half
        return low if last < low else min(last, high)

    return list(accumulate(values, followed))
