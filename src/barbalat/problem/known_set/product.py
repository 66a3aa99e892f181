"""A ball of theta, or nothing known of it, with an interval for each unknown input gain."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from barbalat.problem.known_set import cone
from barbalat.problem.known_set.ball import ParameterBall
from barbalat.problem.known_set.box import UNREACHED_BOUND, ParameterBox
from barbalat.problem.known_set.gain import UNIT_GAIN, Gain
from barbalat.protocols import Value
from barbalat.validate import Array

BOX_ONLY = (
    "discretization = 'midpoint' takes a gain matrix and an unknown input gain together only with a box: give "
    "uncertainty.lower and .upper, a diagonal gain, or discretization = 'euler'"
)


@dataclass(frozen=True, eq=False)
class ParameterProduct:
    """Every theta in a ball, or any theta at all, with every input gain in its interval: two sets, each with its own projection.

    A box of theta is no factor here: with the intervals it is one ``ParameterBox``, see ``with_gains``.
    """

    theta: ParameterBall | None  # None where nothing is known of theta, or it is not to be projected
    gains: ParameterBox  # (m,) the last m of what is estimated

    def __str__(self) -> str:
        theta = "" if self.theta is None else f"theta {self.theta}, "
        return f"{theta}the input gains {self.gains}"

    def parts(self, values: Value) -> tuple[Value, Value]:
        """theta and the input gains of all that is estimated."""
        theta = values.shape[0] - self.gains.size
        return values[:theta], values[theta:]

    def contains(self, values: Array) -> bool:
        theta, gains = self.parts(values)
        return self.gains.contains(gains) and (self.theta is None or self.theta.contains(theta))

    def reached_by(self, estimates: Array) -> bool:
        """Whether one of the estimates (K, n) is at the boundary of its set."""
        theta, gains = np.split(estimates, [estimates.shape[1] - self.gains.size], axis=1)
        return self.gains.reached_by(gains) or (self.theta is not None and self.theta.reached_by(theta))

    @property
    def extent(self) -> tuple[Array, Array]:
        """The least and the largest value of each component that the set bounds."""
        if self.theta is None:
            return self.gains.extent
        lower, upper = (np.concatenate(ends) for ends in zip(self.theta.extent, self.gains.extent, strict=True))
        return lower, upper

    def within(self, bound: Fraction) -> bool:
        """Whether |theta|_2 + |omega|_1 <= bound throughout, in exact arithmetic: a little more than |(theta, omega)|_2 asks."""
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
        """Whether anything is known of theta."""
        return self.theta is not None

    @property
    def cuts_corners(self) -> bool:
        """Whether with a gain matrix the limit may cut off what does not keep the proof: one or two intervals follow a ball."""
        return self.gains.cuts_corners or self.theta is not None

    @property
    def steps_cut_corners(self) -> bool:
        """The same: a gain matrix has no implicit step here."""
        return self.cuts_corners

    def project(self, rate: Value, theta_hat: Value, gain: Gain = UNIT_GAIN) -> Value:
        """A scalar or diagonal gain does not couple sphere and intervals; with a matrix the intervals follow the sphere."""
        first = rate.shape[0] - self.gains.size
        if gain.is_matrix:
            along = rate if self.theta is None else self.theta.project(rate, theta_hat, gain)
            return cone.onto_the_cone(along, theta_hat, self.gains, gain.value, first)
        theta = rate[:first]
        if self.theta is not None:
            theta = self.theta.project(theta, theta_hat[:first], gain.of_first(first))
        return np.concatenate([theta, self.gains.project(rate[first:], theta_hat[first:])])

    def limit(self, theta_hat: Value) -> Value:
        """The nearest point of the set, up to the last few bits for a ball."""
        theta, gains = self.parts(theta_hat)
        return np.concatenate([theta if self.theta is None else self.theta.limit(theta), self.gains.limit(gains)])

    def nearest(self, theta_hat: Value, gain: Gain) -> Value:
        """The same: no gain matrix is asked for."""
        return self.limit(theta_hat)

    def why_no_step(self, gain: Gain) -> str | None:
        """Why no implicit step is known for such a gain."""
        if gain.is_matrix:
            return BOX_ONLY
        return None if self.theta is None else self.theta.why_no_step(gain)

    def kept_by_steps(self, size: int, *, leaking: bool) -> ParameterBox:
        """What an implicit step of ``size`` estimates keeps to: the intervals of the input gains."""
        lower, upper = (np.full(size, -UNREACHED_BOUND), np.full(size, UNREACHED_BOUND))
        lower[-self.gains.size :], upper[-self.gains.size :] = self.gains.extent
        return ParameterBox(lower=lower, upper=upper).kept_by_steps(size, leaking=leaking)
