"""The signals of a run at any time, not only on a grid, as formulas in t or as straight lines between breaks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from barbalat.loop.packing import column, symbols
from barbalat.problem.faults import FaultSignal
from barbalat.protocols import BreakingSignal, InterpolatedSignal, Signal, SlopedSignal
from barbalat.signals.smooth import Clock, Constant, Continuous
from barbalat.validate import Array, InputError

if TYPE_CHECKING:
    import casadi as ca


def is_formula(signal: Signal) -> bool:
    """Whether the signal can also be evaluated on CasADi's arrays and does not jump."""
    if not isinstance(signal, Continuous) or isinstance(signal, (InterpolatedSignal, Constant)):
        return False
    _, t = symbols("t", 1)
    try:
        return isinstance(signal(t), type(t))
    except (TypeError, ValueError, RuntimeError):  # code that turns t into a number or branches on it is not a formula
        return False


def is_straight(signal: Signal) -> bool:
    """Whether the signal is linear between its breaks."""
    resting = isinstance(signal, SlopedSignal) and signal.slope == 0
    return isinstance(signal, InterpolatedSignal) or (resting and isinstance(signal, (BreakingSignal, Constant)))


@dataclass(frozen=True, eq=False)
class TimeSignals:
    """The signals of a loop, in order.

    A piece of a run lies between two instants at which a signal breaks; its numbers are described in ``rows``.
    """

    signals: tuple[Signal, ...]

    @classmethod
    def of(cls, signals: tuple[Signal, ...]) -> TimeSignals:
        """Raise InputError for a signal that is known only on a grid."""
        found = cls(signals)
        for signal, formula in zip(signals, found.formulas, strict=True):
            if not (formula is not None or is_straight(signal) or isinstance(signal, FaultSignal)):
                raise InputError.of(
                    "simulation.tolerance",
                    f"needs signals that are known at every instant, but {type(signal).__name__} is a Python function that is "
                    f"evaluated at requested times: give simulation.dt"
                    "",
                )
        return found

    @cached_property
    def formulas(self) -> tuple[Signal | None, ...]:
        """The signals that are formulas of t, and None for the others, which a piece's numbers describe.

        They are determined once, in the thread that starts the run, because CasADi must not be used in several threads at the
        same time.
        """
        return tuple(signal if is_formula(signal) else None for signal in self.signals)

    @property
    def numbers(self) -> int:
        """How many values describe a piece: its beginning, whether the signals are held, and the value and slope of each
        signal."""
        return 2 + 2 * len(self.signals)

    def breaks(self, t_end: float) -> Array:
        """The instants in (0, t_end) at which any of the signals breaks."""
        found = [np.asarray(one.breaks(0.0, t_end), float) for one in self.signals if isinstance(one, BreakingSignal)]
        return np.unique(np.concatenate([np.zeros(0), *found]))

    def rows(self, begins: Array, ends: Array) -> Array:
        """(K, numbers) the rows of pieces that begin and end at these times (K,) [s]. A piece of zero length has the values at
        its beginning."""
        columns = [begins, np.zeros(len(begins))]
        for signal, formula in zip(self.signals, self.formulas, strict=True):
            if formula is not None:
                columns += [np.zeros(len(begins))] * 2
                continue
            first = last = np.asarray(signal(begins), float)
            if not isinstance(signal, FaultSignal):  # the signal is evaluated only at samples, where pieces begin
                last = np.asarray(signal.before(ends), float)
            columns += [first, (last - first) / np.where(ends > begins, ends - begins, 1.0)]
        return np.column_stack(columns)

    def held(self, begins: Array, values: Array) -> Array:
        """(K, numbers) the rows of pieces in which each signal keeps one of ``values``, except a clock, whose value is NaN."""
        numbers = np.ravel([(float(value), 0.0) for value in values])
        return np.column_stack([begins, np.ones(len(begins)), np.tile(numbers, (len(begins), 1))])

    def at(self, t: ca.SX, numbers: ca.SX) -> ca.SX:
        """(signal_count,) the signals at the time t of a piece with these ``numbers``."""
        import casadi as ca

        begins, held, found = numbers[0], numbers[1], []
        for i, (signal, known) in enumerate(zip(self.signals, self.formulas, strict=True)):
            value, slope = numbers[2 + 2 * i], numbers[3 + 2 * i]
            if known is None:
                found.append(value + slope * (t - begins))
                continue
            formula = ca.SX(column(np.reshape(signal(ca.array(t).reshape(-1)), -1)))
            found.append(formula if isinstance(signal, Clock) else ca.if_else(held, value, formula))
        return ca.vertcat(ca.SX(0, 1), *found)
