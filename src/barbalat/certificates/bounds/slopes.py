"""Guaranteed bounds of a formula f(t, y) and of its slope in y over an interval, in ball arithmetic with derivatives."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from flint import arb

from barbalat.linear.enclosure import float_above, float_below, power
from barbalat.problem.output_plant import Nonlinearity

SLOPE_PIECES = 256
"""Of the interval of y: on each the slope is enclosed; a bound is too wide by about the slope's own change over a piece."""


@dataclass(frozen=True)
class Slope:
    """A value and its derivative with respect to y, both as balls."""

    value: arb
    slope: arb

    def _chain(self, value: arb, derivative: arb) -> Slope:
        return Slope(value, derivative * self.slope)

    def __add__(self, other: Any) -> Slope:
        other = _as_slope(other)
        return Slope(self.value + other.value, self.slope + other.slope)

    def __mul__(self, other: Any) -> Slope:
        other = _as_slope(other)
        return Slope(self.value * other.value, self.slope * other.value + self.value * other.slope)

    def __neg__(self) -> Slope:
        return Slope(-self.value, -self.slope)

    def __sub__(self, other: Any) -> Slope:
        return self.__add__(-_as_slope(other))

    def __rsub__(self, other: Any) -> Slope:
        return _as_slope(other).__sub__(self)

    def __truediv__(self, other: Any) -> Slope:
        other = _as_slope(other)
        return self.__mul__(other._chain(1 / other.value, -1 / (other.value * other.value)))

    def __rtruediv__(self, other: Any) -> Slope:
        return _as_slope(other).__truediv__(self)

    def __pow__(self, exponent: float) -> Slope:
        if not float(exponent).is_integer():
            return self._chain(self.value ** arb(exponent), exponent * self.value ** arb(exponent - 1))
        whole = int(exponent)
        return self._chain(power(self.value, whole), whole * power(self.value, whole - 1)) if whole else Slope(arb(1), arb(0))

    __radd__, __rmul__ = __add__, __mul__

    def __abs__(self) -> Slope:
        side = arb(1) if self.value > 0 else arb(-1) if self.value < 0 else arb(0, 1)
        return self._chain(abs(self.value), side)

    def exp(self) -> Slope:
        value = self.value.exp()
        return self._chain(value, value)

    def sin(self) -> Slope:
        return self._chain(self.value.sin(), self.value.cos())

    def cos(self) -> Slope:
        return self._chain(self.value.cos(), -self.value.sin())

    def sqrt(self) -> Slope:
        value = self.value.sqrt()
        return self._chain(value, 1 / (2 * value))

    def tanh(self) -> Slope:
        value = self.value.tanh()
        return self._chain(value, 1 - value * value)


def _as_slope(value: Any) -> Slope:
    return value if isinstance(value, Slope) else Slope(arb(value), arb(0))


def largest_slope(f: Nonlinearity, radius: float, t_end: float) -> float:
    """An upper bound of |df/dy| for |y| <= radius and 0 <= t <= t_end; infinite where none is found."""
    width = arb(radius) / SLOPE_PIECES
    return max(_above(_at(f, arb(0, 1) * width + (2 * k + 1 - SLOPE_PIECES) * width, t_end).slope) for k in range(SLOPE_PIECES))


def steepest_seen(f: Nonlinearity, radius: float) -> float:
    """A lower bound of the largest |df/dy| over |y| <= radius, taken at t = 0 and 65 points: no Lipschitz constant is below."""
    points = [radius * k / 32 for k in range(-32, 33)]
    slopes = [_at(f, arb(y), 0.0).slope for y in points]
    return max((float_below(abs(slope).abs_lower()) for slope in slopes if slope.is_finite()), default=math.inf)


def largest_at_zero(f: Nonlinearity, t_end: float) -> float:
    """An upper bound of |f(t, 0)| for 0 <= t <= t_end; infinite where none is found."""
    return _above(_at(f, arb(0), t_end).value)


def _at(f: Nonlinearity, y: arb, t_end: float) -> Slope:
    half = arb(t_end) / 2
    return _as_slope(f.at(y=Slope(y, arb(1)), t=Slope(half + arb(0, 1) * half, arb(0))))


def _above(value: arb) -> float:
    return float_above(abs(value)) if value.is_finite() else math.inf
