"""What commands and disturbances do in a run's tail, and at which values they are held when a suspect is looked at closely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from barbalat.protocols import Signal
from barbalat.signals.smooth import Clock
from barbalat.validate import Array

INSTANTS = 2**14
"""Of the tail, at which the signals are looked at."""


@dataclass(frozen=True, eq=False)
class Held:
    """The signals of a run's tail.

    values  (k,) of each signal where its magnitude is the largest there, with the sign; NaN for the time itself, which goes on
    turns   how often they jump, begin to move or turn back
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
    steps = np.sign(np.diff(values))
    moving = steps[steps != 0]
    return int((moving[1:] != moving[:-1]).sum()) + int(((steps[1:] != 0) & (steps[:-1] == 0)).sum())
