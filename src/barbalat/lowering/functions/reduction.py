"""x = n pi/2 + y with |y| <= pi/4, y in two doubles: usually by Cody and Waite's parts, for large x by Payne and Hanek's digits.

The parts are fdlibm's (e_rem_pio2.c, k_rem_pio2.c; Copyright (C) 1993 by Sun Microsystems, Inc.); see docs/licences.md.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from barbalat.lowering.functions.exact import Double, fast_two_sum, rounded, two_product, two_sum
from barbalat.lowering.functions.trace import Number

LARGEST_USUAL = 2.0**19 * math.pi / 2
"""Up to here n has at most 20 bits, and its product with a part of 33 bits is exact."""
TWO_OVER_PI = float.fromhex("0x1.45f306dc9c883p-1")
PI_2_PARTS = tuple(map(float.fromhex, ("0x1.921fb544p+0", "0x1.0b4611a6p-34", "0x1.3198a2ep-69")))
"""pi/2 in parts of 33 bits, and what is left in a fourth."""
PI_2_REST = float.fromhex("0x1.b839a252049c1p-104")
PI_2_HIGH, PI_2_LOW = float.fromhex("0x1.921fb54442d18p+0"), float.fromhex("0x1.1a62633145c07p-54")

DIGIT_BITS = 24
_LEADING_ZEROS = 3
TWO_OVER_PI_DIGITS = tuple([0.0] * _LEADING_ZEROS) + tuple(float(digit) for digit in (
    0xA2F983, 0x6E4E44, 0x1529FC, 0x2757D1, 0xF534DD, 0xC0DB62, 0x95993C, 0x439041, 0xFE5163,
    0xABDEBB, 0xC561B7, 0x246E3A, 0x424DD2, 0xE00649, 0x2EEA09, 0xD1921C, 0xFE1DEB, 0x1CB129,
    0xA73EE8, 0x8235F5, 0x2EBB44, 0x84E99C, 0x7026B4, 0x5F7E41, 0x3991D6, 0x398353, 0x39F49C,
    0x845F8B, 0xBDF928, 0x3B1FF8, 0x97FFDE, 0x05980F, 0xEF2F11, 0x8B5A0A, 0x6D1F6D, 0x367ECF,
    0x27CB09, 0xB74F46, 0x3F669E, 0x5FEA2D, 0x7527BA, 0xC7EBE5, 0xF17B3D, 0x0739F7, 0x8A5292,
    0xEA6BFB, 0x5FB11F, 0x8D5D08, 0x560330,
))  # fmt: skip
"""2/pi as digits of 24 bits after the point, as many as the largest double needs, with zeros before it."""
PRODUCTS = 8
"""Digits of x 2/pi that are kept: what is cut off is below 2^-140, and no double is nearer than 2^-61 to a multiple of pi/2."""


class Reduced(NamedTuple):
    """x = quadrant pi/2 + (high + low), where the quadrant, -2 to 2, counts modulo 4."""

    quadrant: Number
    high: Number
    low: Number


def is_large(x: Number) -> Number:
    """Whether ``usual`` is not for this x; infinity and NaN are, and make a NaN there."""
    size = abs(x)
    return (size > LARGEST_USUAL) & (size < math.inf)


def usual(x: Number) -> Reduced:
    """For |x| <= LARGEST_USUAL. The errors of the subtractions are kept: near a multiple of pi/2 they are what is left."""
    n = rounded(x * TWO_OVER_PI)
    first, second, third = (n * part for part in PI_2_PARTS)  # exact
    y = x - first  # exact
    y, error_2 = two_sum(y, -second)
    y, error_3 = two_sum(y, -third)
    high, low = fast_two_sum(y, (error_2 + error_3) - n * PI_2_REST)
    return Reduced(_modulo_4(n), high, low)


def large(x: Number) -> Reduced:
    """For every finite |x| above 2^19; what else may stand beside it in a vector is replaced."""
    size = abs(x)
    size = is_large(x).then(size, LARGEST_USUAL)
    e = size.exponent() - (DIGIT_BITS - 1)
    rest, digits = size.significand() * 2.0 ** (DIGIT_BITS - 1), []
    for _ in range(3):  # 24 + 24 + 5 bits, and the last ones with signs
        digits.append(rounded(rest))
        rest = (rest - digits[-1]) * 2.0**DIGIT_BITS
    skipped = rounded((e - 3.0 - (DIGIT_BITS - 1) / 2) * (1 / DIGIT_BITS))  # digits of 2/pi whose products are multiples of 8
    weight = (e - DIGIT_BITS * (skipped + 1.0)).two_to_this()
    entries = [(skipped + float(_LEADING_ZEROS + i)).entry_of(TWO_OVER_PI_DIGITS) for i in range(-2, PRODUCTS)]
    terms = []
    for m in range(PRODUCTS):
        total = digits[0] * entries[m + 2] + digits[1] * entries[m + 1] + digits[2] * entries[m]  # exact: below 2^50
        terms.append(total * weight * 2.0 ** (-DIGIT_BITS * m))
    terms[:3] = [term - 4.0 * rounded(term * 0.25) for term in terms[:3]]
    n, turned = _fraction(terms)
    y = _times_half_pi(turned)
    negative = x < 0.0
    return Reduced(_modulo_4(negative.then(-n, n)), negative.then(-y.high, y.high), negative.then(-y.low, y.low))


def _fraction(terms: list[Number]) -> tuple[Number, Double]:
    """The whole number next to the sum of the terms, and the rest of it; three doubles hold what cancellation leaves."""
    total = terms[0] + terms[1]  # exact: 47 bits
    n = rounded(total)
    high, low = two_sum(total - n, terms[2])
    last = n.constant(0.0)
    for term in terms[3:]:
        high, error = two_sum(high, term)
        low, error = two_sum(low, error)
        last = last + error
    high, low = two_sum(high, low)
    more = rounded(high)
    high, low = two_sum(high - more, low)
    low, last = two_sum(low, last)
    high, low = two_sum(high, low)
    high, low = fast_two_sum(high, low + last)
    return n + more, Double(high, low)


def _times_half_pi(turned: Double) -> Double:
    high, low = two_product(turned.high, turned.high.constant(PI_2_HIGH))
    return fast_two_sum(high, low + (turned.high * PI_2_LOW + turned.low * PI_2_HIGH))


def _modulo_4(n: Number) -> Number:
    return n - 4.0 * rounded(n * 0.25)
