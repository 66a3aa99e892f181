"""A zero or a minimum between two points, found with SciPy's form of Brent's methods, which is imported at the first search."""

from __future__ import annotations

from collections.abc import Callable

SMALLEST_RELATIVE = 4 * 2.0**-52
"""The smallest relative tolerance that rounding permits."""


def zero_between(
    function: Callable[[float], float], left: float, right: float, *, absolute: float, relative: float = SMALLEST_RELATIVE
) -> float:
    """An x between left and right with function(x) = 0, with an error of at most absolute + relative |x|.

    Raises ValueError if the function has the same sign at both ends or is NaN somewhere, RuntimeError if it does not converge.
    """
    from scipy.optimize import brentq

    return float(brentq(function, left, right, xtol=absolute, rtol=relative))


def least_between(function: Callable[[float], float], left: float, right: float, *, absolute: float) -> tuple[float, float]:
    """A point between left and right where the function has a local minimum, and its value there; the point's error is about
    ``absolute``, but not below a relative 1e-8."""
    from scipy.optimize import minimize_scalar

    found = minimize_scalar(function, bounds=(left, right), method="bounded", options={"xatol": absolute})
    return float(found.x), float(found.fun)
