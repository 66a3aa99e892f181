"""sin, cos, tan and atan.

x = n pi/2 + y with |y| <= pi/4 and y as a sum of two numbers: usually by Cody and Waite's parts, for large x by Payne and Hanek's
digits.

Polynomials, parts and intervals: fdlibm's k_sin.c, k_cos.c, k_tan.c, e_rem_pio2.c, k_rem_pio2.c and s_atan.c (Copyright (C) 1993,
2004 by Sun Microsystems, Inc.); see docs/licences.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from barbalat.lowering.functions.formats import DOUBLE, SINGLE, Format, whole
from barbalat.lowering.functions.trace import Double, TracedNumber, fast_two_sum, rounded, split, two_product, two_sum

LARGEST_USUAL = 2.0**19 * math.pi / 2
"""Up to this value n has at most 20 bits, and its product with a part of 33 bits is exact."""
TWO_OVER_PI = float.fromhex("0x1.45f306dc9c883p-1")
PI_2_PARTS = tuple(map(float.fromhex, ("0x1.921fb544p+0", "0x1.0b4611a6p-34", "0x1.3198a2ep-69")))
"""pi/2 in parts of 33 bits, with the remainder in a fourth."""
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
"""2/pi as digits of 24 bits after the point; the largest double needs all of these."""
PI_2 = whole(*PI_2_PARTS, PI_2_REST)


@dataclass(frozen=True)
class ReductionConstants:
    """The constants for the reduction in a format.

    largest_usual  up to this value the product of n with a part of pi/2 is exact
    parts, rest    parts of pi/2
    digit_bits     bits of a digit of 2/pi: the sum of three products of digits is exact
    digits         with zeros before the point
    products       number of digits of x 2/pi that are kept
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
    # the neglected part is below 2^-140, and no double is closer than 2^-61 to a multiple of pi/2
    DOUBLE: ReductionConstants(
        LARGEST_USUAL, TWO_OVER_PI, PI_2_PARTS, PI_2_REST, (PI_2_HIGH, PI_2_LOW), DIGIT_BITS, _zeros_before(TWO_OVER_PI_DIGITS), 8
    ),
    # n and the parts have 12 bits each; the neglected part is below 2^-66, and no float is closer than 2^-31
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
    """Whether ``usual`` does not apply to this x. For infinity and NaN it applies and gives NaN."""
    size = abs(x)
    return (size > CONSTANTS[x.format].largest_usual) & (size < math.inf)


def usual(x: TracedNumber) -> Reduced:
    """The reduction for small n. The rounding errors of the subtractions are kept: near a multiple of pi/2 they dominate."""
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
    """The reduction for every larger, finite |x|; other values in the same vector are replaced."""
    of = CONSTANTS[x.format]
    bits = of.digit_bits
    size = abs(x)
    size = is_large(x).then(size, of.largest_usual)
    e = size.exponent() - (bits - 1)
    rest, digits = size.significand() * 2.0 ** (bits - 1), []
    for _ in range(3):  # 24 + 24 + 5 bits, or 8 + 8 + 8, of which the last part is signed
        digits.append(rounded(rest))
        rest = (rest - digits[-1]) * 2.0**bits
    skipped = rounded((e - 3.0 - (bits - 1) / 2) * (1 / bits))  # skips the digits of 2/pi whose products are multiples of 8
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
    """The integer nearest to the sum of the terms, and the remainder; three numbers contain the digits that remain after
    cancellation."""
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


S = (
    -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04,
    2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10,
)  # fmt: skip
C = (
    4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05,
    -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11,
)  # fmt: skip
T = (
    3.33333333333334091986e-01, 1.33333333333201242699e-01, 5.39682539762260521377e-02, 2.18694882948595424599e-02,
    8.86323982359930005737e-03, 3.59207910759131235356e-03, 1.45620945432529025516e-03, 5.88041240820264096874e-04,
    2.46463134818469906812e-04, 7.81794442939557092300e-05, 7.14072491382608190305e-05, -1.85586374855275456654e-05,
    2.59073051863633712884e-05,
)  # fmt: skip
TAN_TURNS = 0.67434
"""The y above which tan y is computed from tan(pi/4 - y), as in fdlibm."""
_PI_4 = float.fromhex("0x1.921fb54442d18p-1"), float.fromhex("0x1.1a62633145c07p-55")
PI_4 = {DOUBLE: _PI_4, SINGLE: SINGLE.parted(whole(*_PI_4), SINGLE.bits)}


def _sine(y: TracedNumber, low: TracedNumber) -> TracedNumber:
    z = y * y
    w = z * z
    r = S[1] + z * (S[2] + z * S[3]) + z * w * (S[4] + z * S[5])
    v = z * y
    return y - ((z * (0.5 * low - v * r) - low) - v * S[0])


def _cosine(y: TracedNumber, low: TracedNumber) -> TracedNumber:
    z = y * y
    w = z * z
    r = z * (C[0] + z * (C[1] + z * C[2])) + w * w * (C[3] + z * (C[4] + z * C[5]))
    half = 0.5 * z
    main = 1.0 - half
    return main + (((1.0 - main) - half) + (z * r - y * low))


def sin(x: TracedNumber, at: Reduced) -> TracedNumber:
    """sin y, or cos y in odd quadrants, with the half turn's sign."""
    quadrant, y, low = at
    value = abs(quadrant).equals(1.0).then(_cosine(y, low), _sine(y, low))
    return _or_itself(x, ((quadrant < -0.5) | (quadrant > 1.5)).then(-value, value))


def cos(_: TracedNumber, at: Reduced) -> TracedNumber:
    """cos y, or sin y in odd quadrants, with the half turn's sign."""
    quadrant, y, low = at
    value = abs(quadrant).equals(1.0).then(_sine(y, low), _cosine(y, low))
    return ((quadrant > 0.5) | (quadrant < -1.5)).then(-value, value)


def tan(x: TracedNumber, at: Reduced) -> TracedNumber:
    """tan y, or -1/tan y in odd quadrants; above TAN_TURNS, 1 - 2 (t - ...)/(1 + t) with t = tan(pi/4 - |y|)."""
    quadrant, y, low = at
    odd, turns, negative = abs(quadrant).equals(1.0), abs(y) >= TAN_TURNS, y < 0.0
    size, size_low = abs(y), negative.then(-low, low)
    pi_4, pi_4_low = PI_4[x.format]
    a, b = turns.then((pi_4 - size) + (pi_4_low - size_low), y), turns.then(0.0, low)
    z = a * a
    w = z * z
    even_part = T[1] + w * (T[3] + w * (T[5] + w * (T[7] + w * (T[9] + w * T[11]))))
    odd_part = z * (T[2] + w * (T[4] + w * (T[6] + w * (T[8] + w * (T[10] + w * T[12])))))
    s = z * a
    r = (b + z * (s * (even_part + odd_part) + b)) + T[0] * s
    total, rest = fast_two_sum(a, r)
    v = odd.then(-1.0, 1.0)
    turned = v - 2.0 * (a - (total * total / (total + v) - r))
    turned = negative.then(-turned, turned)
    inverse = -1.0 / total
    (t, _), (high, _) = split(inverse), split(total)
    inverted = t + inverse * ((1.0 + t * high) + t * ((total - high) + rest))
    return _or_itself(x, turns.then(turned, odd.then(inverted, total)))


def _or_itself(x: TracedNumber, value: TracedNumber) -> TracedNumber:
    """x, which equals its sine and tangent exactly if it is small enough, with the sign of zero kept."""
    return (abs(x) < x.format.linear_range).then(x, value)


def usual_of(
    value: Callable[[TracedNumber, Reduced], TracedNumber],
) -> Callable[[TracedNumber], tuple[TracedNumber, TracedNumber]]:
    """Return the value, and whether the method does not apply to this x."""
    return lambda x: (value(x, usual(x)), is_large(x))


def large_of(value: Callable[[TracedNumber, Reduced], TracedNumber]) -> Callable[[TracedNumber], tuple[TracedNumber]]:
    """The value for large arguments."""
    return lambda x: (value(x, large(x)),)


ATAN = (
    3.33333333333329318027e-01, -1.99999999998764832476e-01, 1.42857142725034663711e-01, -1.11111104054623557880e-01,
    9.09088713343650656196e-02, -7.69187620504482999495e-02, 6.66107313738753120669e-02, -5.83357013379057348645e-02,
    4.97687799461593236017e-02, -3.65315727442169155270e-02, 1.62858201153657823623e-02,
)  # fmt: skip
_AT = tuple(map(float.fromhex, ("0x1.dac670561bb4fp-2", "0x1.921fb54442d18p-1", "0x1.f730bd281f69bp-1", "0x1.921fb54442d18p+0")))
_AT_LOW = tuple(
    map(float.fromhex, ("0x1.a2b7f222f65e2p-56", "0x1.1a62633145c07p-55", "0x1.007887af0cbbdp-56", "0x1.1a62633145c07p-54"))
)
AT = {
    DOUBLE: tuple(zip(_AT, _AT_LOW, strict=True)),
    SINGLE: tuple(SINGLE.parted(whole(*both), SINGLE.bits) for both in zip(_AT, _AT_LOW, strict=True)),
}
"""atan of 1/2, 1, 3/2 and infinity, each in two numbers."""
ASYMPTOTE_FROM = {DOUBLE: 2.0**66, SINGLE: 2.0**34}
"""The x from which atan x rounds to pi/2."""


def atan(x: TracedNumber) -> tuple[TracedNumber]:
    """atan a = atan c + atan((a - c)/(1 + c a)), with c = 0, 1/2, 1, 3/2 or infinity by the interval of a = |x|."""
    a = abs(x)
    beyond, at = ASYMPTOTE_FROM[x.format], AT[x.format]
    a = (a > beyond).then(beyond, a)
    upper, lower = a.constant(-1.0), a
    constant, constant_low = (a.constant(part) for part in at[3])
    steps = (
        (39 / 16, a - 1.5, 1.0 + 1.5 * a, 2),
        (19 / 16, a - 1.0, a + 1.0, 1),
        (11 / 16, 2.0 * a - 1.0, 2.0 + a, 0),
    )
    for limit, numerator, denominator, i in steps:
        below = a < limit
        upper, lower = below.then(numerator, upper), below.then(denominator, lower)
        constant, constant_low = below.then(at[i][0], constant), below.then(at[i][1], constant_low)
    small = a < 7 / 16
    t = small.then(a, upper / lower)
    z = t * t
    w = z * z
    first = z * (ATAN[0] + w * (ATAN[2] + w * (ATAN[4] + w * (ATAN[6] + w * (ATAN[8] + w * ATAN[10])))))
    second = w * (ATAN[1] + w * (ATAN[3] + w * (ATAN[5] + w * (ATAN[7] + w * ATAN[9]))))
    correction = t * (first + second)
    value = small.then(t - correction, constant - ((correction - constant_low) - t))
    return (value.with_sign_of(x),)
