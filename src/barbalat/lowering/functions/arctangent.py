"""atan.

Coefficients and intervals: fdlibm's s_atan.c (Copyright (C) 1993 by Sun Microsystems, Inc.); see docs/licences.md.
"""

from __future__ import annotations

from barbalat.lowering.functions.formats import DOUBLE, SINGLE, whole
from barbalat.lowering.functions.trace import TracedNumber

A = (
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
"""From here on atan x is pi/2 to the last bit."""


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
    first = z * (A[0] + w * (A[2] + w * (A[4] + w * (A[6] + w * (A[8] + w * A[10])))))
    second = w * (A[1] + w * (A[3] + w * (A[5] + w * (A[7] + w * A[9]))))
    correction = t * (first + second)
    value = small.then(t - correction, constant - ((correction - constant_low) - t))
    return (value.with_sign_of(x),)
