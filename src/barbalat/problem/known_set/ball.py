"""A ball as the known set, also in combination with intervals of unknown input gains."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from barbalat import validate
from barbalat.problem.known_set import cone
from barbalat.problem.known_set.box import UNREACHED_BOUND, ParameterBox
from barbalat.problem.known_set.gain import UNIT_GAIN, Gain
from barbalat.protocols import Value
from barbalat.settings import Settings
from barbalat.validate import Array, InputError

if TYPE_CHECKING:
    from barbalat.problem.known_set.box import ParameterBox

ROUNDED_UP = 1 + 1e-12
"""Allowance for the rounding of a sum of up to thousands of numbers."""

ON_THE_SPHERE = 2.0**-46
"""An estimate that is this close to the sphere counts as being on it. It is a few dozen rounding errors, relative to |center| +
radius."""

INSIDE_THE_SPHERE = 2.0**-50
"""Distance inside the sphere to which the limit moves an estimate, so that rounding cannot move it out."""

SPHERE_STEPS = 6
"""Number of Newton steps of the implicit step, which is valid after any number of them. In tests the residual was below 1e-9 of
the radius in 999 of 1000 cases, and never above 2e-3."""

SCALAR_ONLY = (
    "discretization = 'midpoint' projects onto a ball for a scalar gain only (not for a matrix or least squares); "
    "give a box, projection = false, or discretization = 'euler'"
)


@dataclass(frozen=True, eq=False)
class ParameterBall(Settings):
    """The known convex set Omega = {|theta - center|_2 <= radius}.

    center  (p,); with m inputs also (p, m), as theta
    radius  radius in the Euclidean norm, > 0
    """

    center: Array
    radius: float

    first_field: ClassVar[str] = "center"
    fills_its_extent: ClassVar[bool] = False
    intervals: ClassVar[ParameterBox | None] = None  # no estimate has an interval
    bounds_theta: ClassVar[bool] = True
    cuts_corners: ClassVar[bool] = False  # there are none
    steps_cut_corners: ClassVar[bool] = False

    def __post_init__(self) -> None:
        validate.freeze(self, center=validate.by_rows("uncertainty.center", self.center))
        validate.freeze(self, radius=validate.positive("uncertainty.radius", self.radius))

    def __str__(self) -> str:
        return f"within {self.radius:g} of {validate.show(self.center)}"

    @property
    def size(self) -> int:
        """The number of parameters."""
        return len(self.center)

    def contains(self, theta: Array) -> bool:
        return bool(math.hypot(*(theta - self.center)) <= self.radius)

    def reached_by(self, estimates: Array) -> bool:
        """Return whether one of the estimates (K, n) is at the set's boundary, up to the last few bits."""
        return bool((np.linalg.norm(estimates - self.center, axis=1) >= self.radius * (1 - 1e-9)).any())

    def within(self, bound: Fraction) -> bool:
        """Return whether |theta|_2 <= bound for every theta in the set, in exact arithmetic."""
        room = bound - Fraction(self.radius)
        return room >= 0 and sum((Fraction(value) ** 2 for value in self.center.tolist()), Fraction(0)) <= room**2

    @property
    def extent(self) -> tuple[Array, Array]:
        """The smallest and the largest value of each component in the set."""
        return self.center - self.radius, self.center + self.radius

    @property
    def theta_max(self) -> float:
        """The largest 1-norm in the set, |center|_1 + radius sqrt(n), rounded up. It is attained if every component moves outward
        equally."""
        return self.farthest_1(np.zeros(self.size)) * ROUNDED_UP

    @property
    def middle(self) -> Array:
        """The set's centre (n,)."""
        return self.center

    def farthest_1(self, theta: Array) -> float:
        """Return the largest 1-norm of the difference between ``theta`` and a point of the set."""
        return float(np.abs(self.center - theta).sum() + self.radius * math.sqrt(self.size))

    def farthest(self, theta: Array, weights: Array | float = 1.0) -> float:
        """Return the largest Euclidean distance from ``theta`` to a point of the set; with ``weights`` (p,), an upper bound."""
        return math.hypot(*(np.sqrt(weights) * (theta - self.center))) + self.radius * math.sqrt(np.max(weights))

    def extreme_points(self, rng: np.random.Generator, most: int) -> Array:
        """Return the ends along the axes and random points of the surface, ``most`` in all."""
        n = self.size
        directions = rng.standard_normal((most - 2 * n, n))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        return np.asarray(self.center + self.radius * np.concatenate([np.eye(n), -np.eye(n), directions]))

    def drawn(self, rng: np.random.Generator, count: int) -> Array:
        """Return uniformly distributed points of the set (count, n). The volume within a radius is proportional to its n-th
        power."""
        directions = rng.standard_normal((count, self.size))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        return np.asarray(self.center + self.radius * rng.uniform(size=(count, 1)) ** (1 / self.size) * directions)

    def brought_in(self, points: Array) -> Array:
        """Return the points (M, n), with each point outside the set replaced by the nearest point of the set."""
        away = points - self.center
        return np.asarray(self.center + away * np.minimum(1, self.radius / np.linalg.norm(away, axis=1, keepdims=True)))

    def with_gains(self, gains: ParameterBox) -> ParameterProduct:
        """Return the set of these parameters followed by the input gains."""
        return ParameterProduct(self, gains)

    def of_theta(self, count: int) -> ParameterBall:
        """Return the set of theta alone, which is the whole set here."""
        return self

    def over(self, gains: ParameterBox) -> ParameterBall:
        """Return a ball that contains theta/omega for every theta in this ball and every omega > 0 in any of the intervals."""
        low, high = (1 / gains.upper).min(), (1 / gains.lower).max()  # of 1/omega
        reach = self.radius * high + math.hypot(*self.center) * (high - low) / 2
        return ParameterBall(center=self.center * (low + high) / 2, radius=float(reach) * ROUNDED_UP)

    @property
    def sphere(self) -> ParameterBall:
        """The ball of the first estimates; here these are all estimates."""
        return self

    def project(self, rate: Value, theta_hat: Value, gain: Gain = UNIT_GAIN) -> Value:
        """Return rate - Gamma g g'rate/(g'Gamma g) with g = theta_hat - center if theta_hat is on the sphere and g'rate > 0, else
        rate.

        The ball may contain the first components only. g is then zero in the others.
        """
        g = theta_hat[: self.size] - self.center
        if others := rate.shape[0] - self.size:
            g = np.concatenate([g, np.zeros(others)])
        reach = self._reach(ON_THE_SPHERE)
        on_it = g @ g >= reach * reach
        gain_g = gain.times(g)
        outward = np.maximum(g @ rate, 0.0) / np.where(on_it, g @ gain_g, 1.0)
        return rate - gain_g * np.where(on_it, outward, 0.0)

    def limit(self, theta_hat: Value) -> Value:
        """Return the nearest point of the set, up to the last few bits."""
        g = theta_hat - self.center
        reach = self._reach(INSIDE_THE_SPHERE)
        outside = g @ g > reach * reach
        return np.where(outside, self.center + g * (reach / np.sqrt(np.where(outside, g @ g, 1.0))), theta_hat)

    def nearest(self, theta_hat: Value, gain: Gain) -> Value:
        """Return the nearest point of the set. The gain must be a scalar."""
        return self.limit(theta_hat)

    def _reach(self, slack: float) -> Value:
        """Return the radius minus ``slack`` times the magnitude of the subtracted numbers."""
        return self.radius - slack * (self.radius + np.sqrt(self.center @ self.center))

    def why_no_step(self, gain: Gain) -> str | None:
        """Return why there is no implicit step for such a gain, in whose metric the nearest point has no closed form."""
        return SCALAR_ONLY if gain.dimensions else None

    def kept_by_steps(self, size: int, *, leaking: bool) -> ParameterBall:
        """Return the set that an implicit step respects. With a leakage it is the concentric ball that also contains zero,
        towards which the leakage pulls."""
        return ParameterBall(center=self.center, radius=max(self.radius, math.hypot(*self.center) if leaking else 0.0))

    def implicit_step(self, theta: Value, gain: Gain, phi: Value, coupling: Value, error: Value) -> Value:
        """Return theta_next for a scalar gain.

        The distances from the centre along phi and across it are a/(mu + k) and b/mu with mu >= 1. mu = 1 is the step without a
        set, which is used with several inputs. Outside the sphere mu solves distance = radius. Newton's method on 1/distance,
        which is concave in mu, approaches the root from below and never passes it. Each iterate mu is the exact step for a larger
        ball. Source: More and Sorensen (1983), SIAM J. Sci. Stat. Comput. 4(3).
        """
        if phi.ndim == 2:
            return gain.implicit_step(theta, phi, coupling, error)
        gamma, from_centre = gain.value, theta - self.center
        squared = phi @ phi
        direction = phi / np.where(squared > 0, squared, 1.0)
        share = phi @ from_centre
        across = from_centre - direction * share
        along = direction * share + gamma * phi * (error + coupling * share)
        k = gamma * coupling * squared
        a, b = along @ along, across @ across
        # a lower bound: there, one of the two parts alone already has the length of the radius
        mu = np.maximum(1.0, np.sqrt(a) / self.radius - k)
        for _ in range(SPHERE_STEPS):
            distance = a / (mu + k) ** 2 + b / mu**2
            slope = a / (mu + k) ** 3 + b / mu**3
            missing = np.maximum(np.sqrt(distance) / self.radius - 1, 0.0)
            mu = mu + missing * distance / np.where(slope > 0, slope, 1.0)
        return self.center + along / (mu + k) + across / mu


BOX_ONLY = (
    "discretization = 'midpoint' takes a gain matrix and an unknown input gain together only with a box: give "
    "uncertainty.lower and .upper, a diagonal gain, or discretization = 'euler'"
)


@dataclass(frozen=True, eq=False)
class ParameterProduct:
    """The set of all theta in a ball, or of any theta, with each input gain in its interval. Both parts are projected separately.

    A box for theta does not occur here, because it forms one ``ParameterBox`` with the intervals (see ``with_gains``).
    """

    theta: ParameterBall | None  # None if nothing is known about theta, or if it is not projected
    gains: ParameterBox  # (m,) the last m of the estimates

    def __str__(self) -> str:
        theta = "" if self.theta is None else f"theta {self.theta}, "
        return f"{theta}the input gains {self.gains}"

    def parts(self, values: Value) -> tuple[Value, Value]:
        """Split all estimates into theta and the input gains."""
        theta = values.shape[0] - self.gains.size
        return values[:theta], values[theta:]

    def contains(self, values: Array) -> bool:
        theta, gains = self.parts(values)
        return self.gains.contains(gains) and (self.theta is None or self.theta.contains(theta))

    def reached_by(self, estimates: Array) -> bool:
        """Return whether one of the estimates (K, n) is at the boundary of its set."""
        theta, gains = np.split(estimates, [estimates.shape[1] - self.gains.size], axis=1)
        return self.gains.reached_by(gains) or (self.theta is not None and self.theta.reached_by(theta))

    @property
    def extent(self) -> tuple[Array, Array]:
        """The smallest and the largest value of each bounded component."""
        if self.theta is None:
            return self.gains.extent
        lower, upper = (np.concatenate(ends) for ends in zip(self.theta.extent, self.gains.extent, strict=True))
        return lower, upper

    def extreme_points(self, rng: np.random.Generator, most: int) -> Array:
        """Return points of the sphere with each end of every interval of the gains. Raises InputError if theta is not bounded."""
        gains = self.gains.extreme_points(rng, most)
        theta = self._bounded().extreme_points(rng, max(most // len(gains), 2 * self._bounded().size))
        return np.hstack([np.repeat(theta, len(gains), axis=0), np.tile(gains, (len(theta), 1))])

    def brought_in(self, points: Array) -> Array:
        """Return the points (M, n + m), with each point outside the set replaced by the nearest point of the set."""
        theta, gains = np.split(points, [points.shape[1] - self.gains.size], axis=1)
        return np.hstack([self._bounded().brought_in(theta), self.gains.brought_in(gains)])

    def _bounded(self) -> ParameterBall:
        if self.theta is None:
            raise InputError("theta is not bounded: give uncertainty.center and .radius")
        return self.theta

    def within(self, bound: Fraction) -> bool:
        """Return whether |theta|_2 + |omega|_1 <= bound in the whole set, in exact arithmetic. This is slightly stronger than
        |(theta, omega)|_2 <= bound."""
        bound = bound - sum((Fraction(value) for value in self.gains.upper.tolist()), Fraction(0))
        return bound >= 0 and (self.theta is None or self.theta.within(bound))

    def of_theta(self, count: int) -> ParameterBall | None:
        """Return the set of theta alone."""
        return self.theta

    @property
    def intervals(self) -> ParameterBox:
        """The intervals of the last components of the estimate."""
        return self.gains

    @property
    def sphere(self) -> ParameterBall | None:
        """The ball of the first components of the estimate."""
        return self.theta

    @property
    def bounds_theta(self) -> bool:
        """Whether theta is bounded."""
        return self.theta is not None

    @property
    def cuts_corners(self) -> bool:
        """Whether, with a gain matrix, the limit may cut off more than the proof allows, which happens if a ball is followed by
        one or two intervals."""
        return self.gains.cuts_corners or self.theta is not None

    @property
    def steps_cut_corners(self) -> bool:
        """Whether a step with a gain matrix may cut off more than the proof allows. There is no implicit step for such a gain."""
        return self.cuts_corners

    def project(self, rate: Value, theta_hat: Value, gain: Gain = UNIT_GAIN) -> Value:
        """Project the rate. A scalar or diagonal gain does not couple sphere and intervals; with a matrix the intervals are
        projected after the sphere."""
        first = rate.shape[0] - self.gains.size
        if gain.is_matrix:
            along = rate if self.theta is None else self.theta.project(rate, theta_hat, gain)
            return cone.onto_the_cone(along, theta_hat, self.gains, gain.value, first)
        theta = rate[:first]
        if self.theta is not None:
            theta = self.theta.project(theta, theta_hat[:first], gain.of_first(first))
        return np.concatenate([theta, self.gains.project(rate[first:], theta_hat[first:])])

    def limit(self, theta_hat: Value) -> Value:
        """Return the nearest point of the set, up to the last few bits for a ball."""
        theta, gains = self.parts(theta_hat)
        return np.concatenate([theta if self.theta is None else self.theta.limit(theta), self.gains.limit(gains)])

    def nearest(self, theta_hat: Value, gain: Gain) -> Value:
        """Return the nearest point of the set. The gain must not be a matrix."""
        return self.limit(theta_hat)

    def why_no_step(self, gain: Gain) -> str | None:
        """Return why there is no implicit step for such a gain."""
        if gain.is_matrix:
            return BOX_ONLY
        return None if self.theta is None else self.theta.why_no_step(gain)

    def kept_by_steps(self, size: int, *, leaking: bool) -> ParameterBox:
        """Return the set that an implicit step of ``size`` estimates respects, which are the intervals of the input gains."""
        lower, upper = (np.full(size, -UNREACHED_BOUND), np.full(size, UNREACHED_BOUND))
        lower[-self.gains.size :], upper[-self.gains.size :] = self.gains.extent
        return ParameterBox(lower=lower, upper=upper).kept_by_steps(size, leaking=leaking)
