"""A linear loop with a sampled controller, zero-order hold and a delay of any length: exact from sample to sample.

Between samples X' = A X + E v, at a sample X becomes J X and the controller's output u = C X, which is held and reaches the plant
as v(t) = u(t - d). With d = (l + f) T, 0 <= f < 1, v changes within a sample, at f T:

    X[k+1] = J (e^(A T) X[k] + e^(A (1-f) T) Gamma(f T) u[k-l-1] + Gamma((1-f) T) u[k-l]),  Gamma(t) = integral_0^t e^(A s) ds E.

Gain and phase margins and peaks are those of the loop transfer function L(z), from v to -u, on the unit circle; by
z = (1 + s T/2)/(1 - s T/2) they are those of a continuous system. The delay margin is no function of one L(z).

Source: Astrom and Wittenmark, Computer-Controlled Systems, 3rd ed., sections 2.3 (delays that are no whole samples), 8.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from barbalat.linear.systems import StateSpace
from barbalat.validate import Array, InputError

LEAST_STEP = 1e-4
"""Of a sample: the search goes on by this much at least, beyond what the grid of frequencies resolves."""
FREQUENCIES = 600
"""Of the grid up to pi/T, once by equal ratios and once by equal steps; the modes without feedback join it."""
CLOSER_LOOKS, POINTS_OF_A_LOOK = 2, 21
"""Between the neighbours of a least value on the grid, and again: a hundredth of the grid's steps."""
SHORT_STEP = 0.1
"""Of a sample: steps of the search that are shorter are near a loss of stability, and what lies behind them is looked at."""
MOST_SAMPLES_OF_DELAY = 500
"""Beyond it the delay margin is not sought."""
EDGE_PLACES = 100
"""Of the edge within a sample, where |L| < 1 is asked for."""
GRID_ALLOWANCE = 2e-3
"""For a peak of |L| between the grid's frequencies, which is near enough to every mode that is not damped within two samples."""
LARGEST_TURN = 0.05
"""By how much e^(A t) may turn between the instants within a sample at which it is evaluated."""


class _Effects(NamedTuple):
    """Of a delay of l samples and a share f of one: what u[k-l] and u[k-l-1] make of X by the next sample."""

    whole: int
    part: float
    late: Array
    early: Array


@dataclass(frozen=True, eq=False)
class SampledLoop:
    """A (s, s), E (s, m), J (s, s), C (m, s) and the sample time T [s]; u = C X acts with the sign that it has in the loop."""

    A: Array
    E: Array
    J: Array
    C: Array
    T: float

    def over(self, t: float) -> tuple[Array, Array]:
        """e^(A t) and Gamma(t)."""
        from scipy.linalg import expm

        s, m = self.E.shape
        whole = expm(t * np.block([[self.A, self.E], [np.zeros((m, s + m))]]))
        return whole[:s, :s], whole[:s, s:]

    def broken(self, delay: float) -> tuple[Array, Array, Array]:
        """(M, N, C) of s[k+1] = M s[k] + N v[k], u[k] = C s[k]: the loop with its delay [s], open where u leaves."""
        whole, part, late, early = self._effects(delay)
        s, m = self.E.shape
        late, early = self.J @ late, self.J @ early
        kept = m * (whole + (part > 0))  # inputs of earlier samples that are still under way
        M, N = np.zeros((s + kept, s + kept)), np.zeros((s + kept, m))
        M[:s, :s] = self._between
        for age, effect in ((whole, late), (whole + 1, early)):
            if age == 0:
                N[:s] += effect
            elif age * m <= kept:
                M[:s, s + (age - 1) * m : s + age * m] += effect
        if kept:
            N[s : s + m] = np.eye(m)
            M[s + m :, s:-m] = np.eye(kept - m)
        return M, N, np.hstack([self.C, np.zeros((m, kept))])

    def _effects(self, delay: float) -> _Effects:
        whole, part = _split(delay, self.T)
        (after, late), (_, early) = self.over((1 - part) * self.T), self.over(part * self.T)
        return _Effects(whole, part, late, after @ early)

    @cached_property
    def _between(self) -> Array:
        """J e^(A T)."""
        return np.asarray(self.J @ self.over(self.T)[0])

    def closed(self, delay: float) -> Array:
        """From sample to sample."""
        M, N, C = self.broken(delay)
        return np.asarray(M + N @ C)

    def radius(self, delay: float) -> float:
        """The closed loop's spectral radius: below 1 where it is stable."""
        return float(np.abs(np.linalg.eigvals(self.closed(delay))).max())

    def as_continuous(self, delay: float) -> StateSpace:
        """L of one input at s = (2/T)(z - 1)/(z + 1): its frequencies are (2/T) tan(w T/2)."""
        M, N, C = self.broken(delay)
        past = np.linalg.inv(M + np.eye(len(M)))
        scale = 2 / self.T
        A, B = scale * past @ (M - np.eye(len(M))), scale * past @ N[:, 0]
        return StateSpace(A, B, -2 * C[0] @ past, float(C[0] @ past @ N[:, 0]))

    def delay_margin(self, delay: float) -> float:
        """The smallest delay [s] beside ``delay`` at which the loop loses stability; infinite where none does.

        From a stable delay on it goes as far as the loop is certainly stable: while |change of L| < |1 + L| at every frequency.
        L changes as the edge of v moves through the sample, by R e^(A t) E (1 - 1/z) dt, R = C (zI - J e^(A T))^-1 J. InputError
        where the loop is unstable, and where nothing is found up to ``MOST_SAMPLES_OF_DELAY`` samples.
        """
        from scipy.optimize import brentq

        if not self.radius(delay) < 1:
            raise InputError(f"unstable from sample to sample: spectral radius {self.radius(delay):.6g}")
        if self._never_large():
            return np.inf
        d = delay
        while d < delay + MOST_SAMPLES_OF_DELAY * self.T:
            step = self._safe_step(d)
            if step < SHORT_STEP * self.T:
                step = max(step, LEAST_STEP * self.T)
                if self.radius(d + step) >= 1:
                    return float(brentq(lambda at: self.radius(at) - 1, d, d + step, xtol=1e-12 * self.T)) - delay
            d += step
        raise InputError(f"no delay up to {MOST_SAMPLES_OF_DELAY} samples destabilises it, and longer ones were not tried")

    @cached_property
    def _grid(self) -> tuple[Array, Array]:
        """Frequencies (K,) [rad/s], and R there, (K, m, s)."""
        highest = np.pi / self.T
        w = np.union1d(np.geomspace(1e-6 * highest, highest, FREQUENCIES), np.linspace(0, highest, FREQUENCIES)[1:])
        modes = np.linalg.eigvals(self._between)
        own = np.abs(np.angle(modes[np.abs(modes) > 0.5])) / self.T  # others decay within samples: no narrow peak
        w = np.union1d(w, own[own > w[0]])
        return w, self._resolvent(w)

    def _resolvent(self, w: Array) -> Array:
        z = np.exp(1j * w * self.T)
        M = self._between
        turned = np.linalg.solve((z[:, None, None] * np.eye(len(M)) - M).transpose(0, 2, 1), self.C.T[None].astype(complex))
        return np.asarray(turned.transpose(0, 2, 1) @ self.J)

    @cached_property
    def _edges(self) -> Array:
        """e^(A t) E at instants t within a sample, (P, s, m)."""
        count = int(np.clip(np.ceil(np.linalg.norm(self.A, 2) * self.T / LARGEST_TURN), 8, 256))
        return np.array([self.over(t)[0] @ self.E for t in np.linspace(0, self.T, count + 1)])

    def _slopes(self, w: Array, R: Array) -> Array:
        """The largest |dL/dd| at each frequency, over all places of the edge, (K,)."""
        moved = np.stack([np.linalg.norm(R @ edge, 2, axis=(1, 2)) for edge in self._edges]).max(axis=0)
        return np.asarray(np.exp(LARGEST_TURN) * moved * np.abs(1 - np.exp(-1j * w * self.T)))

    @cached_property
    def _grid_slopes(self) -> Array:
        return self._slopes(*self._grid)

    def _L(self, w: Array, R: Array, effects: _Effects) -> Array:
        z = np.exp(1j * w * self.T)[:, None, None]
        return np.asarray(-(R @ effects.late + R @ effects.early / z) / z**effects.whole)

    def _safe_step(self, delay: float) -> float:
        """|1 + L| over |dL/dd| at the worst frequency; around the least values on the grid it is looked at more closely."""
        w, R = self._grid
        effects = self._effects(delay)
        room = self._room(w, R, self._grid_slopes, effects)
        for _ in range(CLOSER_LOOKS):
            inner = np.concatenate([[np.inf], room, [np.inf]])
            least = np.flatnonzero((room <= inner[:-2]) & (room <= inner[2:]) & (room <= 4 * room.min()))
            left, right = w[np.maximum(least - 1, 0)], w[np.minimum(least + 1, len(w) - 1)]
            w = np.unique(np.linspace(left, right, POINTS_OF_A_LOOK))
            R = self._resolvent(w)
            room = self._room(w, R, self._slopes(w, R), effects)
        return float(room.min())

    def _room(self, w: Array, R: Array, slopes: Array, effects: _Effects) -> Array:
        nearest = np.linalg.norm(np.eye(len(self.C)) + self._L(w, R, effects), -2, axis=(1, 2))
        return np.asarray(nearest / np.maximum(slopes, 1e-300))

    def _never_large(self) -> bool:
        """Whether |L| < 1 at all frequencies wherever the edge stands, which no delay changes.

        Between the places of the edge that are looked at L changes by what its slope allows.
        """
        w, R = self._grid

        def largest(parts: Array) -> Array:
            return np.max([np.linalg.norm(self._L(w, R, self._effects(part * self.T)), 2, axis=(1, 2)) for part in parts], axis=0)

        if largest(np.linspace(0, 0.9, 10)).max() >= 1:
            return False
        middles = (np.arange(EDGE_PLACES) + 0.5) / EDGE_PLACES
        return bool((largest(middles) + self._grid_slopes * self.T / (2 * EDGE_PLACES)).max() < 1 - GRID_ALLOWANCE)


def _split(delay: float, T: float) -> tuple[int, float]:
    """Whole samples and the rest, a share of one; a rest within rounding of a sample is none."""
    whole = int(np.floor(delay / T + 1e-12))
    return whole, max(delay / T - whole, 0.0)
