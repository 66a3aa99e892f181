"""The known convex set of the unknown parameters: a box or a ball, and beside it the intervals of unknown input gains."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from barbalat import validate
from barbalat.protocols import Value
from barbalat.validate import Array, InputError

UNBOUNDED = 1e150
"""A bound that no run reaches: it has diverged long before."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ParameterBox:
    """The known convex set Omega = {lower <= theta <= upper}, componentwise.

    lower, upper  (p,) each, lower <= upper
    """

    lower: Array
    upper: Array
    faces: tuple[int, ...] = field(init=False, repr=False)
    """The components with a bound that a run can reach."""

    def __post_init__(self) -> None:
        lower = validate.vector("uncertainty.lower", self.lower)
        upper = validate.vector("uncertainty.upper", self.upper, len(lower))
        empty = np.flatnonzero(lower > upper)
        if len(empty):
            i = int(empty[0])
            raise InputError(
                f"uncertainty.lower must not exceed uncertainty.upper, but in component {i + 1} "
                f"{lower[i]:g} > {upper[i]:g}: the set is empty"
            )
        validate.freeze(self, lower=lower)
        validate.freeze(self, upper=upper)
        reached = np.minimum(np.abs(lower), np.abs(upper)) < UNBOUNDED
        object.__setattr__(self, "faces", tuple(np.flatnonzero(reached).tolist()))

    def __str__(self) -> str:
        return f"between {validate.show(self.lower)} and {validate.show(self.upper)}"

    @property
    def size(self) -> int:
        """The number of parameters."""
        return len(self.lower)

    def contains(self, theta: Array) -> bool:
        return bool((self.lower <= theta).all() and (theta <= self.upper).all())

    @property
    def extent(self) -> tuple[Array, Array]:
        """The least and the largest value of each component in the set."""
        return self.lower, self.upper

    @property
    def theta_max(self) -> float:
        """The largest 1-norm in the set."""
        return self.farthest_1(np.zeros(self.size))

    @property
    def middle(self) -> Array:
        """The set's centre, (n,)."""
        return np.asarray((self.lower + self.upper) / 2)

    def farthest_1(self, theta: Array) -> float:
        """The largest 1-norm of the difference between ``theta`` and a point of the set."""
        return float(np.maximum(np.abs(theta - self.lower), np.abs(self.upper - theta)).sum())

    def farthest(self, theta: Array) -> float:
        """The largest Euclidean distance from ``theta`` to a point of the set."""
        return float(np.linalg.norm(np.maximum(np.abs(theta - self.lower), np.abs(self.upper - theta))))


@dataclass(frozen=True, eq=False, kw_only=True)
class ParameterBall:
    """The known convex set Omega = {|theta - center|_2 <= radius}.

    center  (p,)
    radius  of the ball in the Euclidean norm, > 0
    """

    center: Array
    radius: float

    def __post_init__(self) -> None:
        validate.freeze(self, center=validate.vector("uncertainty.center", self.center))
        validate.freeze(self, radius=validate.positive("uncertainty.radius", self.radius))

    def __str__(self) -> str:
        return f"within {self.radius:g} of {validate.show(self.center)}"

    @property
    def size(self) -> int:
        """The number of parameters."""
        return len(self.center)

    def contains(self, theta: Array) -> bool:
        return bool(math.hypot(*(theta - self.center)) <= self.radius)

    @property
    def extent(self) -> tuple[Array, Array]:
        """The least and the largest value of each component in the set."""
        return self.center - self.radius, self.center + self.radius

    @property
    def theta_max(self) -> float:
        """The largest 1-norm in the set: |center|_1 + radius sqrt(n), where every component moves outward alike."""
        return self.farthest_1(np.zeros(self.size))

    @property
    def middle(self) -> Array:
        """The set's centre, (n,)."""
        return self.center

    def farthest_1(self, theta: Array) -> float:
        """The largest 1-norm of the difference between ``theta`` and a point of the set."""
        return float(np.abs(self.center - theta).sum() + self.radius * math.sqrt(self.size))

    def farthest(self, theta: Array) -> float:
        """The largest Euclidean distance from ``theta`` to a point of the set."""
        return math.hypot(*(theta - self.center)) + self.radius


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


KnownSet: TypeAlias = ParameterBox | ParameterBall
"""What theta can be projected onto."""

EstimateSet: TypeAlias = KnownSet | ParameterProduct
"""What an estimate can be projected onto: of theta, or of theta and the input gains."""


def with_gains(theta: KnownSet | None, gains: ParameterBox | None) -> EstimateSet | None:
    """The set of all that is estimated; ``None`` for no set and no unknown gains."""
    if gains is None:
        return theta
    if isinstance(theta, ParameterBox):
        return ParameterBox(lower=np.concatenate([theta.lower, gains.lower]), upper=np.concatenate([theta.upper, gains.upper]))
    return ParameterProduct(theta, gains)
