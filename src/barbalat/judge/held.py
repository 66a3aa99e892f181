"""What commands and disturbances do in a run's tail, and at which values they are held when a suspect is looked at closely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from barbalat.protocols import Signal
from barbalat.signals.smooth import Clock
from barbalat.validate import Array

INSTANTS = 2**14
"""Of the tail, at which the signals are looked at."""
RIPPLE = 0.025
"""Of a signal's range in the tail: what moves to and fro by less is no turn of it, and explains no reversal of a control."""


@dataclass(frozen=True, eq=False)
class Held:
    """The signals of a run's tail.

    values  (k,) of each signal where its magnitude is the largest there, with the sign; NaN for the time itself, which goes on
    turns   how often they jump from rest, or turn back
    """

    values: Array
    turns: int

    @classmethod
    def of(cls, signals: Sequence[Signal], begin: float, end: float) -> Held:
        """Held at their largest and not at their last values: a regressor that dies would end any cycle of adaptation."""
        t = np.linspace(begin, end, INSTANTS)
        found, turns = [], 0
        for signal in signals:
            if isinstance(signal, Clock):
                found.append(np.nan)
                continue
            values = np.asarray(signal(t), dtype=float)
            found.append(float(values[np.abs(values).argmax()]))
            turns += _turns(values)
        return cls(np.array(found), turns)


def _turns(values: Array) -> int:
    width = RIPPLE * float(np.ptp(values))
    steps = np.diff(values)
    jumps = (np.abs(steps[1:]) > width) & (steps[:-1] == 0)
    moves = np.sign(np.diff(_without_ripple(values.tolist(), 0.5 * width)))
    moves = moves[moves != 0]
    return int(jumps.sum()) + int((moves[1:] != moves[:-1]).sum())


def _without_ripple(values: list[float], half: float) -> list[float]:
    """What follows the values with so much play on either side."""

    def followed(last: float, value: float) -> float:
        low, high = value - half, value + half
        return low if last < low else min(last, high)

    return list(accumulate(values, followed))
