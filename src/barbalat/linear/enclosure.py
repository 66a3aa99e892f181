"""Numbers known to lie between two floats, and outward rounding."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from flint import arb

ROUNDED_SYSTEM = 1e-10
"""Relative change of a norm that the rounding of the system's matrices is assumed, not proven, to stay below."""


@dataclass(frozen=True)
class Enclosure:
    """An interval that provably contains a norm, and how it was obtained.

    `lower` and `upper` are rounded outward: lower <= true value <= upper. `converged` says whether the requested relative width
    was reached within the work limit; the interval is valid either way. `sign_changes` counts the sign changes located,
    `segments` the integrated pieces of time (both over all channels and attempts), and `precision_bits` is the largest working
    precision used.
    """

    lower: float
    upper: float
    converged: bool = True
    sign_changes: int = 0
    segments: int = 0
    precision_bits: int = 53

    def of_rounded_system(self) -> Enclosure:
        """The enclosure for the exact system of which a system with rounded matrices was enclosed.

        Both ends move outward by ``ROUNDED_SYSTEM``, which covers the rounding unless the response amplifies it by more than a
        hundred thousand times. ``barbalat-check`` derives the system exactly.
        """
        return replace(self, lower=self.lower * (1 - ROUNDED_SYSTEM), upper=self.upper * (1 + ROUNDED_SYSTEM))

    @property
    def ends(self) -> dict[str, float]:
        """Both ends, by name, as in the block for a norm in the certificate."""
        return {"lower": self.lower, "upper": self.upper}

    @property
    def midpoint(self) -> float:
        """Centre of the interval (rounded to nearest)."""
        return self.lower + 0.5 * (self.upper - self.lower)

    @property
    def relative_width(self) -> float:
        """Width divided by the upper end; 0 for the exact value 0."""
        return (self.upper - self.lower) / self.upper if self.upper > 0.0 else 0.0


def power(value: arb, exponent: int) -> arb:
    """value**exponent. For a ball around zero, the power function of python-flint returns NaN, whatever the radius."""
    if exponent <= 0 or value.mid() != 0:
        return value**exponent
    end = value.abs_upper() ** exponent
    return (arb(0) if exponent % 2 == 0 else -end).union(end)


def float_above(value: arb) -> float:
    """Return the float nearest above every point of the ball; raises ArithmeticError for an indeterminate ball."""
    return 0.0 - float_below(-value)  # 0.0 - 0.0 is +0.0; a sign change would give -0.0


def float_below(value: arb) -> float:
    """Return the float nearest below every point of the ball; raises ArithmeticError for an indeterminate ball."""
    if not value.is_finite():
        raise ArithmeticError("the ball is not finite and has no enclosing floats")
    bound = value.lower()
    candidate = float(bound)  # rounded to nearest, so at most one unit too high
    while not arb(candidate) <= bound:
        candidate = math.nextafter(candidate, -math.inf)
    return candidate


OUTWARD_FACTOR = 1 + 1e-12
"""Covers a few rounding errors, each at most 1.2e-16, in arithmetic on numbers that are already bounds."""
