"""The inverse of the standard normal distribution function.

Coefficients: M. J. Wichura, Algorithm AS 241, "The Percentage Points of the Normal Distribution", Applied Statistics 37 (1988)
477-484, PPND16, whose rational approximations have a relative error of about 1e-16.
"""

from __future__ import annotations

import math

from barbalat.lowering.functions.exponential import log
from barbalat.lowering.functions.trace import TracedNumber

CENTRAL = 0.425
"""The value of |p - 1/2| up to which a rational function of its square is used; above it, functions of sqrt(-log min(p, 1 - p))
are used."""
CENTRAL_SQUARED = 0.180625
TAIL_FROM, FAR_FROM = 1.6, 5.0
"""Values that are subtracted from that root in the functions of the tail and the far tail; the far tail begins at FAR_FROM."""

A = (
    3.3871328727963666080e0, 1.3314166789178437745e2, 1.9715909503065514427e3, 1.3731693765509461125e4,
    4.5921953931549871457e4, 6.7265770927008700853e4, 3.3430575583588128105e4, 2.5090809287301226727e3,
)  # fmt: skip
B = (
    1.0, 4.2313330701600911252e1, 6.8718700749205790830e2, 5.3941960214247511077e3,
    2.1213794301586595867e4, 3.9307895800092710610e4, 2.8729085735721942674e4, 5.2264952788528545610e3,
)  # fmt: skip
C = (
    1.42343711074968357734e0, 4.63033784615654529590e0, 5.76949722146069140550e0, 3.64784832476320460504e0,
    1.27045825245236838258e0, 2.41780725177450611770e-1, 2.27238449892691845833e-2, 7.74545014278341407640e-4,
)  # fmt: skip
D = (
    1.0, 2.05319162663775882187e0, 1.67638483018380384940e0, 6.89767334985100004550e-1,
    1.48103976427480074590e-1, 1.51986665636164571966e-2, 5.47593808499534494600e-4, 1.05075007164441684324e-9,
)  # fmt: skip
E = (
    6.65790464350110377720e0, 5.46378491116411436990e0, 1.78482653991729133580e0, 2.96560571828504891230e-1,
    2.65321895265761230930e-2, 1.24266094738807843860e-3, 2.71155556874348757815e-5, 2.01033439929228813265e-7,
)  # fmt: skip
F = (
    1.0, 5.99832206555887937690e-1, 1.36929880922735805310e-1, 1.48753612908506148525e-2,
    7.86869131145613259100e-4, 1.84631831751005468180e-5, 1.42151175831644588870e-7, 2.04426310338993978564e-15,
)  # fmt: skip


def _polynomial(coefficients: tuple[float, ...], x: TracedNumber) -> TracedNumber:
    """Evaluate a polynomial by Horner's rule; the constant comes first."""
    *rest, last = coefficients
    value = x.constant(last)
    for coefficient in reversed(rest):
        value = value * x + coefficient
    return value


def central(p: TracedNumber) -> tuple[TracedNumber, TracedNumber]:
    """The value for |p - 1/2| <= CENTRAL, and whether p is outside, or NaN."""
    q = p - 0.5
    r = CENTRAL_SQUARED - q * q
    return q * _polynomial(A, r) / _polynomial(B, r), ~(abs(q) <= CENTRAL)


def tail(p: TracedNumber) -> tuple[TracedNumber]:
    """The value in the tails; infinite at 0 and 1, and NaN outside [0, 1]."""
    upper = p > 0.5
    (logarithm,) = log(upper.then(1.0 - p, p))
    r = (-logarithm).sqrt()
    near, far = r - TAIL_FROM, r - FAR_FROM
    value = (r <= FAR_FROM).then(_polynomial(C, near) / _polynomial(D, near), _polynomial(E, far) / _polynomial(F, far))
    value = r.equals(math.inf).then(math.inf, value)
    return (upper.then(value, -value),)
