"""sin, cos and tan.

Polynomials: fdlibm's k_sin.c, k_cos.c, k_tan.c (Copyright (C) 1993, 2004 by Sun Microsystems, Inc.); see docs/licences.md.
"""

from __future__ import annotations

from collections.abc import Callable

from barbalat.lowering.functions.exact import fast_two_sum, split
from barbalat.lowering.functions.formats import DOUBLE, SINGLE, whole
from barbalat.lowering.functions.reduction import Reduced, is_large, large, usual
from barbalat.lowering.functions.trace import TracedNumber

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
"""Above it tan y comes from tan(pi/4 - y), as in fdlibm."""
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
    """sin y, in odd quadrants cos y, with the half turn's sign."""
    quadrant, y, low = at
    value = abs(quadrant).equals(1.0).then(_cosine(y, low), _sine(y, low))
    return _or_itself(x, ((quadrant < -0.5) | (quadrant > 1.5)).then(-value, value))


def cos(_: TracedNumber, at: Reduced) -> TracedNumber:
    """cos y, in odd quadrants sin y, with the half turn's sign."""
    quadrant, y, low = at
    value = abs(quadrant).equals(1.0).then(_sine(y, low), _cosine(y, low))
    return ((quadrant > 0.5) | (quadrant < -1.5)).then(-value, value)


def tan(x: TracedNumber, at: Reduced) -> TracedNumber:
    """tan y in odd quadrants -1/tan y; above TAN_TURNS by 1 - 2 (t - ...)/(1 + t), t = tan(pi/4 - |y|)."""
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
    """x is its own sine and tangent to the last bit where it is so small, and keeps the sign of zero."""
    return (abs(x) < x.format.linear_range).then(x, value)


def usual_of(
    value: Callable[[TracedNumber, Reduced], TracedNumber],
) -> Callable[[TracedNumber], tuple[TracedNumber, TracedNumber]]:
    """(the value, whether it is not for this x)."""
    return lambda x: (value(x, usual(x)), is_large(x))


def large_of(value: Callable[[TracedNumber, Reduced], TracedNumber]) -> Callable[[TracedNumber], tuple[TracedNumber]]:
    """The value for large arguments."""
    return lambda x: (value(x, large(x)),)
