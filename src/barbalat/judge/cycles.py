"""Detection of limit cycles. Suspects are found by the reversals of their controls, and a continuation of the run with all
signals held decides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.judge.held import Held
from barbalat.validate import Array

FEWEST_REVERSALS = 2
"""A suspect reverses more often than this in the tail, which is at least one and a half periods."""
TURNS_EXPLAIN = 2
"""Number of reversals that one turn of the commands and disturbances explains, and the largest ratio of the control's path to
their path that they explain, with each path as a multiple of its range."""
LIMITED_SHARE = 0.25
"""A control that is at a limit, or at its limited rate, for more than this fraction of the tail responds to the limit rather than
to the command."""
SLOWEST_PERIODS = 3.0
"""A window of a continuation contains this many periods of the model's slowest mode, unless the run is shorter."""
FEWEST_CYCLES = 4.0
"""A window also contains at least this many periods of the oscillation in the tail."""
LONGEST_SHARE = 0.5
"""Largest length of a window as a fraction of the run, so a continuation of MOST_WINDOWS windows takes less than half of the run
for each window."""
KEPT_SHARE = 0.8
"""In a limit cycle, a window keeps at least this fraction of the previous window's swing."""
STEADY_SHARE = 0.02
"""A swing that changes by less than this fraction between windows is decided. A swing that decays or grows faster is
continued."""
LEVELLING_SHARE = 0.5
"""Largest ratio of successive changes between windows for a swing that converges to the swing of a limit cycle."""
FEWEST_WINDOWS = 3
"""Smallest number of windows. The first shows the effect of holding the command, and the other two are compared."""
FIRST_PIECES = 3
"""Number of pieces of the first window. A run needs no further window if its control is quiet in all pieces but the first, and at
least as quiet in the last piece."""
MOST_WINDOWS = 7


def suspects(reversals: Array) -> Array:
    """Return whether each member (M,) reverses a control too often in the tail, from its ``reversals`` (M, m)."""
    return np.asarray((reversals > FEWEST_REVERSALS).any(axis=1))


def explained(reversals: Array, swings: Array, limited: Array, held: Held) -> Array:
    """Return whether the driving signals explain the reversals of each member (M,) that follows.

    This has three conditions. No control reverses more than twice per turn of the commands and disturbances, the path of each
    control between turns is at most twice theirs, and no control is at its limits for long. ``reversals``, ``swings`` and
    ``limited``, the fraction of the tail, are (M, m). A cycle that is smaller or slower than the control's response to the
    command may remain hidden.
    """
    often = reversals > FEWEST_REVERSALS + TURNS_EXPLAIN * held.turns
    far = swings > FEWEST_REVERSALS + TURNS_EXPLAIN * held.swings
    return np.asarray(~(often | far | (limited > LIMITED_SHARE)).any(axis=1))


def window(slowest: float, tail: float, reversals: float, t_end: float) -> float:
    """Return the length of a window [s]; without a known period this is the largest length.

    ``slowest`` is the model's slowest period [s], and ``reversals`` is the number of reversals in the ``tail`` [s].
    """
    seen = FEWEST_CYCLES * 2 * tail / reversals if reversals > 0 else 0.0
    longest = LONGEST_SHARE * t_end
    return min(max(SLOWEST_PERIODS * slowest, seen) or longest, longest)


def slowest_period(A: Array) -> float:
    """Return the slowest period of x' = A x [s], from the smallest nonzero |eigenvalue|; 0 without one."""
    rates = np.abs(np.linalg.eigvals(A)) if A.size else np.zeros(0)
    rates = rates[rates > 0]
    return float(2 * np.pi / rates.min()) if len(rates) else 0.0


def enough_windows(reversals: float) -> int:
    """Return how many windows contain FEWEST_CYCLES periods of a cycle that has this number of ``reversals``, at least two, in
    each window."""
    return int(np.ceil(2 * FEWEST_CYCLES / reversals))


def frequency_of(t: Array, v: Array) -> float:
    """Return the frequency of a cycle's control [rad/s] from K instants [s].

    Passes from the lowest to the highest quarter of the swing are counted. Smaller waves within the swing, as in a van der Pol
    oscillation, are not. The frequency is 0 for fewer than two passes.
    """
    low, swing = float(v.min()), float(np.ptp(v))
    side = np.where(v > low + 0.75 * swing, 1, np.where(v < low + 0.25 * swing, -1, 0))
    seen = np.flatnonzero(side)
    up = seen[1:][(side[seen][1:] == 1) & (side[seen][:-1] == -1)]
    return float(2 * np.pi * (len(up) - 1) / (t[up[-1]] - t[up[0]])) if len(up) > 1 else 0.0


def quiet(swing: Array, band: Array) -> Array:
    """Return which runs (M,) are at rest according to the pieces of their first window, given ``swing`` (FIRST_PIECES, M, m), and
    ``band`` (M, m).

    The window is two periods of the model's slowest mode unless the run is shorter. A control that stays in its band for the
    whole window could only oscillate with a period several times as long.
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
        """Return which controls (M, m) oscillate without decay. ``band`` (M, m) is the smallest swing that counts.

        The last window keeps KEPT_SHARE of the previous one's swing, or vice versa. If the two still differ, the change must be
        decreasing or have changed its sign, because lightly damped or slowly diverging oscillations change by the same factor in
        every window.
        """
        earlier, before, last = self.swing[-3:]
        with np.errstate(invalid="ignore", divide="ignore"):
            change, change_before = np.log(last / before), np.log(before / earlier)
            ends = (np.abs(change) <= LEVELLING_SHARE * np.abs(change_before)) | (change * change_before < 0)
            lasting = (np.abs(change) <= -np.log(KEPT_SHARE)) & (ends | (np.abs(change) <= STEADY_SHARE))
        return np.asarray(lasting & self._swings(band))

    def growing(self, band: Array) -> Array:
        """Return which members (M,) diverged or oscillate more in each window than in the previous window. Such an oscillation
        shows no limit but is not a limit cycle yet."""
        earlier, before, last = self.swing[-3:]
        rising = (last > before) & (before > earlier) & self._swings(band)
        return np.asarray(rising.any(axis=1) | self.lost)

    def decided(self, band: Array) -> Array:
        """Return which members (M,) need no further window because they are at rest, oscillate steadily, or are lost."""
        before, last = self.swing[-2:]
        with np.errstate(invalid="ignore"):
            steady = np.abs(last - before) <= STEADY_SHARE * last
        return np.asarray((steady | ~self._swings(band)).all(axis=1) | self.lost)

    def _swings(self, band: Array) -> Array:
        """Return which controls swing. A drift covers a range without reversing, so it is not a swing."""
        return np.asarray((self.swing[-1] > band) & (self.reversals[-1] >= 2) & ~self.lost[:, None])
