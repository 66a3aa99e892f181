"""Writes a sum of products as a fraction of two polynomials, and bounds it over a box of parameters.

On a box, both polynomials are combinations of the same nonnegative Bernstein polynomials, f = sum n_i B_i / sum d_i B_i. If all
d_i are positive, f lies between the smallest and the largest n_i / d_i (Garloff 1986, Interval Mathematics, LNCS 212, for
polynomials). A parameter that occurs several times does not widen these bounds. If f is extreme at a corner of the box, they are
attained there.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, reduce
from math import comb

import numpy as np
from flint import arb

from barbalat.linear.balls import Ball, as_arb
from barbalat.linear.enclosure import float_above, float_below
from barbalat.problem.laurent import ALONE, Product, Sum, added, joined, multiplied, products_of, value_of
from barbalat.validate import Array

MOST_TERMS = 1000
"""Largest number of terms of a polynomial, and a quarter of the largest number of its Bernstein coefficients."""
MOST_POWER = 200
"""Largest power of a factor, and of a parameter."""
EPS = float(np.finfo(float).eps)
ENTRY_ROUNDINGS = 16
"""A bound on the rounding errors in the entries of both matrices of an axis, in addition to one rounding error for each power of
the width."""
SAFE = 1e-250, 1e250
"""Range of the sizes of coefficients in which no product underflows or overflows."""


@dataclass(frozen=True, eq=False)
class Rational:
    """A fraction of polynomials in ``names``: parameters, and texts of functions of parameters.

    above, below  coefficients of the numerator and the denominator by the powers of the names, each rounded once
    """

    names: tuple[str, ...]
    above: Array
    below: Array

    @classmethod
    def of(cls, one: Sum) -> Rational | None:
        """Return the fraction; None if the polynomials have too many terms or too large coefficients."""
        try:
            above, below = _without_common(*_fraction(one))
        except _TooLarge:
            return None
        names = tuple(sorted({name for product in (*above, *below) for name, _ in product}))
        degrees = [max(dict(product).get(name, 0) for product in (*above, *below)) for name in names]
        if max(degrees, default=0) > MOST_POWER or np.prod([degree + 1.0 for degree in degrees]) > 4 * MOST_TERMS:
            return None
        tensors = []
        for part in (above, below):
            tensor = np.zeros([degree + 1 for degree in degrees])
            for product, factor in part.items():
                if abs(factor) > SAFE[1]:
                    return None
                tensor[tuple(dict(product).get(name, 0) for name in names)] = float(factor)
            tensors.append(tensor)
        return cls(names, *tensors)

    def bounds(self, low: Mapping[str, float], high: Mapping[str, float]) -> tuple[float, float, list[dict[str, float]]]:
        """Return bounds over a box, rounded outward and infinite if the denominator may vanish, and the points of the box to
        which the extreme coefficients belong."""
        ends = [self._range(name, low, high) for name in self.names]
        (n, n_error), (d, d_error) = (_bernstein(part, ends) for part in (self.above, self.below))
        if (d < 0).all():
            n, d = -n, -d
        if not (d > d_error).all() or not np.isfinite(n + n_error).all():
            return -np.inf, np.inf, []
        least, most = n - n_error, n + n_error
        lower = least / np.where(least < 0, d - d_error, d + d_error)
        upper = most / np.where(most > 0, d - d_error, d + d_error)
        found = [np.unravel_index(index, n.shape) for index in (lower.argmin(), upper.argmax())]
        points = [self._point(index, ends, low, high) for index in found]
        outward = 4 * EPS
        return float(lower.min() - outward * abs(lower.min())), float(upper.max() + outward * abs(upper.max())), points

    def _range(self, name: str, low: Mapping[str, float], high: Mapping[str, float]) -> tuple[float, float]:
        """Return the range of a parameter or of a function of parameters."""
        if name in low:
            return low[name], high[name]
        values = {one: Ball(arb(low[one]).union(arb(high[one]))) for one in low}
        found = as_arb(value_of(frozenset({(name, 1)}), values))
        return (float_below(found), float_above(found)) if found.is_finite() else (-np.inf, np.inf)

    def _point(
        self, index: tuple[int, ...], ends: list[tuple[float, float]], low: Mapping[str, float], high: Mapping[str, float]
    ) -> dict[str, float]:
        """Return the point of the box at which a Bernstein polynomial is largest, with the centre for parameters inside
        functions."""
        point = {name: (low[name] + high[name]) / 2 for name in low}
        for name, i, (a, b), size in zip(self.names, index, ends, self.above.shape, strict=True):
            if name in point and size > 1:
                point[name] = b if i == size - 1 else a + (b - a) * (int(i) / (size - 1))
        return point


def _bernstein(coefficients: Array, ends: list[tuple[float, float]]) -> tuple[Array, Array]:
    """Return the Bernstein coefficients of a polynomial over a box, and bounds of their rounding errors, which are infinite if a
    number may underflow or overflow."""
    value, size, there, roundings = coefficients, np.abs(coefficients), coefficients != 0, 1
    safe = _safe(size[there])
    for axis, (a, b) in enumerate(ends):
        degree = coefficients.shape[axis] - 1
        roundings += 3 * (degree + 1) + ENTRY_ROUNDINGS
        with np.errstate(all="ignore"):
            safe &= _safe(np.abs(np.array([end for end in (a, b - a) if end])) ** degree)
            shift = np.array(
                [
                    [comb(k, i) * np.float64(a) ** (k - i) * np.float64(b - a) ** i if k >= i else 0.0 for k in range(degree + 1)]
                    for i in range(degree + 1)
                ]
            )
            weights = np.array([[comb(i, k) / comb(degree, k) for k in range(degree + 1)] for i in range(degree + 1)])
            for matrix in (shift, weights):
                value = np.moveaxis(np.tensordot(matrix, value, (1, axis)), 0, axis)
                size = np.moveaxis(np.tensordot(np.abs(matrix), size, (1, axis)), 0, axis)
                there = np.moveaxis(np.tensordot(matrix != 0, there, (1, axis)), 0, axis) > 0
                safe &= _safe(size[there])  # this also detects a sum whose parts all underflowed
    return value, 1.01 * roundings * EPS * size if safe else np.full(value.shape, np.inf)


def _safe(sizes: Array) -> bool:
    """Return whether all sizes are within SAFE."""
    return bool(np.all((sizes >= SAFE[0]) & (sizes <= SAFE[1])))


class _TooLarge(Exception):
    """A polynomial has more than MOST_TERMS terms."""


def _fraction(one: Sum) -> tuple[Sum, Sum]:
    """Return the numerator and the denominator, which are sums of products of positive powers of parameters and of functions of
    them.

    A factor f = N/D whose powers e range from lo <= 0 to hi >= 0 over the products is f^e = N^(e - lo) D^(hi - e) / (N^-lo D^hi).
    """
    powers: dict[str, list[int]] = {}
    for product in one:
        for factor, power in product:
            powers.setdefault(factor, [0, 0]).append(power)
    spans = {factor: (min(own), max(own), _parts(factor)) for factor, own in powers.items()}
    below: Sum = {ALONE: Fraction(1)}
    for lo, hi, (N, D) in spans.values():
        below = _times(below, _times(_power(N, -lo), _power(D, hi)))
    terms = []
    for product, coefficient in one.items():
        term: Sum = {ALONE: coefficient}
        for factor, (lo, hi, (N, D)) in spans.items():
            e = dict(product).get(factor, 0)
            term = _times(term, _times(_power(N, e - lo), _power(D, hi - e)))
        terms.append(term)
    return added(*terms), below


@cache
def _parts(factor: str) -> tuple[Sum, Sum]:
    """Return the numerator and the denominator of a factor: a parameter, a sum, a whole power of a sum, or a function, which is
    not divided."""
    whole = {frozenset({(factor, 1)}): Fraction(1)}
    found = products_of(factor)
    if found != whole:
        return _fraction(found)
    node = ast.parse(factor, mode="eval").body
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow) and isinstance(node.right, ast.Constant):
        power = float(node.right.value)  # type: ignore[arg-type]
        if power.is_integer() and power > 0:
            N, D = _fraction(products_of(ast.unparse(node.left)))
            return _power(N, int(power)), _power(D, int(power))
    return whole, {ALONE: Fraction(1)}


def _times(one: Sum, other: Sum) -> Sum:
    if len(one) * len(other) > 100 * MOST_TERMS:
        raise _TooLarge
    found = multiplied(one, other)
    if len(found) > MOST_TERMS:
        raise _TooLarge
    return found


def _power(one: Sum, exponent: int) -> Sum:
    if exponent > MOST_POWER:
        raise _TooLarge
    return reduce(_times, [one] * exponent, {ALONE: Fraction(1)})


def _without_common(above: Sum, below: Sum) -> tuple[Sum, Sum]:
    """Return both polynomials divided by the monomial that all their terms have in common."""
    products = [dict(product) for product in (*above, *below)]
    common = {name: min(one.get(name, 0) for one in products) for name in products[0]}
    inverse: Product = frozenset((name, -power) for name, power in common.items() if power)
    return tuple({joined(product, inverse): factor for product, factor in part.items()} for part in (above, below))  # type: ignore[return-value]
