"""x^y = 2^(y log2 x), with the logarithm as a sum of two doubles.

Coefficients: fdlibm's e_pow.c (Copyright (C) 2004 by Sun Microsystems, Inc.); see docs/licences.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from barbalat.lowering.functions.exponential import P as EXP
from barbalat.lowering.functions.formats import DOUBLE, SINGLE, Format, whole
from barbalat.lowering.functions.trace import Double, TracedNumber, rounded, split

L = (
    5.99999999999994648725e-01, 4.28571428578550184252e-01, 3.33333329818377432918e-01,
    2.72728123808534006489e-01, 2.30660745775561754067e-01, 2.06975017800338417784e-01,
)  # fmt: skip
TWO_OVER_3_LN_2 = 9.61796693925975554329e-01
TWO_OVER_3_LN_2_HIGH, TWO_OVER_3_LN_2_LOW = 9.61796700954437255859e-01, -7.02846165095275826516e-09
LOG2_3_2_HIGH, LOG2_3_2_LOW = 5.84962487220764160156e-01, 1.35003920212974897128e-08
"""log2(3/2)."""
LN_2 = 6.93147180559945286227e-01
LN_2_HIGH, LN_2_LOW = 6.93147182464599609375e-01, -1.90465429995776804525e-09


@dataclass(frozen=True)
class PowerConstants:
    """Constants, each as one number, or as a first part with half of the bits and a remainder.

    largest_power  2 to this power overflows, 2 to its negative rounds to zero, and half of it is a valid exponent
    """

    two_over_3_ln_2: tuple[float, ...]
    log2_3_2: tuple[float, ...]
    ln_2: tuple[float, ...]
    largest_power: float


_LN_2 = whole(LN_2_HIGH, LN_2_LOW)
CONSTANTS: dict[Format, PowerConstants] = {
    DOUBLE: PowerConstants(
        (TWO_OVER_3_LN_2_HIGH, TWO_OVER_3_LN_2_LOW), (LOG2_3_2_HIGH, LOG2_3_2_LOW), (LN_2_HIGH, LN_2_LOW), 2000.0
    ),
    SINGLE: PowerConstants(
        SINGLE.parted(whole(TWO_OVER_3_LN_2_HIGH, TWO_OVER_3_LN_2_LOW), 12),
        SINGLE.parted(whole(LOG2_3_2_HIGH, LOG2_3_2_LOW), 12),
        SINGLE.parted(_LN_2, 12),
        250.0,
    ),
}


def power(x: TracedNumber, y: TracedNumber) -> tuple[TracedNumber]:
    """x^y; NaN if it is not real."""
    a = abs(x)
    largest = 2.0 ** (
        x.format.bits + 11
    )  # with a larger y the result is out of range for every x except 1: |log2 x| is at least 2^-bits
    exponent = (y > largest).then(largest, y)
    exponent = (exponent < -largest).then(-largest, exponent)
    value = _two_to(_times(_log2(a), exponent))
    return (_special(x, y, a, value),)


def _log2(a: TracedNumber) -> Double:
    """log2 a for a > 0, with half of the bits in the first number."""
    of, raised = CONSTANTS[a.format], a.format.bits + 1
    factor_high, factor_low = of.two_over_3_ln_2
    tiny = a < a.format.smallest_normal
    normal = tiny.then(a * 2.0**raised, a)
    m, e = normal.significand(), normal.exponent()
    middle, upper = m >= math.sqrt(1.5), m >= math.sqrt(3)
    middle = middle & ~upper
    m = upper.then(0.5 * m, m)
    n = e + upper.then(1.0, 0.0) + tiny.then(float(-raised), 0.0)
    base, base_high, base_low = middle.then(1.5, 1.0), *(middle.then(part, 0.0) for part in of.log2_3_2)
    u, v = m - base, 1.0 / (m + base)
    s = u * v
    s_high, _ = split(s)
    t_high, _ = split(m + base)
    t_low = m - (t_high - base)
    s_low = v * ((u - s_high * t_high) - s_high * t_low)
    z = s * s
    r = z * z * (L[0] + z * (L[1] + z * (L[2] + z * (L[3] + z * (L[4] + z * L[5]))))) + s_low * (s_high + s)
    square = s_high * s_high  # exact
    t_high, _ = split(3.0 + square + r)
    t_low = r - ((t_high - 3.0) - square)
    u, v = s_high * t_high, s_low * t_high + t_low * s
    p_high, _ = split(u + v)
    p_low = v - (p_high - u)
    z_high = factor_high * p_high
    z_low = factor_low * p_high + p_low * TWO_OVER_3_LN_2 + base_low
    high, _ = split(((z_high + z_low) + base_high) + n)
    return Double(high, z_low - (((high - n) - base_high) - z_high))


def _times(log: Double, y: TracedNumber) -> Double:
    high, low = split(y)
    return Double(high * log.high, low * log.high + y * log.low)


def _two_to(power: Double) -> TracedNumber:
    high, low = power
    (ln_2_high, ln_2_low), largest = CONSTANTS[high.format].ln_2, CONSTANTS[high.format].largest_power
    total = high + low
    outside_above, outside_below = total > largest, total < -largest
    outside = outside_above | outside_below
    high, low = outside.then(outside_above.then(largest, -largest), high), outside.then(0.0, low)
    n = rounded(high + low)
    high = high - n
    t, _ = split(high + low)
    u, v = t * ln_2_high, (low - (t - high)) * LN_2 + t * ln_2_low
    z = u + v
    w = v - (z - u)
    squared = z * z
    c = z - squared * (EXP[0] + squared * (EXP[1] + squared * (EXP[2] + squared * (EXP[3] + squared * EXP[4]))))
    r = (z * c) / (c - 2.0) - (w + z * w)
    half = rounded(n * 0.5)
    return ((1.0 - (r - z)) * half.two_to_this()) * (n - half).two_to_this()


def _special(x: TracedNumber, y: TracedNumber, a: TracedNumber, value: TracedNumber) -> TracedNumber:
    """The values required by IEEE 754 at zeros, infinities, negative x and NaN."""
    size = abs(y)
    near = (size < 2.0**x.format.bits).then(y, 0.0)  # every larger number is even
    half = near * 0.5
    whole = ((near - near.floor()).equals(0.0)) & (size <= math.inf)
    odd = whole & ~(half - half.floor()).equals(0.0)
    grows = (y > 0.0).then(math.inf, 0.0)  # of an infinite x
    shrinks = (y < 0.0).then(math.inf, 0.0)
    value = a.equals(0.0).then(shrinks, a.equals(math.inf).then(grows, value))
    value = (x < 0.0).then(whole.then(value, math.nan), value)
    value = (x < 0.0).then(a.equals(math.inf).then(grows, value), value)
    value = odd.then(value.with_sign_of(x), value)
    value = (a.equals(1.0) & size.equals(math.inf)).then(1.0, value)
    value = ((a <= math.inf) & (size <= math.inf)).then(value, math.nan)
    return (x.equals(1.0) | y.equals(0.0)).then(1.0, value)
