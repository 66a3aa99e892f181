"""Loops with a delay: all frequencies at which L(j w) e^(-j w d) is real and negative, and its distance from -1.

With the delay the loop's phase rotates without end, and the pencils of ``crossings`` need rational functions. But the phase is
the sum of -w d and one arc for every zero and pole of L, and each of these is monotone in w. The phase can therefore be bounded
over an interval of w, and intervals are halved until each provably contains no crossing, or exactly one.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from barbalat.linear.brent import zero_between
from barbalat.linear.crossings import Crossings, zeros
from barbalat.linear.systems import StateSpace
from barbalat.validate import Array

HALVING_STEPS = 60
"""Number of halvings of an interval, down to rounding errors. If an interval is then still undecided, its phase touches -pi
without crossing it."""

CLEAR_OF_A_LEVEL = 1e-9
"""Relative allowance, far above the rounding errors of a phase in whatever order it is summed."""

START_SHARE = 1e-9
"""The start of a search, as a fraction of the smallest zero, pole and 1/d: below it, L is constant or an integrator to within
1e-8."""


class Rotation:
    """The zeros and poles of L, the delay d, and the frequency ``low`` below which L has its low-frequency form."""

    def __init__(self, loop: StateSpace, delay: float) -> None:
        self.loop, self.delay = loop, delay
        self.poles = np.linalg.eigvals(loop.A)
        count = loop.order if loop.D else len(loop.transfer_function().num) - 1
        self.zeros = zeros(loop)
        self.zeros = self.zeros[np.argsort(np.abs(self.zeros))][:count]
        roots = np.concatenate([self.zeros, self.poles])
        sense = np.concatenate([np.ones(len(self.zeros)), -np.ones(len(self.poles))])
        self._sense = np.where(roots.real <= 0, sense, -sense)
        """For each arc: 1 if it rises with w, as for a zero in the left half plane, otherwise -1."""
        self._width = np.maximum(np.abs(roots.real), 1e-150)  # its square must not underflow to zero
        self._at = roots.imag
        sizes = np.abs(roots)
        known = 2 * float(sizes.max(initial=0.0)) or 1 / delay  # a w at which L is neither zero nor infinite
        self.low = START_SHARE * min([*sizes[sizes > 1e-12 * known], 1 / delay])
        self._start = float(np.angle(self.value(np.array([known]))[0]) - self._arcs(np.array([known]))[0])

    def value(self, w: Array) -> Array:
        """L(j w) e^(-j w d)."""
        return np.asarray(self.loop.response(w) * np.exp(-1j * w * self.delay))

    def _each(self, w: Array) -> Array:
        """(K, R), the arcs of zeros and poles, all rising."""
        with np.errstate(over="ignore"):
            return np.arctan((w[:, None] - self._at) / self._width)

    def _arcs(self, w: Array) -> Array:
        return np.asarray(self._each(w) @ self._sense - w * self.delay)

    def phase(self, w: Array) -> Array:
        """Return the unwrapped phase of L(j w) e^(-j w d) [rad]."""
        return self._start + self._arcs(w)

    def swing(self, left: Array, right: Array) -> tuple[Array, Array]:
        """How far the phase lies, at most, below and above its value at the left end, anywhere in the interval."""
        rises = self._each(right) - self._each(left)
        return rises @ (self._sense < 0) + (right - left) * self.delay, rises @ (self._sense > 0)

    def is_monotone(self, left: Array, right: Array) -> Array:
        """Whether the phase's slope certainly keeps its sign over the interval."""
        near = np.clip(self._at, left[:, None], right[:, None]) - self._at
        far = np.maximum(np.abs(left[:, None] - self._at), np.abs(right[:, None] - self._at))
        steepest, flattest = (self._width / (self._width**2 + x**2) for x in (near, far))
        rising = self._sense > 0
        most = steepest @ rising - flattest @ ~rising - self.delay
        least = flattest @ rising - steepest @ ~rising - self.delay
        return np.asarray((most < 0) | (least > 0))

    def negative_real(self, low: float, high: float) -> Array:
        """All w of (low, high] at which the phase is an odd multiple of pi."""
        edges = np.geomspace(low, high, 200)
        left, right = edges[:-1], edges[1:]
        found: list[float] = []
        for _ in range(HALVING_STEPS):
            if not len(left):
                break
            phase, (below, above) = self.phase(left), self.swing(left, right)
            first, last = _levels(phase - below, phase + above)
            left, right, first, last = (x[first <= last] for x in (left, right, first, last))
            single = (first == last) & self.is_monotone(left, right)
            for a, b, level in self._crossed(left[single], right[single], first[single]):
                found += self._at_level(float(a), float(b), (2 * level + 1) * np.pi)
            left, right = left[~single], right[~single]
            middle = (left + right) / 2
            left, right = np.concatenate([left, middle]), np.concatenate([middle, right])
        return np.unique([*found, *right])

    def _crossed(self, left: Array, right: Array, levels: Array) -> Iterator[tuple[float, float, float]]:
        """Return the few intervals of monotone phase whose ends may be on different sides of their level."""
        wanted = (2 * levels + 1) * np.pi
        off = np.array([self.phase(end) - wanted for end in (left, right)])
        clear = (np.abs(off) > CLEAR_OF_A_LEVEL * np.maximum(1.0, np.abs(wanted))).all(axis=0)
        for k in np.flatnonzero(~clear | (off[0] * off[1] < 0)):
            yield left[k], right[k], levels[k]

    def _at_level(self, left: float, right: float, level: float) -> list[float]:
        """The frequency at which the phase, which is monotone between the two, has this value; one w or none."""

        def off(w: float) -> float:  # ``phase`` minus the level in one call, because a search spends most of its time here
            arcs = np.arctan((np.array([[w]]) - self._at) / self._width) @ self._sense
            return float(self._start + (arcs[0] - w * self.delay)) - level

        with np.errstate(over="ignore"):
            ends = {w: off(w) for w in (left, right)}
            if ends[left] * ends[right] < 0:
                return [zero_between(off, left, right, absolute=1e-300, relative=1e-13)]
        return [w for w, value in ends.items() if abs(value) < 1e-12 * max(1.0, abs(level))]  # one of the ends, up to rounding


def _levels(lowest: Array, highest: Array) -> tuple[Array, Array]:
    """The first and the last m with (2 m + 1) pi between the two; there is none if the first is the larger."""
    return np.ceil((lowest / np.pi - 1) / 2), np.floor((highest / np.pi - 1) / 2)


def phase_crossings(crossings: Crossings, delay: float, crossovers: Array) -> Array:
    """All w at which L e^(-j w d) is negative and real, up to the w beyond which |L| stays below the largest of these magnitudes
    that is less than 1.

    Above the last crossover w_c, the delay alone causes a crossing. Zeros and poles rotate the phase by at most pi each, so it
    falls through an odd multiple of pi before w_c + (R + 2) pi/d. If k is the factor at that crossing, smaller factors cannot
    occur beyond the last w with k |L| = 1.
    """
    rotation = Rotation(crossings.loop, delay)
    last = float(crossovers.max(initial=0.0))
    reach = last + (len(rotation.zeros) + len(rotation.poles) + 2) * np.pi / delay
    at = rotation.negative_real(rotation.low, reach)
    beyond = np.abs(crossings.loop.response(at[at > last]))
    largest = float(beyond.max(initial=abs(crossings.loop.D)))
    if largest == 0:
        return np.zeros(0)
    end = max(crossings.of_unit_circle(1 / largest), default=reach)
    return at if end <= reach else np.concatenate([at, rotation.negative_real(reach, end)])
