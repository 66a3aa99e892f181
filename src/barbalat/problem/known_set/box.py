"""A box as the known set of the parameters or of the input gains."""

from __future__ import annotations

import itertools
import math
from dataclasses import KW_ONLY, dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from barbalat import validate
from barbalat.problem.known_set import cone
from barbalat.problem.known_set.gain import UNIT_GAIN, Gain, quadratic
from barbalat.protocols import Value
from barbalat.settings import Settings
from barbalat.validate import Array, InputError

if TYPE_CHECKING:
    from barbalat.problem.known_set.ball import ParameterBall

UNREACHED_BOUND = 1e150
"""A bound that no run reaches, because the run diverges long before."""

MOST_GUESSES = 4
"""Number of guesses, with several inputs, of the components that end on a face. The step uses the guess that is correct."""

AGREEMENT_TOLERANCE = 2.0**-36
"""Largest relative residual of a correct guess in the equations, a few thousand rounding errors."""


@dataclass(frozen=True, eq=False)
class ParameterBox(Settings):
    """The known convex set Omega = {lower <= theta <= upper}, componentwise.

    lower, upper  (p,) each, lower <= upper; with m inputs also (p, m), as theta
    """

    lower: Array
    upper: Array
    _: KW_ONLY
    faces: tuple[int, ...] = field(init=False, repr=False)
    """The components with a bound that a run can reach."""

    first_field: ClassVar[str] = "lower"
    fills_its_extent: ClassVar[bool] = True
    sphere: ClassVar[ParameterBall | None] = None
    bounds_theta: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if validate.dimensions(self.lower) == validate.dimensions(self.upper) == 2:
            validate.array("uncertainty.upper", self.upper, np.shape(self.lower))
        lower = validate.by_rows("uncertainty.lower", self.lower)
        upper = validate.by_rows("uncertainty.upper", self.upper, len(lower))
        empty = np.flatnonzero(lower > upper)
        if len(empty):
            i = int(empty[0])
            raise InputError.of(
                "uncertainty.lower",
                f"must not exceed uncertainty.upper, but component {i + 1} has {lower[i]:g} > {upper[i]:g}: the set is empty",
            )
        validate.freeze(self, lower=lower)
        validate.freeze(self, upper=upper)
        reached = np.minimum(np.abs(lower), np.abs(upper)) < UNREACHED_BOUND
        object.__setattr__(self, "faces", tuple(np.flatnonzero(reached).tolist()))

    def __str__(self) -> str:
        return f"between {validate.show(self.lower)} and {validate.show(self.upper)}"

    @property
    def size(self) -> int:
        """The number of parameters."""
        return len(self.lower)

    def contains(self, theta: Array) -> bool:
        return bool((self.lower <= theta).all() and (theta <= self.upper).all())

    def reached_by(self, estimates: Array) -> bool:
        """Return whether one of the estimates (K, n) is at the set's boundary."""
        return bool(((estimates <= self.lower) | (estimates >= self.upper)).any())

    def within(self, bound: Fraction) -> bool:
        """Return whether |theta|_2 <= bound for every theta in the set, in exact arithmetic."""
        farthest = np.maximum(np.abs(self.lower), np.abs(self.upper))
        return sum((Fraction(value) ** 2 for value in farthest.tolist()), Fraction(0)) <= bound**2

    @property
    def extent(self) -> tuple[Array, Array]:
        """The smallest and the largest value of each component in the set."""
        return self.lower, self.upper

    @property
    def theta_max(self) -> float:
        """The largest 1-norm in the set, rounded up unless the sum is exactly a float."""
        largest = np.maximum(np.abs(self.lower), np.abs(self.upper))
        exact = sum((Fraction(value) for value in largest.tolist()), Fraction(0))
        nearest = float(exact)
        return nearest if Fraction(nearest) >= exact else math.nextafter(nearest, math.inf)

    @property
    def middle(self) -> Array:
        """The set's centre (n,)."""
        return np.asarray((self.lower + self.upper) / 2)

    def farthest_1(self, theta: Array) -> float:
        """Return the largest 1-norm of the difference between ``theta`` and a point of the set."""
        return float(np.maximum(np.abs(theta - self.lower), np.abs(self.upper - theta)).sum())

    def farthest(self, theta: Array, weights: Array | float = 1.0) -> float:
        """Return the largest Euclidean distance from ``theta`` to a point of the set, with squares weighted by ``weights``
        (p,)."""
        return float(np.linalg.norm(np.sqrt(weights) * np.maximum(np.abs(theta - self.lower), np.abs(self.upper - theta))))

    def extreme_points(self, rng: np.random.Generator, most: int) -> Array:
        """Return the vertices, or ``most`` randomly drawn ones."""
        if 2**self.size <= most:
            signs = np.array(list(itertools.product((0.0, 1.0), repeat=self.size)))
        else:
            signs = rng.integers(0, 2, (most, self.size)).astype(float)
        return np.asarray(self.lower + signs * (self.upper - self.lower))

    def drawn(self, rng: np.random.Generator, count: int) -> Array:
        """Return uniformly distributed points of the set (count, n)."""
        return rng.uniform(self.lower, self.upper, (count, self.size))

    def brought_in(self, points: Array) -> Array:
        """Return the points (M, n), with each point outside the set replaced by the nearest point of the set."""
        return np.clip(points, self.lower, self.upper)

    def with_gains(self, gains: ParameterBox) -> ParameterBox:
        """Return the set of these parameters followed by the input gains."""
        return ParameterBox(lower=np.concatenate([self.lower, gains.lower]), upper=np.concatenate([self.upper, gains.upper]))

    @property
    def intervals(self) -> ParameterBox:
        """The intervals of the last estimates; here these are all estimates."""
        return self

    def of_theta(self, count: int) -> ParameterBox:
        """Return the set of theta alone, whose components come first."""
        return self if count == self.size else ParameterBox(lower=self.lower[:count], upper=self.upper[:count])

    def over(self, gains: ParameterBox) -> ParameterBox:
        """Return the smallest box that contains theta/omega for every theta in this box and every omega > 0 in the interval."""
        ends = np.stack([self.lower / gains.lower, self.lower / gains.upper, self.upper / gains.lower, self.upper / gains.upper])
        return ParameterBox(lower=ends.min(axis=0), upper=ends.max(axis=0))

    def last(self, count: int) -> ParameterBox:
        """Return the box of the last components alone."""
        return ParameterBox(lower=self.lower[-count:], upper=self.upper[-count:])

    @property
    def cuts_corners(self) -> bool:
        """Whether, with a gain matrix, the limit in a corner may cut off more than the proof of V' <= 0 allows."""
        return len(self.faces) > cone.EXACT_FACES

    @property
    def steps_cut_corners(self) -> bool:
        """Whether ``nearest``, at the end of a step over a sample, may cut off more than the proof of V' <= 0 allows."""
        exact = (
            cone.EXACT_FACES_OF_STEPS if self.size == cone.EXACT_FACES_OF_STEPS else 1
        )  # of two faces only if nothing else moves
        return len(self.faces) > exact

    def project(self, rate: Value, theta_hat: Value, gain: Gain = UNIT_GAIN) -> Value:
        """Project the rate. A component on a face does not move outward, and with a gain matrix this changes the others too."""
        if gain.is_matrix:
            return cone.onto_the_cone(rate, theta_hat, self, gain.value)
        highest = np.where(theta_hat >= self.upper, 0.0, np.inf)
        lowest = np.where(theta_hat <= self.lower, 0.0, -np.inf)
        return np.maximum(np.minimum(rate, highest), lowest)

    def limit(self, theta_hat: Value) -> Value:
        """Return the nearest point of the set."""
        return np.clip(theta_hat, self.lower, self.upper)

    def nearest(self, theta_hat: Value, gain: Gain) -> Value:
        """Return a point of the set that is no farther than ``theta_hat`` from any point of the set in the metric Gamma^-1."""
        return self.limit(cone.nearest(theta_hat, self, gain.value) if gain.is_matrix else theta_hat)

    def why_no_step(self, gain: Gain) -> str | None:
        """Return None, because there is an implicit step for every gain."""
        return None

    def kept_by_steps(self, size: int, *, leaking: bool) -> ParameterBox:
        """Return the set that an implicit step respects. With a leakage it is the smallest box that also contains zero, towards
        which the leakage pulls."""
        if not leaking:
            return ParameterBox(lower=self.lower, upper=self.upper)
        return ParameterBox(lower=np.minimum(self.lower, 0.0), upper=np.maximum(self.upper, 0.0))

    def implicit_step(self, theta: Value, gain: Gain, phi: Value, coupling: Value, error: Value) -> Value:
        """Return theta_next for a scalar or diagonal gain. With one input theta_next = limit(theta + Gamma phi s).

        As |s| grows from zero, component i of the estimate moves at gamma_i |phi_i| until it reaches its bound at the distance
        room_i. Therefore |error| = |s| + K sum_i |phi_i| min(gamma_i |phi_i| |s|, room_i). The right side is concave and
        piecewise linear in |s|, so it is the minimum of its lines, and |s| is the largest of their roots. The lines differ in the
        components that have reached their bound, which happens one after another.
        """
        if phi.ndim == 2:
            return self._step_of_several_inputs(theta, gain, phi, coupling, error)
        size = np.abs(phi)
        rate = gain.value * size
        room = np.where(error * phi > 0, self.upper - theta, theta - self.lower)
        largest = np.abs(error) / (1 + coupling * quadratic(size, rate))
        for j in range(self.size):
            arrived = np.where(room * rate[j] <= room[j] * rate, 1.0, 0.0)
            line = np.abs(error) - coupling * ((arrived * room) @ size)
            largest = np.maximum(largest, line / (1 + coupling * quadratic(size, (1 - arrived) * rate)))
        return self.limit(theta + gain.times(phi) * np.where(error > 0, largest, -largest))

    def _step_of_several_inputs(self, theta: Value, gain: Gain, phi: Value, coupling: Value, error: Value) -> Value:
        """Return the step for several inputs. If the components that end on a face are guessed correctly, s solves a linear
        system; otherwise the step ignores the set."""
        inputs, moves = phi.shape[1], gain.as_matrix(phi.shape[0]) @ phi
        free = gain.implicit_step(theta, phi, coupling, error)
        wanted = free
        for _ in range(MOST_GUESSES):
            inside = np.where(self.limit(wanted) == wanted, 1.0, 0.0)
            moved = (1 - inside) * (self.limit(wanted) - theta)
            system = np.eye(inputs) + coupling @ ((phi * inside.reshape(-1, 1)).T @ moves)
            s = np.linalg.solve(system, error - coupling @ (phi.T @ moved))
            wanted = theta + moves @ s
        found = self.limit(wanted)
        left = error - coupling @ (phi.T @ (found - theta)) - s
        solved = left @ left <= AGREEMENT_TOLERANCE**2 * (s @ s + error @ error)
        return np.where(solved, found, free)
