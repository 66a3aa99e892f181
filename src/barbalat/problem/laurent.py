"""Formulas as sums of products, so common terms cancel before any range is substituted.

-k/J - k/L and k/J have the products k J^-1 and k L^-1. A factor is a variable or, if a formula is not a sum of products, the text
of a part: a function, a denominator that is a sum, or a non-integer power.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from fractions import Fraction
from functools import cache
from types import MappingProxyType

from barbalat.problem.formulas import FormulaNames, formula
from barbalat.problem.parameters import NAMES
from barbalat.protocols import Value

Product = frozenset[tuple[str, int]]
"""The factors, each as the text of a formula, with their powers."""
Sum = Mapping[Product, Fraction]
"""Products with their coefficients."""
ALONE: Product = frozenset()
"""The product without factors: 1."""
MOST_PRODUCTS = 100
"""Largest sum that is multiplied out. A larger sum remains a factor."""
LARGEST_POWER = 32

_ANY = FormulaNames(NAMES, "parameters")


@cache
def products_of(text: str) -> Sum:
    """Return a parsed formula as a sum of products."""
    return MappingProxyType(_sum(ast.parse(text.strip(), mode="eval").body))


def added(*sums: Sum) -> dict[Product, Fraction]:
    """Return the sum of sums, without terms that cancel."""
    found: dict[Product, Fraction] = {}
    for one in sums:
        for product, factor in one.items():
            found[product] = found.get(product, Fraction(0)) + factor
    return {product: factor for product, factor in found.items() if factor}


def scaled(one: Sum, factor: Fraction | float) -> dict[Product, Fraction]:
    """Return a sum times a number, exactly."""
    exact = Fraction(factor)
    return {product: exact * own for product, own in one.items()} if exact else {}


def multiplied(one: Sum, other: Sum) -> dict[Product, Fraction]:
    """Return the product of two sums, expanded."""
    parts = [{joined(a, b): x * y} for a, x in one.items() for b, y in other.items()]
    return added(*parts)


def value_of(product: Product, values: Mapping[str, Value]) -> Value:
    """Evaluate a product at the parameters' values, in their arithmetic."""
    above = below = None
    for factor, power in sorted(product):
        base = formula("a factor", factor, _ANY).evaluate(values)
        raised = base ** float(abs(power)) if abs(power) > 1 else base
        if power > 0:
            above = raised if above is None else above * raised
        else:
            below = raised if below is None else below * raised
    above = 1.0 if above is None else above
    return above if below is None else above / below


def names_of(product: Product) -> frozenset[str]:
    """Return the parameters in a product."""
    return frozenset().union(*(formula("a factor", factor, _ANY).names for factor, _ in product))


def joined(one: Product, other: Product) -> Product:
    """Return the product of two products."""
    powers = dict(one)
    for factor, power in other:
        powers[factor] = powers.get(factor, 0) + power
    return frozenset((factor, power) for factor, power in powers.items() if power)


def _sum(node: ast.expr) -> dict[Product, Fraction]:
    match node:
        case ast.Constant(value=value):
            return scaled({ALONE: Fraction(1)}, Fraction(float(value)))  # type: ignore[arg-type]
        case ast.UnaryOp(operand=operand):
            return scaled(_sum(operand), -1)
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            return added(_sum(left), _sum(right))
        case ast.BinOp(left=left, op=ast.Sub(), right=right):
            return added(_sum(left), scaled(_sum(right), -1))
        case ast.BinOp(left=left, op=ast.Mult(), right=right):
            a, b = _sum(left), _sum(right)
            if len(a) * len(b) <= MOST_PRODUCTS:
                return multiplied(a, b)
        case ast.BinOp(left=left, op=ast.Div(), right=right):
            return multiplied(_sum(left), _inverse(right))
        case ast.BinOp(left=left, op=ast.Pow(), right=ast.Constant(value=power)):
            whole = float(power).is_integer() and 0 < float(power) <= LARGEST_POWER  # type: ignore[arg-type]
            base = _sum(left)
            if whole and len(base) == 1:
                ((product, factor),) = base.items()
                exponent = int(power)  # type: ignore[arg-type]
                return {frozenset((one, own * exponent) for one, own in product): factor**exponent}
        case _:
            pass
    return {frozenset({(ast.unparse(node), 1)}): Fraction(1)}


def _inverse(node: ast.expr) -> dict[Product, Fraction]:
    """Return the reciprocal of a part. For a single product it is the product of the inverted factors; any other part becomes one
    factor."""
    found = _sum(node)
    if len(found) == 1:
        ((product, factor),) = found.items()
        return {frozenset((one, -power) for one, power in product): 1 / factor}
    return {frozenset({(ast.unparse(node), -1)}): Fraction(1)}
