"""Guaranteed bounds on formulas in ball arithmetic: on |phi(x)| over a box of states, on f(t, y), and on its slope in y."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from flint import arb

from barbalat.linear.balls import Ball, as_arb
from barbalat.linear.enclosure import float_above, float_below, power
from barbalat.problem.output_feedback import Nonlinearity
from barbalat.problem.regressors import Linear, Regressor
from barbalat.validate import Array

TIGHTNESS_RATIO = 1.05
"""The bound is at most this multiple of the largest value found, unless MOST_CUTS are insufficient."""
MOST_CUTS = 400
"""Largest number of cuts of the box; the bound is valid after any number of cuts."""
CORNER_STATES = 8
"""Number of states up to which the largest value is also sought at the corners of a box; with more states, only the centre is
tried."""


def largest_square(regressor: Regressor, low: Array, high: Array) -> float:
    """An upper bound on |phi(x)|_2^2 over low <= x <= high, each (n,); infinite if ball arithmetic gives none."""
    if isinstance(regressor, Linear):
        return float(np.sum(np.maximum(np.abs(low), np.abs(high)) ** 2)) * (1 + 1e-12)
    seen = _seen(regressor, low, high)
    boxes = [(-_above(regressor, low, high), 0, low, high)]
    for count in range(1, MOST_CUTS + 1):
        if not -boxes[0][0] > TIGHTNESS_RATIO * seen:
            break
        _, _, low, high = heapq.heappop(boxes)
        side = int(np.argmax(high - low))
        middle = (low[side] + high[side]) / 2
        for k, (at, end) in enumerate(((low, np.where(np.arange(len(low)) == side, middle, high)),
                                       (np.where(np.arange(len(low)) == side, middle, low), high))):  # fmt: skip
            seen = max(seen, _seen(regressor, at, end))
            heapq.heappush(boxes, (-_above(regressor, at, end), 2 * count + k, at, end))
    return -boxes[0][0]


def _above(regressor: Regressor, low: Array, high: Array) -> float:
    x = np.empty(len(low), dtype=object)
    for i, (a, b) in enumerate(zip(low.tolist(), high.tolist(), strict=True)):
        x[i] = Ball(arb(a).union(arb(b)))
    total = arb(0)
    for entry in regressor(x):
        total += power(as_arb(entry), 2)
    return float_above(total) if total.is_finite() else float("inf")


def _seen(regressor: Regressor, low: Array, high: Array) -> float:
    points = [(low + high) / 2]
    if len(low) <= CORNER_STATES:
        points += [np.where(choice, high, low) for choice in product((False, True), repeat=len(low))]
    with np.errstate(all="ignore"):  # a point where phi is not a number gives no information
        squares = [float(np.sum(np.asarray(regressor(point), dtype=float) ** 2)) for point in points]
    return max([0.0, *(square for square in squares if not np.isnan(square))])


SLOPE_PIECES = 256
"""Pieces of the interval of y: the slope is enclosed on each piece, so a bound is too wide by about the change of the slope over
a piece."""


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
    """An upper bound on |df/dy| for |y| <= radius and 0 <= t <= t_end; infinite if none is found."""
    width = arb(radius) / SLOPE_PIECES
    return max(
        _float_above(_at(f, arb(0, 1) * width + (2 * k + 1 - SLOPE_PIECES) * width, t_end).slope) for k in range(SLOPE_PIECES)
    )


def steepest_seen(f: Nonlinearity, radius: float) -> float:
    """A lower bound on max |df/dy| over |y| <= radius, from 65 points at t = 0; every Lipschitz constant is at least as large."""
    points = [radius * k / 32 for k in range(-32, 33)]
    slopes = [_at(f, arb(y), 0.0).slope for y in points]
    return max((float_below(abs(slope).abs_lower()) for slope in slopes if slope.is_finite()), default=math.inf)


def largest_at_zero(f: Nonlinearity, t_end: float) -> float:
    """An upper bound on |f(t, 0)| for 0 <= t <= t_end; infinite if none is found."""
    return _float_above(_at(f, arb(0), t_end).value)


def _at(f: Nonlinearity, y: arb, t_end: float) -> Slope:
    half = arb(t_end) / 2
    return _as_slope(f.at(y=Slope(y, arb(1)), t=Slope(half + arb(0, 1) * half, arb(0))))


def _float_above(value: arb) -> float:
    return float_above(abs(value)) if value.is_finite() else math.inf
