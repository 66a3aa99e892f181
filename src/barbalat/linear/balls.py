"""Numbers with an error radius, with which NumPy functions and parsed formulas can compute."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from flint import arb

from barbalat.linear.enclosure import power
from barbalat.validate import Array

BELOW_ZERO = 2.0**-28
"""How far a ball of nonnegative numbers may extend below zero, relative to its centre, because a radius has only 30 bits."""


@dataclass(frozen=True, eq=False)
class Ball:
    """A number with an error radius (python-flint's arb), with which NumPy functions and formulas can compute."""

    value: arb

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any) -> Any:
        """Use NumPy's functions on arrays of objects through the objects' methods and operators."""
        return getattr(ufunc, method)(*(part.reshape() if isinstance(part, Ball) else part for part in inputs))

    def reshape(self, *shape: int) -> Array:
        alone = np.empty(shape, dtype=object)
        alone.fill(self)
        return alone

    def __add__(self, other: Any) -> Ball:
        return Ball(self.value + as_arb(other))

    def __mul__(self, other: Any) -> Ball:
        return self**2 if other is self else Ball(self.value * as_arb(other))

    def __neg__(self) -> Ball:
        return Ball(-self.value)

    def __sub__(self, other: Any) -> Ball:
        return Ball(self.value - as_arb(other))

    def __rsub__(self, other: Any) -> Ball:
        return Ball(as_arb(other) - self.value)

    def __truediv__(self, other: Any) -> Ball:
        return Ball(self.value / as_arb(other))

    def __rtruediv__(self, other: Any) -> Ball:
        return Ball(as_arb(other) / self.value)

    def __pow__(self, exponent: float) -> Ball:
        whole = float(exponent).is_integer()
        if whole and exponent > 0 and exponent % 2 == 0:  # the ends of |value| keep it nonnegative
            return Ball((self.value.abs_lower() ** int(exponent)).union(self.value.abs_upper() ** int(exponent)))
        return Ball(power(self.value, int(exponent)) if whole else self.value ** as_arb(exponent))

    def __abs__(self) -> Ball:
        return Ball(self.value.abs_lower().union(self.value.abs_upper()))

    __radd__, __rmul__ = __add__, __mul__

    def sqrt(self) -> Ball:
        """The square root; unbounded if the number may be negative, except that the ball of an absolute value may extend below
        zero by rounding."""
        if self.value.lower() < -BELOW_ZERO * self.value.abs_upper():
            return Ball(arb(0, math.inf))
        return Ball(arb(0).max(self.value.lower()).sqrt().union(arb(0).max(self.value.upper()).sqrt()))


for _name in ("exp", "sin", "cos", "tanh"):  # NumPy calls the method with the function's name
    setattr(Ball, _name, lambda self, name=_name: Ball(getattr(self.value, name)()))


def as_arb(value: Any) -> arb:
    """The ball of a number; a ball is returned unchanged."""
    return value.value if isinstance(value, Ball) else arb(float(value))
