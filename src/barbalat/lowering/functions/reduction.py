"""x = n pi/2 + y with |y| <= pi/4, y in two numbers: usually by Cody and Waite's parts, for large x by Payne and Hanek's digits.

The parts are fdlibm's (e_rem_pio2.c, k_rem_pio2.c; Copyright (C) 1993 by Sun Microsystems, Inc.); see docs/licences.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from barbalat.lowering.functions.exact import Double, fast_two_sum, rounded, two_product, two_sum
from barbalat.lowering.functions.formats import DOUBLE, SINGLE, Format, whole
from barbalat.lowering.functions.trace import TracedNumber

LARGEST_USUAL = 2.0**19 * math.pi / 2
"""Up to here n has at most 20 bits, and its product with a part of 33 bits is exact."""
TWO_OVER_PI = float.fromhex("0x1.45f306dc9c883p-1")
PI_2_PARTS = tuple(map(float.fromhex, ("0x1.921fb544p+0", "0x1.0b4611a6p-34", "0x1.3198a2ep-69")))
"""pi/2 in parts of 33 bits, and what is left in a fourth."""
PI_2_REST = float.fromhex("0x1.b839a252049c1p-104")
PI_2_HIGH, PI_2_LOW = float.fromhex("0x1.921fb54442d18p+0"), float.fromhex("0x1.1a62633145c07p-54")

DIGIT_BITS = 24
_LEADING_ZEROS = 3
TWO_OVER_PI_DIGITS = tuple(float(digit) for digit in (
    0xA2F983, 0x6E4E44, 0x1529FC, 0x2757D1, 0xF534DD, 0xC0DB62, 0x95993C, 0x439041, 0xFE5163,
    0xABDEBB, 0xC561B7, 0x246E3A, 0x424DD2, 0xE00649, 0x2EEA09, 0xD1921C, 0xFE1DEB, 0x1CB129,
    0xA73EE8, 0x8235F5, 0x2EBB44, 0x84E99C, 0x7026B4, 0x5F7E41, 0x3991D6, 0x398353, 0x39F49C,
    0x845F8B, 0xBDF928, 0x3B1FF8, 0x97FFDE, 0x05980F, 0xEF2F11, 0x8B5A0A, 0x6D1F6D, 0x367ECF,
    0x27CB09, 0xB74F46, 0x3F669E, 0x5FEA2D, 0x7527BA, 0xC7EBE5, 0xF17B3D, 0x0739F7, 0x8A5292,
    0xEA6BFB, 0x5FB11F, 0x8D5D08, 0x560330,
))  # fmt: skip
"""2/pi as digits of 24 bits after the point, as many as the largest double needs."""
PI_2 = whole(*PI_2_PARTS, PI_2_REST)


@dataclass(frozen=True)
class ReductionConstants:
    """What the reduction of a format needs.

    largest_usual  up to here the product of n with a part of pi/2 is exact
    parts, rest    of pi/2
    digit_bits     of a digit of 2/pi: the sum of three products of digits is exact
    digits         with zeros before the point
    products       digits of x 2/pi that are kept
    """

    largest_usual: float
    two_over_pi: float
    parts: tuple[float, ...]
    rest: float
    pi_2: tuple[float, ...]
    digit_bits: int
    digits: tuple[float, ...]
    products: int


def _zeros_before(digits: tuple[float, ...]) -> tuple[float, ...]:
    return (0.0,) * _LEADING_ZEROS + digits


_SINGLE_PARTS = SINGLE.parted(PI_2, 12, 12, 12, 12)
_BYTES = tuple(float(byte) for digit in TWO_OVER_PI_DIGITS[:10] for byte in int(digit).to_bytes(3, "big"))
CONSTANTS: dict[Format, ReductionConstants] = {
    # what is cut off is below 2^-140, and no double is nearer than 2^-61 to a multiple of pi/2
    DOUBLE: ReductionConstants(
        LARGEST_USUAL, TWO_OVER_PI, PI_2_PARTS, PI_2_REST, (PI_2_HIGH, PI_2_LOW), DIGIT_BITS, _zeros_before(TWO_OVER_PI_DIGITS), 8
    ),
    # n and the parts have 12 bits each; cut off is what is below 2^-66, and no float is nearer than 2^-31
    SINGLE: ReductionConstants(
        2.0**11 * math.pi / 2, SINGLE.nearest(1 / PI_2), _SINGLE_PARTS[:-1], _SINGLE_PARTS[-1], SINGLE.parted(PI_2, 24), 8,
        _zeros_before(_BYTES), 11,
    ),
}  # fmt: skip


class Reduced(NamedTuple):
    """x = quadrant pi/2 + (high + low), where the quadrant, -2 to 2, counts modulo 4."""

    quadrant: TracedNumber
    high: TracedNumber
    low: TracedNumber


def is_large(x: TracedNumber) -> TracedNumber:
    """Whether ``usual`` is not for this x; infinity and NaN are, and make a NaN there."""
    size = abs(x)
    return (size > CONSTANTS[x.format].largest_usual) & (size < math.inf)


def usual(x: TracedNumber) -> Reduced:
    """Where n is small. The errors of the subtractions are kept: near a multiple of pi/2 they are what is left."""
    of = CONSTANTS[x.format]
    n = rounded(x * of.two_over_pi)
    first, second, *others = (n * part for part in of.parts)  # exact
    y = x - first  # exact
    y, errors = two_sum(y, -second)
    for product in others:
        y, error = two_sum(y, -product)
        errors = errors + error
    high, low = fast_two_sum(y, errors - n * of.rest)
    return Reduced(_modulo_4(n), high, low)


def large(x: TracedNumber) -> Reduced:
    """For every larger, finite |x|; what else may stand beside it in a vector is replaced."""
    of = CONSTANTS[x.format]
    bits = of.digit_bits
    size = abs(x)
    size = is_large(x).then(size, of.largest_usual)
    e = size.exponent() - (bits - 1)
    rest, digits = size.significand() * 2.0 ** (bits - 1), []
    for _ in range(3):  # 24 + 24 + 5 bits, or 8 + 8 + 8, and the last ones with signs
        digits.append(rounded(rest))
        rest = (rest - digits[-1]) * 2.0**bits
    skipped = rounded((e - 3.0 - (bits - 1) / 2) * (1 / bits))  # digits of 2/pi whose products are multiples of 8
    weight = (e - bits * (skipped + 1.0)).two_to_this()
    entries = [(skipped + float(_LEADING_ZEROS + i)).entry_of(of.digits) for i in range(-2, of.products)]
    terms = []
    for m in range(of.products):
        total = digits[0] * entries[m + 2] + digits[1] * entries[m + 1] + digits[2] * entries[m]  # exact: below 2^50, 2^18
        terms.append(total * weight * 2.0 ** (-bits * m))
    terms[:3] = [term - 4.0 * rounded(term * 0.25) for term in terms[:3]]
    n, turned = _fraction(terms)
    y = _times_half_pi(turned)
    negative = x < 0.0
    return Reduced(_modulo_4(negative.then(-n, n)), negative.then(-y.high, y.high), negative.then(-y.low, y.low))


def _fraction(terms: list[TracedNumber]) -> tuple[TracedNumber, Double]:
    """The whole number next to the sum of the terms, and the rest of it; three numbers hold what cancellation leaves."""
    total = terms[0] + terms[1]  # exact: 47 bits, or 17
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
    pi_2_high, pi_2_low = CONSTANTS[turned.high.format].pi_2
    high, low = two_product(turned.high, turned.high.constant(pi_2_high))
    return fast_two_sum(high, low + (turned.high * pi_2_low + turned.low * pi_2_high))


def _modulo_4(n: TracedNumber) -> TracedNumber:
    return n - 4.0 * rounded(n * 0.25)
