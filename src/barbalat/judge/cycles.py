"""Detection of limit cycles: suspects are found by the reversals of their controls, and decided by continuing the run with all
signals held."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.judge.held import Held
from barbalat.validate import Array

FEWEST_REVERSALS = 2
"""A suspect reverses more often than this in the tail, for at least one and a half periods."""
TURNS_EXPLAIN = 2
"""Number of reversals that one turn of the commands and disturbances explains, and the largest explained ratio of the control's
path to theirs, each as a multiple of its range."""
LIMITED_SHARE = 0.25
"""A control that is at a limit, or at its limited rate, for more than this share of the tail responds to the limit and not to
the command."""
SLOWEST_PERIODS = 3.0
"""A window of a continuation has this many periods of the model's slowest mode, unless the run is shorter."""
FEWEST_CYCLES = 4.0
"""It also has at least this many periods of the oscillation seen in the tail."""
LONGEST_SHARE = 0.5
"""Share of the run that a window has at most, so that a continuation takes less than MOST_WINDOWS halves of it."""
KEPT_SHARE = 0.8
"""In a limit cycle, a window keeps at least this share of the previous window's swing."""
STEADY_SHARE = 0.02
"""A swing that changes by less between windows is decided; one that decays or grows faster is continued."""
LEVELLING_SHARE = 0.5
"""Largest ratio of successive changes between windows for a swing that converges to a limit cycle's."""
FEWEST_WINDOWS = 3
"""Least number of windows: the first shows the effect of holding the command, and the other two are compared."""
FIRST_PIECES = 3
"""Pieces of the first window: a run whose control is quiet in all pieces but the first, and as quiet in the last, needs no
other window."""
MOST_WINDOWS = 7


def suspects(reversals: Array) -> Array:
    """(M,) whether a member reverses a control too often in the tail; ``reversals`` (M, m) there."""
    return np.asarray((reversals > FEWEST_REVERSALS).any(axis=1))


def explained(reversals: Array, swings: Array, limited: Array, held: Held) -> Array:
    """(M,) whether the driving signals explain a member's reversals according to the counts, if the member follows.

    It requires that no control reverses more than twice for each turn of the commands and disturbances, that its path between
    turns is at most twice theirs, and that no control is at its limits for long: ``reversals``, ``swings`` and ``limited``, the
    share of the tail, are (M, m). A cycle that is smaller or slower than the control's response to the command may remain hidden.
    """
    often = reversals > FEWEST_REVERSALS + TURNS_EXPLAIN * held.turns
    far = swings > FEWEST_REVERSALS + TURNS_EXPLAIN * held.swings
    return np.asarray(~(often | far | (limited > LIMITED_SHARE)).any(axis=1))


def window(slowest: float, tail: float, reversals: float, t_end: float) -> float:
    """The length of a window [s]; ``slowest`` is the model's slowest period [s], ``reversals`` is their number in the ``tail``
    [s].

    The maximum length if neither gives a period.
    """
    seen = FEWEST_CYCLES * 2 * tail / reversals if reversals > 0 else 0.0
    longest = LONGEST_SHARE * t_end
    return min(max(SLOWEST_PERIODS * slowest, seen) or longest, longest)


def slowest_period(A: Array) -> float:
    """The slowest period of x' = A x [s], from the smallest nonzero |eigenvalue|; 0 if there is none."""
    rates = np.abs(np.linalg.eigvals(A)) if A.size else np.zeros(0)
    rates = rates[rates > 0]
    return float(2 * np.pi / rates.min()) if len(rates) else 0.0


def enough_windows(reversals: float) -> int:
    """The number of windows that contain FEWEST_CYCLES periods of a cycle with this number of ``reversals`` in each window, at
    least two."""
    return int(np.ceil(2 * FEWEST_CYCLES / reversals))


def frequency_of(t: Array, v: Array) -> float:
    """The frequency of a cycle's control [rad/s] from K instants [s]: it counts passes from below a quarter of the swing to above
    three quarters.

    Smaller waves within the swing, as in a van der Pol oscillation, are not counted. 0 for less than two passes.
    """
    low, swing = float(v.min()), float(np.ptp(v))
    side = np.where(v > low + 0.75 * swing, 1, np.where(v < low + 0.25 * swing, -1, 0))
    seen = np.flatnonzero(side)
    up = seen[1:][(side[seen][1:] == 1) & (side[seen][:-1] == -1)]
    return float(2 * np.pi * (len(up) - 1) / (t[up[-1]] - t[up[0]])) if len(up) > 1 else 0.0


def quiet(swing: Array, band: Array) -> Array:
    """(M,) which runs are at rest, judged by the pieces of their first window: ``swing`` (FIRST_PIECES, M, m), ``band`` (M, m).

    A control that stays in its band for the whole window, which is two periods of the model's slowest mode unless the run is
    shorter, could only oscillate with a period several times as long.
    """
    with np.errstate(invalid="ignore"):
        return np.asarray(((swing[1:] <= band).all(axis=0) & (swing[-1] <= swing[-2])).all(axis=1))


@dataclass(frozen=True, eq=False)
class Windows:
    """The observations in K windows of a continuation, K >= 3, for M members with m inputs.

    swing      (K, M, m) peak-to-peak value of the limited control
    reversals  (K, M, m)
    lost       (M,) whether a member diverged
    """

    swing: Array
    reversals: Array
    lost: Array

    def cycling(self, band: Array) -> Array:
        """(M, m) which controls oscillate without decay; ``band`` (M, m) is the smallest swing that counts.

        The last window keeps KEPT_SHARE of the previous one's swing, or vice versa. If the two still differ, the change must be
        decreasing or have changed its sign: lightly damped or slowly diverging oscillations change by the same factor again and
        again.
        """
        earlier, before, last = self.swing[-3:]
        with np.errstate(invalid="ignore", divide="ignore"):
            change, change_before = np.log(last / before), np.log(before / earlier)
            ends = (np.abs(change) <= LEVELLING_SHARE * np.abs(change_before)) | (change * change_before < 0)
            lasting = (np.abs(change) <= -np.log(KEPT_SHARE)) & (ends | (np.abs(change) <= STEADY_SHARE))
        return np.asarray(lasting & self._swings(band))

    def growing(self, band: Array) -> Array:
        """(M,) which members oscillate more in each window than in the previous one, or diverged: the oscillation had no
        visible end, but is not yet a limit cycle."""
        earlier, before, last = self.swing[-3:]
        rising = (last > before) & (before > earlier) & self._swings(band)
        return np.asarray(rising.any(axis=1) | self.lost)

    def decided(self, band: Array) -> Array:
        """(M,) which members need no further window: they are at rest, oscillate steadily, or are lost."""
        before, last = self.swing[-2:]
        with np.errstate(invalid="ignore"):
            steady = np.abs(last - before) <= STEADY_SHARE * last
        return np.asarray((steady | ~self._swings(band)).all(axis=1) | self.lost)

    def _swings(self, band: Array) -> Array:
        """A drift has a swing, but does not reverse."""
        return np.asarray((self.swing[-1] > band) & (self.reversals[-1] >= 2) & ~self.lost[:, None])
