"""A linear loop with a sampled controller, zero-order hold and a delay of any length, exact at the samples.

Between samples X' = A X + E v. At a sample X becomes J X, and the controller's output u = C X is held and reaches the plant as
v(t) = u(t - d). With d = (l + f) T, 0 <= f < 1, v changes within a sample, at f T:

    X[k+1] = J (e^(A T) X[k] + e^(A (1-f) T) Gamma(f T) u[k-l-1] + Gamma((1-f) T) u[k-l]),  Gamma(t) = integral_0^t e^(A s) ds E.

With R = C (zI - J e^(A T))^-1 J, L(z) from v to -u is -R (e^(A (1-f) T) Gamma(f T)/z + Gamma((1-f) T))/z^l. Gain and phase
margins and peaks at one input are those of L(z) on the unit circle with the other inputs closed. With z = (1 + s T/2)/(1 - s T/2)
they are those of a continuous system. Margins that do not follow from a single L(z) are found by a search.

Source: Astrom and Wittenmark, Computer-Controlled Systems, 3rd ed., sections 2.3 (delays that are not whole samples) and 8.2.

Neither the delay margin nor the margin for a common gain on all inputs follows from a single transfer function.

The search starts from a stable loop and advances by steps over which stability is certain. For a delay, the step is certain if
|change of L| < |1 + L| at every frequency. L changes by R e^(A t) E (1 - 1/z) dt as the edge of v moves through the sample. For a
factor k on all inputs, det(I + k L) = 0 means that k is -1/lambda for an eigenvalue lambda of L: k may change by less than its
distance to each of these. Near the boundary the number of unstable modes decides. For a factor it follows from the eigenvalues.
For a long delay, which makes their matrix large, it follows from the argument principle: the closed loop's determinant turns
around zero along a circle as often as there are modes outside. The delay at which stability is lost is a zero of the determinant
on the unit circle.

The delay of one input, with the others closed, is the delay of the loop with one input whose resolvent is

    R_i - L_io (I + L_oo)^-1 R_o,    R_i - L_io (I + L_oo)^-1 R_o, where o are the other inputs with their own delays.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np

from barbalat.linear.brent import zero_between
from barbalat.linear.margins import LARGEST_FACTOR
from barbalat.linear.systems import StateSpace
from barbalat.validate import Array, InputError


class Effects(NamedTuple):
    """The effects of u[k-l] and u[k-l-1] on X at the next sample, for a delay of l samples and a fraction f of one; with a column
    per input."""

    whole: Array
    part: Array
    late: Array
    early: Array


@dataclass(frozen=True, eq=False)
class SampledLoop:
    """A (s, s), E (s, m), J (s, s), C (m, s) and the sample time T [s]; u = C X has the sign that it has in the loop."""

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

    @property
    def inputs(self) -> int:
        return int(self.E.shape[1])

    def broken(self, delay: float | Array) -> tuple[Array, Array, Array]:
        """(M, N, C) of s[k+1] = M s[k] + N v[k], u[k] = C s[k]: opened at the output u, with one delay [s] or one for each
        input."""
        found = self.effects(delay)
        s, m = self.E.shape
        of_earlier: dict[tuple[int, int], int] = {}  # position of the u_i of this many samples ago, while it is in the delay
        depths = found.whole + (found.part > 0)
        for age in range(1, int(depths.max()) + 1):
            of_earlier |= {(age, i): s + len(of_earlier) + k for k, i in enumerate(np.flatnonzero(depths >= age).tolist())}
        size = s + len(of_earlier)
        M, N = np.zeros((size, size)), np.zeros((size, m))
        M[:s, :s] = self.between
        for (age, i), row in of_earlier.items():
            if age == 1:
                N[row, i] = 1.0
            else:
                M[row, of_earlier[age - 1, i]] = 1.0
        for i, whole in enumerate(found.whole):
            for age, effect in ((whole, found.late[:, i]), (whole + 1, found.early[:, i])):
                if age == 0:
                    N[:s, i] += self.J @ effect
                elif (age, i) in of_earlier:
                    M[:s, of_earlier[age, i]] += self.J @ effect
        return M, N, np.hstack([self.C, np.zeros((m, len(of_earlier)))])

    def broken_at(self, i: int, delay: float | Array) -> tuple[Array, Array, Array]:
        """(M, N, C) of the loop opened only at input i, with the others closed."""
        M, N, C = self.broken(delay)
        others = np.arange(self.inputs) != i
        return M + N[:, others] @ C[others], N[:, [i]], C[[i]]

    def effects(self, delay: float | Array) -> Effects:
        delays = np.broadcast_to(delay, self.inputs)
        splits = [_split(float(one), self.T) for one in delays]
        late, early = np.empty_like(self.E), np.empty_like(self.E)
        for part in {part for _, part in splits}:
            (after, of_late), (_, of_early) = self.over((1 - part) * self.T), self.over(part * self.T)
            with_it = [i for i, (_, one) in enumerate(splits) if one == part]
            late[:, with_it], early[:, with_it] = of_late[:, with_it], (after @ of_early)[:, with_it]
        return Effects(np.array([whole for whole, _ in splits]), np.array([part for _, part in splits]), late, early)

    @cached_property
    def between(self) -> Array:
        """The map J e^(A T) from one sample to the next."""
        return np.asarray(self.J @ self.over(self.T)[0])

    def closed(self, delay: float | Array, factor: float = 1.0) -> Array:
        """The discrete-time matrix of the closed loop; ``factor`` multiplies all inputs."""
        M, N, C = self.broken(delay)
        return np.asarray(M + factor * N @ C)

    def radius(self, delay: float | Array, factor: float = 1.0) -> float:
        """The spectral radius of the closed loop, which is below 1 if the loop is stable."""
        return float(np.abs(np.linalg.eigvals(self.closed(delay, factor))).max())

    def is_stable(self, delay: float | Array) -> bool:
        """Whether no mode of the closed loop is outside the circle of radius ``BEYOND``, by the turns of ``characteristic`` along
        it, or by the eigenvalues if they are few."""
        effects = self.effects(delay)
        if effects.whole.sum() < FEW_MODES:
            return self.radius(delay) < 1
        angles = np.linspace(0, np.pi, int(STEPS_OF_A_TURN * (effects.whole + 2).sum()) + FREQUENCIES)
        turns = _turns(lambda some: self.characteristic(BEYOND * np.exp(1j * some), effects), angles)
        return self.radius(delay) < 1 if turns is None else turns == 0

    def characteristic(self, z: Array, effects: Effects) -> Array:
        """det(I - (J e^(A T) + J (late + early/z)/z^l C)/z) at points (K,), zero at the closed loop's modes, 1 at infinity."""
        z = z[:, None, None]
        fed_back = (self.J @ effects.late + self.J @ effects.early / z) / z**effects.whole @ self.C
        return np.asarray(np.linalg.det(np.eye(len(self.A)) - (self.between + fed_back) / z))

    def as_continuous(self, delay: float, at: int = 0) -> StateSpace:
        """L broken at one input, at s = (2/T)(z - 1)/(z + 1): its frequencies are (2/T) tan(w T/2)."""
        M, N, C = self.broken_at(at, delay)
        past = np.linalg.inv(M + np.eye(len(M)))
        scale = 2 / self.T
        A, B = scale * past @ (M - np.eye(len(M))), scale * past @ N[:, 0]
        return StateSpace(A, B, -2 * C[0] @ past, float(C[0] @ past @ N[:, 0]))

    def resolvent(self, w: Array) -> Array:
        """R at frequencies (K,) [rad/s], (K, m, s)."""
        z = np.exp(1j * w * self.T)
        M = self.between
        turned = np.linalg.solve((z[:, None, None] * np.eye(len(M)) - M).transpose(0, 2, 1), self.C.T[None].astype(complex))
        return np.asarray(turned.transpose(0, 2, 1) @ self.J)

    def response(self, w: Array, R: Array, effects: Effects) -> Array:
        """-R (late + early/z)/z^l at frequencies (K,), for inputs with these effects: L, if R is the resolvent."""
        z = np.exp(1j * w * self.T)[:, None, None]
        return np.asarray(-(R @ effects.late + R @ effects.early / z) / z**effects.whole)


def _turns(function: Callable[[Array], Array], angles: Array) -> int | None:
    """The number of turns of the function around zero along the circle, from its values on the upper half; the values on the
    other half are their conjugates.

    An interval is halved until the values at its ends and in its middle are close to a straight line that stays away from zero.
    None if rounding errors would require too many intervals.
    """
    values = function(angles)
    ends, total = (angles[:-1], angles[1:], values[:-1], values[1:]), 0.0
    while len(ends[0]) <= MOST_INTERVALS:
        low, high, first, last = ends
        middle = (low + high) / 2
        between = function(middle)
        least = np.minimum(np.abs(first), np.abs(last))
        straight = (np.abs(last - first) < least / 2) & (np.abs(between - (first + last) / 2) < least / 4)
        total += float(np.angle(last[straight] / first[straight]).sum())
        if straight.all():
            return round(total / np.pi)
        halves = ((low, middle, first, between), (middle, high, between, last))
        low, high, first, last = (np.concatenate([one[~straight] for one in pair]) for pair in zip(*halves, strict=True))
        ends = low, high, first, last
    return None


def _split(delay: float, T: float) -> tuple[int, float]:
    """Whole samples and the remaining fraction of one; a remainder within rounding of a whole sample is rounded to it."""
    whole = int(np.floor(delay / T + 1e-12))
    return whole, max(delay / T - whole, 0.0)


LEAST_STEP = 1e-4
"""Smallest step of the search, as a fraction of a sample (for a delay) or of the factor (for a gain); it is below the resolution
of the grid of frequencies."""
FREQUENCIES = 600
"""Number of frequencies up to pi/T on each of two grids, logarithmic and linear; the modes without feedback are added."""
CLOSER_LOOKS, POINTS_OF_A_LOOK = 2, 21
"""Number of refinements between the neighbours of a minimum on the grid, down to 1/100 of the grid spacing."""
SHORT_STEP = 0.1
"""If the step of the search is shorter than this fraction of a sample (for a delay) or of the factor (for a gain), stability may
be lost nearby, which is then examined."""
MOST_SAMPLES_OF_DELAY = 500
"""Largest delay, in samples, up to which the delay margin is searched."""
BEYOND = 1 + 1e-12
"""Radius of the circle outside which a mode counts as unstable."""
STEPS_OF_A_TURN, MOST_INTERVALS = 4, 100_000
"""Number of angles for each turn that a delay adds to L, and largest number of intervals between angles."""
LOSS_WITHIN = 1e-12
"""Accuracy of the delay at which stability is lost, as a share of a sample."""
MOST_STEPS_OF_NEWTON, SMALL_CHANGE = 30, 1e-6
"""Largest number of steps of Newton's method, and relative change for its slopes."""
FEW_MODES = 100
"""Number of samples of delay, over all inputs, below which the eigenvalues take less time than the argument principle."""
EDGE_PLACES = 100
"""Number of positions of a delay's edge within a sample at which |L| < 1 is checked."""
GRID_ALLOWANCE = 2e-3
"""Allowance for a peak of |L| between grid frequencies; every mode that does not decay within two samples has grid points near
it."""
LARGEST_TURN = 0.05
"""Largest rotation of e^(A t) between the instants within a sample at which it is evaluated."""
SHARE_OF_ROOM = 0.9
"""Fraction of the distance to the loss of stability by which the factor advances in one step, so that the search does not end on
the loss itself."""


def delay_margin(loop: SampledLoop, delay: float, at: int | None = None) -> float:
    """The smallest additional delay [s] at which the loop with ``delay`` loses stability; infinite if there is none.

    at  the single input whose delay grows; by default the delays of all inputs grow equally

    Raises InputError if the loop is unstable, and if no loss is found up to ``MOST_SAMPLES_OF_DELAY`` samples.
    """
    return _DelaySearch(_stable(loop, delay), delay, at).margin()


def gain_margins(loop: SampledLoop, delay: float) -> tuple[float, float]:
    """The factors closest to 1, below and above it, that destabilise the loop if they multiply all inputs; 0 and infinite if
    there are no such factors.

    Factors up to ``LARGEST_FACTOR`` are examined. Raises InputError if the loop is unstable.
    """
    search = _GainSearch(_stable(loop, delay), delay)
    return search.margin(-1), search.margin(1)


def _stable(loop: SampledLoop, delay: float) -> SampledLoop:
    if not (radius := loop.radius(delay)) < 1:
        raise InputError(f"the sampled-data loop is unstable: spectral radius {radius:.6g}")
    return loop


def _grid(loop: SampledLoop, M: Array) -> Array:
    """Frequencies (K,) [rad/s] up to pi/T, with those of the modes of M."""
    highest = np.pi / loop.T
    w = np.union1d(np.geomspace(1e-6 * highest, highest, FREQUENCIES), np.linspace(0, highest, FREQUENCIES)[1:])
    modes = np.linalg.eigvals(M)
    own = np.abs(np.angle(modes[np.abs(modes) > 0.5])) / loop.T  # other modes decay within a few samples and have no narrow peak
    return np.union1d(w, own[own > w[0]])


def _gains(matrices: Array) -> tuple[Array, Array]:
    """The largest and the smallest singular values, (K,) each; for one or two inputs by formulas, which take a fraction of the
    time."""
    if matrices.shape[1] > 2:
        found = np.linalg.svd(matrices, compute_uv=False)
        return np.asarray(found[:, 0]), np.asarray(found[:, -1])
    if matrices.shape[1] == 1:
        return np.abs(matrices[:, 0, 0]), np.abs(matrices[:, 0, 0])
    squares = np.square(np.abs(matrices)).sum(axis=(1, 2))
    product = np.abs(matrices[:, 0, 0] * matrices[:, 1, 1] - matrices[:, 0, 1] * matrices[:, 1, 0])
    largest = np.sqrt((squares + np.sqrt(np.maximum(squares**2 - 4 * product**2, 0.0))) / 2)
    return largest, product / np.maximum(largest, 1e-300)


def _between_neighbours(w: Array, room: Array) -> Array:
    """Frequencies around the minima."""
    inner = np.concatenate([[np.inf], room, [np.inf]])
    least = np.flatnonzero((room <= inner[:-2]) & (room <= inner[2:]) & (room <= 4 * room.min()))
    left, right = w[np.maximum(least - 1, 0)], w[np.minimum(least + 1, len(w) - 1)]
    return np.unique(np.linspace(left, right, POINTS_OF_A_LOOK))


@dataclass(frozen=True, eq=False)
class _DelaySearch:
    """The search for the additional delay of the inputs ``at``, or of all, at which stability is lost."""

    loop: SampledLoop
    delay: float
    at: int | None

    def margin(self) -> float:
        if self._never_large():
            return np.inf
        T, late, is_stable = self.loop.T, 0.0, cache(self._is_stable)
        while late < MOST_SAMPLES_OF_DELAY * T:
            step, w = self._safe_step(late)
            if step < SHORT_STEP * T:
                step = max(step, LEAST_STEP * T)
                if not is_stable(late + step):
                    stable = late if is_stable(late) else 0.0  # a mode narrower than the grid may have been missed
                    return self._loss(stable, late + step, w)
            late += step
        raise InputError(f"no delay up to {MOST_SAMPLES_OF_DELAY} samples destabilises the loop; longer ones were not tried")

    def _loss(self, stable: float, unstable: float, w: float) -> float:
        """The delay between these two at which stability is lost; the nearer the stable delay is to it, the nearer w is to the
        critical frequency."""
        while unstable - stable > LOSS_WITHIN * self.loop.T:
            if stable <= (found := self._zero(stable, w)) <= unstable:
                return found
            middle = (stable + unstable) / 2
            if self._is_stable(middle):
                stable, (_, w) = middle, self._safe_step(middle)
            else:
                unstable = middle
        return unstable

    def _zero(self, late: float, w: float) -> float:
        """The delay of a zero of the determinant on the unit circle, by Newton's method; NaN if it does not converge."""

        def determinant(late: float, w: float) -> complex:
            z = np.exp(1j * np.array([w]) * self.loop.T)
            return complex(self.loop.characteristic(z, self.loop.effects(self._delays(late)))[0])

        close, closer = self.loop.T * SMALL_CHANGE, w * SMALL_CHANGE
        for _ in range(MOST_STEPS_OF_NEWTON):
            here = determinant(late, w)
            of_late = (determinant(late + close, w) - here) / close
            of_w = (determinant(late, w + closer) - here) / closer
            slopes = np.array([[of_late.real, of_w.real], [of_late.imag, of_w.imag]])
            if not abs(np.linalg.det(slopes)) > 0:
                return np.nan
            change = np.linalg.solve(slopes, [-here.real, -here.imag])
            late, w = late + float(change[0]), w + float(change[1])
            if late + self.delay < 0:
                return np.nan
            if abs(change[0]) < LOSS_WITHIN * self.loop.T:
                return late
        return np.nan

    @property
    def _columns(self) -> Array:
        """The inputs that are delayed further."""
        return np.arange(self.loop.inputs) if self.at is None else np.array([self.at])

    def _delays(self, late: float) -> Array:
        delays = np.full(self.loop.inputs, self.delay)
        delays[self._columns] += late
        return delays

    def _is_stable(self, late: float) -> bool:
        return self.loop.is_stable(self._delays(late))

    def _effects(self, late: float) -> Effects:
        found = self.loop.effects(self.delay + late)
        return Effects(*(part[..., self._columns] for part in found))

    @cached_property
    def _grid(self) -> tuple[Array, Array]:
        """Frequencies (K,) [rad/s], and the resolvent there, (K, m, s)."""
        w = _grid(self.loop, self.loop.between if self.at is None else self.loop.broken_at(self.at, self.delay)[0])
        return w, self._resolvent(w)

    def _resolvent(self, w: Array) -> Array:
        R = self.loop.resolvent(w)
        if self.at is None:
            return R
        others = np.flatnonzero(np.arange(self.loop.inputs) != self.at)
        L = self.loop.response(w, R, Effects(*(part[..., others] for part in self.loop.effects(self.delay))))
        through = np.linalg.solve(np.eye(len(others)) + L[:, others], R[:, others])
        return np.asarray(R[:, [self.at]] - L[:, [self.at]] @ through)

    @cached_property
    def _edges(self) -> Array:
        """e^(A t) E at instants t within a sample, (P, s, m)."""
        A, E, T = self.loop.A, self.loop.E[:, self._columns], self.loop.T
        count = int(np.clip(np.ceil(np.linalg.norm(A, 2) * T / LARGEST_TURN), 8, 256))
        return np.array([self.loop.over(t)[0] @ E for t in np.linspace(0, T, count + 1)])

    def _slopes(self, w: Array, R: Array) -> Array:
        """The largest |dL/dd| at each frequency, over all positions of the edge, (K,)."""
        moved = np.stack([_gains(R @ edge)[0] for edge in self._edges]).max(axis=0)
        return np.asarray(np.exp(LARGEST_TURN) * moved * np.abs(1 - np.exp(-1j * w * self.loop.T)))

    @cached_property
    def _grid_slopes(self) -> Array:
        return self._slopes(*self._grid)

    def _safe_step(self, late: float) -> tuple[float, float]:
        """|1 + L| over |dL/dd| at the worst frequency, and this frequency; around the minima on the grid it is refined."""
        w, R = self._grid
        effects = self._effects(late)
        room = self._room(w, R, self._grid_slopes, effects)
        for _ in range(CLOSER_LOOKS):
            w = _between_neighbours(w, room)
            R = self._resolvent(w)
            room = self._room(w, R, self._slopes(w, R), effects)
        return float(room.min()), float(w[room.argmin()])

    def _room(self, w: Array, R: Array, slopes: Array, effects: Effects) -> Array:
        L = self.loop.response(w, R, effects)
        _, nearest = _gains(np.eye(L.shape[1]) + L)
        return np.asarray(nearest / np.maximum(slopes, 1e-300))

    def _never_large(self) -> bool:
        """Whether |L| < 1 at all frequencies and for all positions of the edge, in which case delays do not matter.

        Between the checked positions of the edge, L changes by at most what its slope allows.
        """
        w, R = self._grid
        start = -self.delay  # the whole delay within a sample, including the plant's own

        def largest(parts: Array) -> Array:
            responses = (self.loop.response(w, R, self._effects(start + part * self.loop.T)) for part in parts)
            return np.max([_gains(one)[0] for one in responses], axis=0)

        if largest(np.linspace(0, 0.9, 10)).max() >= 1:
            return False
        middles = (np.arange(EDGE_PLACES) + 0.5) / EDGE_PLACES
        return bool((largest(middles) + self._grid_slopes * self.loop.T / (2 * EDGE_PLACES)).max() < 1 - GRID_ALLOWANCE)


@dataclass(frozen=True, eq=False)
class _GainSearch:
    """The search for the factor on all inputs at which stability is lost."""

    loop: SampledLoop
    delay: float

    def margin(self, direction: int) -> float:
        """The first factor from 1 on, upwards or downwards."""
        k, radius = 1.0, cache(self._radius)
        while 1 / LARGEST_FACTOR < k < LARGEST_FACTOR:
            step = SHARE_OF_ROOM * self._safe_step(k)
            if step < SHORT_STEP * k:
                step = max(step, LEAST_STEP * k)
                following = k + direction * step
                if radius(following) >= 1:
                    stable = k if radius(k) < 1 else 1.0  # as above
                    return zero_between(lambda one: radius(one) - 1, stable, following, absolute=1e-12 * k)
            k += direction * step
        return np.inf if direction > 0 else 0.0

    def _radius(self, k: float) -> float:
        return self.loop.radius(self.delay, k)

    def _lost_at(self, w: Array) -> Array:
        """-1/lambda, (K, m)."""
        values = np.linalg.eigvals(self.loop.response(w, self.loop.resolvent(w), self.loop.effects(self.delay)))
        return np.asarray(-1 / np.where(values == 0, 1e-300, values))

    @cached_property
    def _grid(self) -> tuple[Array, Array]:
        w = _grid(self.loop, self.loop.between)
        return w, self._lost_at(w)

    def _safe_step(self, k: float) -> float:
        w, lost_at = self._grid
        room = np.abs(lost_at - k).min(axis=1)
        for _ in range(CLOSER_LOOKS):
            w = _between_neighbours(w, room)
            room = np.abs(self._lost_at(w) - k).min(axis=1)
        return float(room.min())
