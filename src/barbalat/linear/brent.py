"""Brent's methods for a zero and for a minimum between two points, without SciPy's optimisers, whose import takes longer than a
whole certificate.

Source: Brent, Algorithms for Minimization Without Derivatives (1973), chapters 4 and 5, in the form of SciPy's ``brentq`` and
``minimize_scalar(method="bounded")``: the operations and their order are the same. Minima agree bit for bit, and so do zeros
where SciPy's C code is compiled without fused multiply-adds.
"""

from __future__ import annotations

import math
from collections.abc import Callable

MOST_STEPS = 100
"""Bisection alone resolves a bracket in 64 steps; more than this many means that the function is not continuous."""
MOST_EVALUATIONS = 500
"""Largest number of evaluations in the search for a minimum, whose best point is returned in any case."""
SMALLEST_RELATIVE = 4 * 2.0**-52
"""The smallest relative tolerance that rounding permits."""


def zero_between(
    function: Callable[[float], float], left: float, right: float, *, absolute: float, relative: float = SMALLEST_RELATIVE
) -> float:
    """An x between left and right with function(x) = 0, with an error of at most absolute + relative |x|.

    Raises ValueError if the function has the same sign at both ends or is NaN somewhere, ArithmeticError if it does not converge.
    """

    def value(x: float) -> float:
        found = float(function(x))
        if math.isnan(found):
            raise ValueError(f"the function whose zero is sought is NaN at {x:g}")
        return found

    before, x = float(left), float(right)
    f_before, f = value(before), value(x)
    if f_before == 0:
        return before
    if f == 0:
        return x
    if (f_before < 0) == (f < 0):
        raise ValueError(f"the function has the same sign at {left:g} and {right:g}")
    other, f_other, last, step = 0.0, 0.0, 0.0, 0.0
    for _ in range(MOST_STEPS):
        if f_before != 0 and f != 0 and (f_before < 0) != (f < 0):  # x and the point before it are a bracket
            other, f_other = before, f_before
            last = step = x - before
        if abs(f_other) < abs(f):
            before, x, other = x, other, x
            f_before, f, f_other = f, f_other, f
        least = (absolute + relative * abs(x)) / 2
        half = (other - x) / 2
        if f == 0 or abs(half) < least:
            return x
        if abs(last) > least and abs(f) < abs(f_before):
            tried = _interpolated(x, f, before, f_before, other, f_other)
            short = 2 * abs(tried) < min(abs(last), 3 * abs(half) - least)
            last, step = (step, tried) if short else (half, half)
        else:
            last = step = half
        before, f_before = x, f
        x += step if abs(step) > least else math.copysign(least, half)
        f = value(x)
    raise ArithmeticError(f"the zero between {left:g} and {right:g} was not found in {MOST_STEPS} steps")


def _interpolated(x: float, f: float, before: float, f_before: float, other: float, f_other: float) -> float:
    """The step to the zero of the secant or of the inverse parabola through the points; infinite if there is none."""
    if before == other:
        rise, run = f - f_before, -f * (x - before)
    else:
        slope = (f_before - f) / (before - x)
        slope_other = (f_other - f) / (other - x)
        rise, run = slope_other * slope * (f_other - f_before), -f * (f_other * slope_other - f_before * slope)
    return run / rise if rise != 0 else math.inf


SQUARE_ROOT_OF_ROUNDING, GOLDEN = math.sqrt(2.2e-16), 0.5 * (3.0 - math.sqrt(5.0))
"""The relative distance within which a function's values at a minimum do not differ, and the share of a golden section."""


def least_between(function: Callable[[float], float], left: float, right: float, *, absolute: float) -> tuple[float, float]:
    """A point between left and right where the function has a local minimum, and its value there; the point's error is about
    ``absolute``, but not below a relative 1e-8."""
    left, right = float(left), float(right)
    best = second = third = left + GOLDEN * (right - left)
    f_best = f_second = f_third = float(function(best))
    step = last = 0.0
    for _ in range(MOST_EVALUATIONS - 1):
        middle, least = 0.5 * (left + right), SQUARE_ROOT_OF_ROUNDING * abs(best) + absolute / 3.0
        if not abs(best - middle) > 2.0 * least - 0.5 * (right - left):
            break
        fitted = None
        if abs(last) > least:
            r, q = (best - second) * (f_best - f_third), (best - third) * (f_best - f_second)
            p, q = (best - third) * q - (best - second) * r, 2.0 * (q - r)
            p, q = -p if q > 0.0 else p, abs(q)
            before, last = last, step
            if abs(p) < abs(0.5 * q * before) and q * (left - best) < p < q * (right - best):
                fitted = (p + 0.0) / q
                x = best + fitted
                if x - left < 2.0 * least or right - x < 2.0 * least:
                    fitted = least if middle >= best else -least
        if fitted is None:
            last = left - best if best >= middle else right - best
        step = GOLDEN * last if fitted is None else fitted
        x = best + (max(step, least) if step >= 0 else -max(-step, least))
        f = float(function(x))
        if f <= f_best:
            left, right = (best, right) if x >= best else (left, best)
            third, f_third, second, f_second, best, f_best = second, f_second, best, f_best, x, f
            continue
        left, right = (x, right) if x < best else (left, x)
        if f <= f_second or second == best:
            third, f_third, second, f_second = second, f_second, x, f
        elif f <= f_third or third in (best, second):
            third, f_third = x, f
    return best, f_best
