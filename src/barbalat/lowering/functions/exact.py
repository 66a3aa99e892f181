"""Sums and products with their rounding errors, and rounding to whole numbers, from additions and multiplications alone.

Knuth, The Art of Computer Programming 2, 4.2.2, theorem B; Dekker, Numer. Math. 18 (1971) 224-242.
"""

from __future__ import annotations

from typing import NamedTuple

from barbalat.lowering.functions.trace import Number

ROUNDER = 1.5 * 2.0**52
"""Added and subtracted again it rounds a number below 2^51 to a whole one, ties to even: there doubles are 1 apart."""
SPLITTER = 2.0**27 + 1
"""Dekker's factor, which halves 53 bits into 26 and 26 with a sign."""


class Double(NamedTuple):
    """An unevaluated sum of a number and its rest, which is at most about half a unit in its last place."""

    high: Number
    low: Number


def rounded(x: Number) -> Number:
    """The nearest whole number, for |x| < 2^51."""
    return (x + ROUNDER) - ROUNDER


def two_sum(a: Number, b: Number) -> Double:
    """a + b = high + low, exactly."""
    high = a + b
    part = high - a
    return Double(high, (a - (high - part)) + (b - part))


def fast_two_sum(a: Number, b: Number) -> Double:
    """a + b = high + low, exactly where |a| >= |b| or a = 0."""
    high = a + b
    return Double(high, b - (high - a))


def split(x: Number) -> Double:
    """x = high + low, of 26 bits each, for |x| < 2^996."""
    scaled = x * SPLITTER
    high = scaled - (scaled - x)
    return Double(high, x - high)


def two_product(a: Number, b: Number) -> Double:
    """a b = high + low, exactly but for over- and underflow."""
    high, (a1, a2), (b1, b2) = a * b, split(a), split(b)
    return Double(high, ((a1 * b1 - high) + a1 * b2 + a2 * b1) + a2 * b2)
