"""Rational functions with exact coefficients. The code of a law is evaluated with them instead of with numbers.

A binary64 number in the code has its exact value. sin, cos, exp, tanh, arctan and abs are replaced by free variables: a statement
that holds for all their values holds for the function.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any, NoReturn

import numpy as np
from flint import Ordering, fmpq, fmpq_mpoly, fmpq_mpoly_ctx

FREE = 96
"""Number of spare variables, for functions of other variables and for the terms that projections subtract."""


class NotRational(ValueError):
    """The code is not a rational function: it branches on a value, or uses a different function."""


class Ring:
    """The variables by name, and the functions of variables."""

    def __init__(self, names: list[str]) -> None:
        self.names = names
        self.context = fmpq_mpoly_ctx.get([*(f"v{i}" for i in range(len(names) + FREE))], Ordering.degrevlex)
        self.variables = [Rational(self, one, self.context.constant(1)) for one in self.context.gens()]
        self.functions: dict[int, tuple[str, Rational]] = {}
        self._taken = len(names)

    def constant(self, value: fmpq) -> Rational:
        return Rational(self, self.context.constant(value), self.context.constant(1))

    def array(self, start: int, shape: tuple[int, ...]) -> Any:
        """The variables from ``start`` on, in an array; a scalar shape gives the variable itself."""
        if shape == ():
            return self.variables[start]
        return np.array(self.variables[start : start + math.prod(shape)], dtype=object).reshape(shape)

    def free(self, count: int, what: str) -> list[int]:
        """The indices of ``count`` unused variables."""
        first = self._taken
        self._taken += count
        if self._taken > len(self.variables):
            raise NotRational(f"it has more than {FREE} functions, normals and factors")
        self.names = [*self.names, *(f"{what}_{i + 1}" for i in range(count))]
        return list(range(first, first + count))

    def function(self, name: str, of: Rational) -> Rational:
        """The free variable that stands for a function of ``of``."""
        for place, (other, argument) in self.functions.items():
            if other == name and (argument - of).is_zero:
                return self.variables[place]
        (place,) = self.free(1, name)
        self.functions[place] = name, of
        return self.variables[place]

    def exact(self, value: Any) -> Any:
        """The exact value of a number, of an array of numbers, or of an array that already contains variables."""
        if isinstance(value, np.ndarray):
            found = np.empty(value.shape, dtype=object)
            for index in np.ndindex(value.shape):
                found[index] = self.exact(value[index])
            return found if value.shape else found[()]
        return value if isinstance(value, Rational) else self.constant(exact_number(value))


def exact_number(value: Any) -> fmpq:
    """The number itself, without rounding."""
    if isinstance(value, fmpq):
        return value
    if isinstance(value, float) and not math.isfinite(value):
        raise NotRational(f"{value} is not a number")
    fraction = Fraction(value)
    return fmpq(fraction.numerator, fraction.denominator)


def as_float(value: fmpq) -> float:
    """The nearest binary64 number."""
    return int(value.p) / int(value.q)


NUMBERS = (int, float, np.integer, np.floating, Fraction, fmpq)


class Rational:
    """num/den, reduced."""

    __slots__ = ("den", "num", "ring")
    shape: tuple[int, ...] = ()
    ndim = 0
    size = 1

    def __init__(self, ring: Ring, num: fmpq_mpoly, den: fmpq_mpoly) -> None:
        if not den.is_constant():
            shared = num.gcd(den)
            num, den = num // shared, den // shared
        factor = den.coeffs()[-1] if den.is_constant() else 1 / _constant_term(den)
        self.ring = ring
        if den.is_constant():
            self.num, self.den = num * (1 / factor), ring_one(ring)
        else:
            self.num, self.den = num * factor, den * factor

    # arithmetic

    def _with(self, other: Any) -> Rational | None:
        if isinstance(other, Rational):
            return other
        if isinstance(other, np.ndarray) and other.shape == ():
            other = other[()]
        return self.ring.exact(other) if isinstance(other, NUMBERS) else None

    def __add__(self, other: Any) -> Any:
        one = self._with(other)
        if one is None:
            return NotImplemented
        if self.den == one.den:
            return Rational(self.ring, self.num + one.num, self.den)
        return Rational(self.ring, self.num * one.den + one.num * self.den, self.den * one.den)

    __radd__ = __add__

    def __neg__(self) -> Rational:
        return Rational(self.ring, -self.num, self.den)

    def __pos__(self) -> Rational:
        return self

    def __sub__(self, other: Any) -> Any:
        one = self._with(other)
        return NotImplemented if one is None else self + -one

    def __rsub__(self, other: Any) -> Any:
        one = self._with(other)
        return NotImplemented if one is None else one + -self

    def __mul__(self, other: Any) -> Any:
        one = self._with(other)
        return NotImplemented if one is None else Rational(self.ring, self.num * one.num, self.den * one.den)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        one = self._with(other)
        if one is None:
            return NotImplemented
        if one.is_zero:
            raise NotRational("it divides by zero")
        return Rational(self.ring, self.num * one.den, self.den * one.num)

    def __rtruediv__(self, other: Any) -> Any:
        one = self._with(other)
        return NotImplemented if one is None else one / self

    def __pow__(self, power: Any) -> Rational:
        if isinstance(power, Rational) and power.is_constant:
            power = float(power)
        if not isinstance(power, NUMBERS) or power != int(power):
            raise NotRational(f"it raises a variable to the power {power}")
        whole = int(power)
        return self._raised(whole) if whole >= 0 else 1 / self._raised(-whole)

    def _raised(self, power: int) -> Rational:
        return Rational(self.ring, self.num**power, self.den**power)

    # operations that NumPy applies to the elements of an array

    def sin(self) -> Rational:
        return self.ring.function("sin", self)

    def cos(self) -> Rational:
        return self.ring.function("cos", self)

    def exp(self) -> Rational:
        return self.ring.function("exp", self)

    def tanh(self) -> Rational:
        return self.ring.function("tanh", self)

    def arctan(self) -> Rational:
        return self.ring.function("arctan", self)

    def __abs__(self) -> Rational:
        return self.ring.function("abs", self)

    fabs = __abs__

    def conjugate(self) -> Rational:
        return self

    @property
    def T(self) -> Rational:
        return self

    def reshape(self, *shape: Any) -> Any:
        """The entry of an array with one entry; anything else is returned unchanged."""
        flat = shape[0] if len(shape) == 1 and isinstance(shape[0], tuple) else shape
        return np.array([self], dtype=object).reshape(flat) if flat else self

    def __getitem__(self, _: Any) -> NoReturn:
        raise TypeError("a number has no entries")

    # comparisons, which are defined for numbers only

    @property
    def is_constant(self) -> bool:
        return bool(self.num.is_constant() and self.den.is_constant())

    @property
    def is_zero(self) -> bool:
        return bool(self.num.is_zero())

    @property
    def number(self) -> fmpq:
        """The value of a constant."""
        if not self.is_constant:
            raise NotRational("it branches on a value, or takes a minimum, a maximum or a limit")
        return fmpq(0) if self.num.is_zero() else self.num.coeffs()[0]

    def __float__(self) -> float:
        return as_float(self.number)

    def __lt__(self, other: Any) -> bool:
        return bool((self - other).number < 0)

    def __le__(self, other: Any) -> bool:
        return bool((self - other).number <= 0)

    def __gt__(self, other: Any) -> bool:
        return bool((self - other).number > 0)

    def __ge__(self, other: Any) -> bool:
        return bool((self - other).number >= 0)

    def __eq__(self, other: object) -> bool:
        return bool((self - other).number == 0)

    def __ne__(self, other: object) -> bool:
        return bool((self - other).number != 0)

    def __bool__(self) -> bool:
        return bool(self.number != 0)

    __hash__ = None  # type: ignore[assignment]

    # calculus

    @property
    def used(self) -> set[int]:
        """The indices of the variables that occur in the function."""
        degrees = zip(self.num.degrees(), self.den.degrees(), strict=True)
        return {place for place, (up, down) in enumerate(degrees) if up > 0 or down > 0}

    def derivative(self, place: int) -> Rational:
        """The derivative with respect to one variable, with the others and the functions held."""
        slope = self.num.derivative(place) * self.den - self.num * self.den.derivative(place)
        return Rational(self.ring, slope, self.den * self.den)

    def replaced(self, by: dict[int, Rational]) -> Rational:
        """The function with variables replaced by rational functions, all at once."""
        if not by.keys() & self.used:
            return self
        num, den = _evaluated(self.num, by, self.ring), _evaluated(self.den, by, self.ring)
        return Rational(self.ring, num.num * den.den, num.den * den.num)

    def at(self, values: list[fmpq]) -> fmpq:
        """The exact value for exact values of all variables."""
        return self.num(*values) / self.den(*values)


def ring_one(ring: Ring) -> fmpq_mpoly:
    """The polynomial 1."""
    return ring.context.constant(1)


def _constant_term(poly: fmpq_mpoly) -> fmpq:
    """The constant term of a denominator, or 1 if it is zero; dividing by it does not hide a sign."""
    found = poly[(0,) * poly.context().nvars()]
    return found if found != 0 else fmpq(1)


def _evaluated(poly: fmpq_mpoly, by: dict[int, Rational], ring: Ring) -> Rational:
    if all(one.den.is_constant() for one in by.values()):
        images = [by[i].num if i in by else one.num for i, one in enumerate(ring.variables)]
        return Rational(ring, poly.compose(*images, ctx=ring.context), ring_one(ring))
    total = ring.constant(fmpq(0))
    for powers, factor in poly.to_dict().items():
        term = ring.constant(factor)
        for place, power in enumerate(powers):
            if power:
                term = term * by.get(place, ring.variables[place]) ** int(power)
        total = total + term
    return total
