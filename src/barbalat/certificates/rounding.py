"""Printed digits of guaranteed bounds: rounded so that the print is a bound as well."""

from __future__ import annotations

from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal


def up(value: float, digits: int = 4) -> str:
    """The smallest decimal of so many significant digits that is not below the value."""
    return _rounded(value, digits, ROUND_CEILING)


def down(value: float, digits: int = 4) -> str:
    """The largest decimal of so many significant digits that is not above the value."""
    return _rounded(value, digits, ROUND_FLOOR)


def _rounded(value: float, digits: int, rounding: str) -> str:
    exact = Decimal(value)  # a float is a decimal
    kept = Context(prec=digits, rounding=rounding).create_decimal(exact)
    return f"{kept:.{digits}g}"  # nothing left to round
