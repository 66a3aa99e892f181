"""exp, log and tanh.

Coefficients: fdlibm's e_exp.c and e_log.c (Copyright (C) 1993, 2004 by Sun Microsystems, Inc.); see docs/licences.md.
"""

from __future__ import annotations

import math

from barbalat.lowering.functions.formats import DOUBLE, SINGLE, whole
from barbalat.lowering.functions.trace import Double, TracedNumber, fast_two_sum, rounded, split, two_sum

P = (
    1.66666666666666019037e-01, -2.77777777770155933842e-03, 6.61375632143793436117e-05,
    -1.65339022054652515390e-06, 4.13813679705723846039e-08,
)  # fmt: skip
L = (
    6.666666666666735130e-01, 3.999999999940941908e-01, 2.857142874366239149e-01, 2.222219843214978396e-01,
    1.818357216161805012e-01, 1.531383769920937332e-01, 1.479819860511658591e-01,
)  # fmt: skip
_LN_2 = float.fromhex("0x1.62e42feep-1"), float.fromhex("0x1.a39ef35793c76p-33")
LN_2 = {DOUBLE: _LN_2, SINGLE: SINGLE.parted(whole(*_LN_2), 15)}
"""ln 2; for 32 bits as a float of 15 bits, whose product with an exponent is exact, and the remainder."""
ONE_OVER_LN_2 = float.fromhex("0x1.71547652b82fep+0")
BEYOND_EXP = {DOUBLE: 800.0, SINGLE: 120.0}
"""The argument from which exp overflows and exp of its negative rounds to zero; up to it 2^k is the product of two factors within
range."""
TANH_IS_ONE = {DOUBLE: 22.0, SINGLE: 10.0}


def _remez(t: TracedNumber) -> TracedNumber:
    """t (P1 + t P2 + ...): with r^2 = t, r (exp(r) + 1)/(exp(r) - 1) = 2 + this, to 2^-59."""
    squared = t * t
    return t * ((P[0] + t * P[1]) + squared * ((P[2] + t * P[3]) + squared * P[4]))


def _scaled(value: TracedNumber, k: TracedNumber) -> TracedNumber:
    """value 2^k, rounded once, where the value is near 1."""
    half = rounded(k * 0.5)
    return (value * half.two_to_this()) * (k - half).two_to_this()


def exp(x: TracedNumber) -> tuple[TracedNumber]:
    """exp(k ln 2 + r) = 2^k exp(r), |r| <= ln(2)/2."""
    beyond, (ln_2_high, ln_2_low) = BEYOND_EXP[x.format], LN_2[x.format]
    x = (x > beyond).then(beyond, x)
    x = (x < -beyond).then(-beyond, x)
    k = rounded(x * ONE_OVER_LN_2)
    high, low = x - k * ln_2_high, k * ln_2_low
    r = high - low
    c = r - _remez(r * r)
    return (_scaled(1.0 - ((low - (r * c) / (2.0 - c)) - high), k),)


def log(x: TracedNumber) -> tuple[TracedNumber]:
    """log(2^k m) = k ln 2 + log m, sqrt(1/2) < m <= sqrt(2)."""
    (ln_2_high, ln_2_low), raised = LN_2[x.format], x.format.bits + 1
    tiny = x < x.format.smallest_normal
    normal = tiny.then(x * 2.0**raised, x)
    m, e = normal.significand(), normal.exponent()
    upper = m > math.sqrt(2)
    f = upper.then(0.5 * m, m) - 1.0
    k = e + upper.then(1.0, 0.0) + tiny.then(float(-raised), 0.0)
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    R = w * (L[1] + w * (L[3] + w * L[5])) + z * (L[0] + w * (L[2] + w * (L[4] + w * L[6])))
    half_square = 0.5 * f * f
    value = k * ln_2_high - ((half_square - (s * (half_square + R) + k * ln_2_low)) - f)
    value = (x < math.inf).then(value, x)  # infinity, NaN
    value = x.equals(0.0).then(-math.inf, value)
    return ((x < 0.0).then(math.nan, value),)


def tanh(x: TracedNumber) -> tuple[TracedNumber]:
    """With 2 |x| = k ln 2 + r and exp(r) = (R + r)/(R - r), see ``_remez``: (A - B)/(A + B), A = R + r, B = 2^-k (R - r)."""
    a = abs(x)
    one, (ln_2_high, ln_2_low) = TANH_IS_ONE[x.format], LN_2[x.format]
    a = (a > one).then(one, a)
    twice = a + a
    k = rounded(twice * ONE_OVER_LN_2)
    high, low = twice - k * ln_2_high, k * ln_2_low
    r = fast_two_sum(high, -low)
    R = fast_two_sum(high.constant(2.0), _remez(r.high * r.high))
    scale = (-k).two_to_this()
    A, B = two_sum(R.high, r.high), two_sum(R.high, -r.high)
    A_low, B_low = A.low + (R.low + r.low), scale * (B.low + (R.low - r.low))
    upper, lower = two_sum(A.high, -(scale * B.high)), two_sum(A.high, scale * B.high)
    value = _quotient(
        fast_two_sum(upper.high, upper.low + (A_low - B_low)), fast_two_sum(lower.high, lower.low + (A_low + B_low))
    )
    value = (a < x.format.linear_range).then(a, value)
    return (value.with_sign_of(x),)


def _quotient(upper: Double, lower: Double) -> TracedNumber:
    """upper/lower: the first quotient with Newton's correction, whose residual is computed by Dekker's product."""
    first = upper.high / lower.high
    product = first * lower.high
    (a, b), (c, d) = split(first), split(lower.high)
    error = ((a * c - product) + a * d + b * c) + b * d
    return first + ((((upper.high - product) - error) + upper.low) - first * lower.low) / lower.high
