"""Sums and products with their rounding errors, and rounding to whole numbers, from additions and multiplications alone.

Knuth, The Art of Computer Programming 2, 4.2.2, theorem B; Dekker, Numer. Math. 18 (1971) 224-242.
"""

from __future__ import annotations

from typing import NamedTuple

from barbalat.lowering.functions.trace import TracedNumber


class Double(NamedTuple):
    """An unevaluated sum of a number and its rest, which is at most about half a unit in its last place."""

    high: TracedNumber
    low: TracedNumber


def rounded(x: TracedNumber) -> TracedNumber:
    """The nearest whole number, for |x| < 2^51 in doubles, 2^22 in floats: numbers of the rounder's size are 1 apart."""
    rounder = x.format.rounder
    return (x + rounder) - rounder


def two_sum(a: TracedNumber, b: TracedNumber) -> Double:
    """a + b = high + low, exactly."""
    high = a + b
    part = high - a
    return Double(high, (a - (high - part)) + (b - part))


def fast_two_sum(a: TracedNumber, b: TracedNumber) -> Double:
    """a + b = high + low, exactly where |a| >= |b| or a = 0."""
    high = a + b
    return Double(high, b - (high - a))


def split(x: TracedNumber) -> Double:
    """x = high + low, of half of the bits each (26 in doubles, 12 in floats), where the product does not overflow."""
    scaled = x * x.format.splitter
    high = scaled - (scaled - x)
    return Double(high, x - high)


def two_product(a: TracedNumber, b: TracedNumber) -> Double:
    """a b = high + low, exactly but for over- and underflow."""
    high, (a1, a2), (b1, b2) = a * b, split(a), split(b)
    return Double(high, ((a1 * b1 - high) + a1 * b2 + a2 * b1) + a2 * b2)
