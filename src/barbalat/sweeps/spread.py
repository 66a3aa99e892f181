"""The values of a varied number, on the axis of a grid or from a distribution."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from barbalat import validate
from barbalat.validate import Array, InputError

SMALLEST_SHARE, LARGEST_SHARE = 2.0**-54, 1 - 2.0**-53
"""Limits of the probability below a drawn value: 0 and 1 would be the infinite ends of a normal distribution."""
MOST_VALUES = 10**7
"""Largest number of values of an axis: all of them are kept, which takes 80 MB."""


@dataclass(frozen=True)
class Axis:
    """``count`` values from ``start`` to ``stop``, equally spaced, or equally spaced in the logarithm if requested."""

    start: float
    stop: float
    count: int
    logarithmic: bool = False

    def __post_init__(self) -> None:
        validate.number("START", self.start)
        validate.number("STOP", self.stop)
        validate.number("STOP - START", self.stop - self.start)
        validate.whole("COUNT", self.count, least=1, most=MOST_VALUES)
        if self.logarithmic and (self.start <= 0 or self.stop <= 0):
            raise InputError(f"START and STOP must be positive for log, got {self.start:g} and {self.stop:g}")
        if self.count > 1 and self.start == self.stop:
            raise InputError(f"START and STOP must differ for {self.count} values, but both are {self.start:g}")

    @classmethod
    def parse(cls, text: str) -> Axis:
        """An axis as START:STOP:COUNT[:log]; raises InputError for a different text."""
        parts = text.split(":")
        if len(parts) not in (3, 4) or (len(parts) == 4 and parts[3] != "log"):
            raise InputError(f"a range must be START:STOP:COUNT or START:STOP:COUNT:log, got {validate.show(text)}")
        try:
            start, stop, count = float(parts[0]), float(parts[1]), int(parts[2])
        except ValueError:
            raise InputError(f"START and STOP must be numbers and COUNT an integer, got {validate.show(text)}") from None
        return cls(start, stop, count, len(parts) == 4)

    @property
    def values(self) -> Array:
        """The values (count,), with both ends exact."""
        spaced = np.geomspace if self.logarithmic else np.linspace
        return np.asarray(spaced(self.start, self.stop, self.count))

    def __str__(self) -> str:
        return f"{self.start!r}:{self.stop!r}:{self.count}{':log' if self.logarithmic else ''}"


class Distribution(Protocol):
    """The distribution of a number."""

    def at(self, share: Array, before: Sequence[Array] = ()) -> Array:
        """The quantiles at these fractions, given the numbers drawn ``before``."""
        ...


@dataclass(frozen=True)
class Uniform:
    """From ``low`` to ``high``."""

    low: float
    high: float

    def __post_init__(self) -> None:
        _require_range("uniform", self.low, self.high)

    def at(self, share: Array, before: Sequence[Array] = ()) -> Array:
        return np.clip(self.low + (self.high - self.low) * share, self.low, self.high)  # rounding must not leave the range

    def __str__(self) -> str:
        return f"uniform:{self.low!r}:{self.high!r}"


@dataclass(frozen=True)
class LogUniform:
    """From ``low`` to ``high``, uniform in the logarithm."""

    low: float
    high: float

    def __post_init__(self) -> None:
        _require_range("loguniform", self.low, self.high)
        if self.low <= 0:
            raise InputError(f"loguniform needs positive limits, got {self.low:g}")

    def at(self, share: Array, before: Sequence[Array] = ()) -> Array:
        low, high = math.log(self.low), math.log(self.high)
        return np.clip(np.exp(low + (high - low) * share), self.low, self.high)

    def __str__(self) -> str:
        return f"loguniform:{self.low!r}:{self.high!r}"


@dataclass(frozen=True)
class Normal:
    """The normal distribution, by its mean and its standard deviation."""

    mean: float
    deviation: float

    def __post_init__(self) -> None:
        validate.number("normal's mean", self.mean)
        validate.positive("normal's standard deviation", self.deviation)

    def at(self, share: Array, before: Sequence[Array] = ()) -> Array:
        from scipy.special import ndtri

        return np.asarray(self.mean + self.deviation * ndtri(share))

    def __str__(self) -> str:
        return f"normal:{self.mean!r}:{self.deviation!r}"


@dataclass(frozen=True)
class CutNormal:
    """Normal around the middle of ``low`` to ``high``, truncated at the ends, which are three standard deviations from the
    middle."""

    low: float
    high: float

    def at(self, share: Array, before: Sequence[Array] = ()) -> Array:
        from scipy.special import ndtr, ndtri

        inside = ndtr(-3.0) + (1 - 2 * ndtr(-3.0)) * share
        middle, deviation = (self.low + self.high) / 2, (self.high - self.low) / 6
        return np.clip(middle + deviation * ndtri(inside), self.low, self.high)

    def __str__(self) -> str:
        return f"normal between:{self.low!r}:{self.high!r}"


@dataclass(frozen=True)
class InBall:
    """An entry of a vector that is uniform in a ball, given the entries drawn before it.

    The remaining section of the ball is a ball of fewer dimensions. Along one axis of a d-dimensional ball the density of t in
    [-1, 1] is proportional to (1 - t^2)^((d - 1)/2), a beta distribution (Rosenblatt's transformation).
    """

    center: tuple[float, ...]
    radius: float
    place: int

    def at(self, share: Array, before: Sequence[Array] = ()) -> Array:
        from scipy.special import betaincinv

        entries = before[len(before) - self.place :]
        away = sum(((entry - c) ** 2 for entry, c in zip(entries, self.center, strict=False)), np.zeros(len(share)))
        left = np.sqrt(np.maximum(self.radius**2 - away, 0.0))
        shape = (len(self.center) - self.place + 1) / 2
        return np.asarray(self.center[self.place] + SHARE_OF_RADIUS * left * (2 * betaincinv(shape, shape, share) - 1))

    def __str__(self) -> str:
        return f"ball:{list(self.center)!r}:{self.radius!r}, entry {self.place + 1}"


SHARE_OF_RADIUS = 1 - 2.0**-40
"""Fraction of a ball's radius to which draws are limited, so that every draw is inside despite rounding."""

DISTRIBUTIONS: dict[str, type[Uniform] | type[LogUniform] | type[Normal]] = {
    "uniform": Uniform,
    "normal": Normal,
    "loguniform": LogUniform,
}


def parse_distribution(text: str) -> Distribution:
    """uniform:A:B, normal:MEAN:DEVIATION or loguniform:A:B."""
    name, *numbers = text.split(":")
    if name not in DISTRIBUTIONS or len(numbers) != 2:
        raise InputError(
            "a distribution must be uniform:A:B, normal:MEAN:DEVIATION or loguniform:A:B, "
            f"or known-set for plant.theta and similar, or between for parameters, got {validate.show(text)}"
        )
    try:
        first, second = map(float, numbers)
    except ValueError:
        raise InputError(f"a distribution's parameters must be numbers, got {validate.show(text)}") from None
    return DISTRIBUTIONS[name](first, second)


def _require_range(name: str, low: float, high: float) -> None:
    validate.number(f"{name}'s lower limit", low)
    validate.number(f"{name}'s upper limit", high)
    if low >= high:
        raise InputError(f"{name}'s lower limit must be below its upper limit, got {low:g} and {high:g}")
    validate.number(f"{name}'s width", high - low)
