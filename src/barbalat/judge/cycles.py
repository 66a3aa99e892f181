"""Which runs are limit cycles: suspects by the reversals of their controls, then by windows of the run with everything held."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.judge.held import Held
from barbalat.validate import Array

FEWEST_REVERSALS = 2
"""In the tail: a suspect reverses more often, one and a half periods at least."""
TURNS_EXPLAIN = 2
"""Reversals, for each turn of the commands and disturbances; and of a control's way, as a multiple of its range, for theirs."""
LIMITED_SHARE = 0.25
"""Of the tail: a control that is for longer at a limit, or at a limited rate, answers to that and not to the command."""
SLOWEST_PERIODS = 3.0
"""A window of a continuation lasts so many periods of the model's slowest mode, as far as the run is not shorter."""
FEWEST_CYCLES = 4.0
"""And at least so many of the periods that were seen in the tail."""
LONGEST_SHARE = 0.5
"""Of the run, that a window has at most, so that a continuation stays below MOST_WINDOWS halves of it."""
KEPT_SHARE = 0.8
"""What of the swing of one window the next one keeps in a limit cycle."""
STEADY_SHARE = 0.02
"""A swing that changes by less from window to window is decided; what decays or grows faster is looked at for longer."""
LEVELLING_SHARE = 0.5
"""What of a window's change the next one has at most, where a swing is on its way to a limit cycle's."""
FEWEST_WINDOWS = 3
"""The first shows what holding the command does, the other two are compared."""
FIRST_PIECES = 3
"""Of the first window: a run whose control is quiet in all but the first piece, and not less so in the last, needs no other."""
MOST_WINDOWS = 7


def suspects(reversals: Array) -> Array:
    """(M,) which members reverse a control too often in the tail; ``reversals`` (M, m) there."""
    return np.asarray((reversals > FEWEST_REVERSALS).any(axis=1))


def explained(reversals: Array, swings: Array, limited: Array, held: Held) -> Array:
    """(M,) of which members what drives them explains the reversals, as far as counts can tell, if they follow.

    No control reverses more often than twice for each turn of the commands and disturbances, its way from turn to turn is not
    longer than twice theirs, and none is at its limits for long: ``reversals``, ``swings`` and ``limited``, the share of the
    tail, are (M, m). A cycle that is smaller, or slower, than what the command makes of the control may hide in that.
    """
    often = reversals > FEWEST_REVERSALS + TURNS_EXPLAIN * held.turns
    far = swings > FEWEST_REVERSALS + TURNS_EXPLAIN * held.swings
    return np.asarray(~(often | far | (limited > LIMITED_SHARE)).any(axis=1))


def window(slowest: float, tail: float, reversals: float, t_end: float) -> float:
    """The length of a window [s]; ``slowest`` is the model's slowest period [s], ``reversals`` are those of the ``tail`` [s].

    As long as it may be where neither says anything.
    """
    seen = FEWEST_CYCLES * 2 * tail / reversals if reversals > 0 else 0.0
    longest = LONGEST_SHARE * t_end
    return min(max(SLOWEST_PERIODS * slowest, seen) or longest, longest)


def slowest_period(A: Array) -> float:
    """Of x' = A x [s], by the smallest |eigenvalue| that is not 0; 0 where there is none."""
    rates = np.abs(np.linalg.eigvals(A)) if A.size else np.zeros(0)
    rates = rates[rates > 0]
    return float(2 * np.pi / rates.min()) if len(rates) else 0.0


def enough_windows(reversals: float) -> int:
    """How many windows hold FEWEST_CYCLES periods of a cycle with so many ``reversals`` in each, two at least."""
    return int(np.ceil(2 * FEWEST_CYCLES / reversals))


def frequency_of(t: Array, v: Array) -> float:
    """Of a cycle's control [rad/s] at K instants [s]: how often it passes from below a quarter of its swing to above three.

    Waves of its own within the swing, as van der Pol's control has them, are not counted. 0 where it passes less than twice.
    """
    low, swing = float(v.min()), float(np.ptp(v))
    side = np.where(v > low + 0.75 * swing, 1, np.where(v < low + 0.25 * swing, -1, 0))
    seen = np.flatnonzero(side)
    up = seen[1:][(side[seen][1:] == 1) & (side[seen][:-1] == -1)]
    return float(2 * np.pi * (len(up) - 1) / (t[up[-1]] - t[up[0]])) if len(up) > 1 else 0.0


def quiet(swing: Array, band: Array) -> Array:
    """(M,) which runs rest by the pieces of their first window: ``swing`` (FIRST_PIECES, M, m), ``band`` (M, m).

    A control that stays in its band all that time, which is two periods of the model's slowest mode unless the run is shorter,
    swings for ever only with a period that is several times as long.
    """
    with np.errstate(invalid="ignore"):
        return np.asarray(((swing[1:] <= band).all(axis=0) & (swing[-1] <= swing[-2])).all(axis=1))


@dataclass(frozen=True, eq=False)
class Windows:
    """What K windows of a continuation showed, K >= 3, of M members with m inputs.

    swing      (K, M, m) peak to peak of the limited control
    reversals  (K, M, m)
    lost       (M,) whether a member diverged in them
    """

    swing: Array
    reversals: Array
    lost: Array

    def cycling(self, band: Array) -> Array:
        """(M, m) which controls swing for ever; ``band`` (M, m) is the least swing.

        The last window keeps KEPT_SHARE of the one before, or the other way round. Where the two still differ, the change must
        be on its way to nothing, or have turned round: what is faintly damped, or diverges slowly, changes by the same factor
        again and again.
        """
        earlier, before, last = self.swing[-3:]
        with np.errstate(invalid="ignore", divide="ignore"):
            change, change_before = np.log(last / before), np.log(before / earlier)
            ends = (np.abs(change) <= LEVELLING_SHARE * np.abs(change_before)) | (change * change_before < 0)
            lasting = (np.abs(change) <= -np.log(KEPT_SHARE)) & (ends | (np.abs(change) <= STEADY_SHARE))
        return np.asarray(lasting & self._swings(band))

    def growing(self, band: Array) -> Array:
        """(M,) which swing more in each window than in the one before, or diverged: nothing ends the oscillation as far as it was
        looked at, though it is no limit cycle yet."""
        earlier, before, last = self.swing[-3:]
        rising = (last > before) & (before > earlier) & self._swings(band)
        return np.asarray(rising.any(axis=1) | self.lost)

    def decided(self, band: Array) -> Array:
        """(M,) which members need no further window: they rest, swing steadily, or are lost."""
        before, last = self.swing[-2:]
        with np.errstate(invalid="ignore"):
            steady = np.abs(last - before) <= STEADY_SHARE * last
        return np.asarray((steady | ~self._swings(band)).all(axis=1) | self.lost)

    def _swings(self, band: Array) -> Array:
        """A drift has a swing, but does not turn back."""
        return np.asarray((self.swing[-1] > band) & (self.reversals[-1] >= 2) & ~self.lost[:, None])
