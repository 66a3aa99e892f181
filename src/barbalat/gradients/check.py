"""Checks a derivative by central differences of the same runs and, where they disagree, gives the reason for rejecting it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf, isfinite

import numpy as np

AGREES_WITHIN = 1e-3
"""Relative difference up to which a derivative and a difference quotient agree and so confirm each other."""
AGREES_BETWEEN_STEPS = 0.02
"""The same limit if the instant of an extremum moves from one solver step to a neighbouring step: the metric and its slope belong
to the nearest step, whereas differences average over several."""
NEARLY_WITHIN = 0.05
"""Relative difference up to which changes of branch inside steps explain the disagreement: their effect on a discrete run is of
the order of the step, and tangents do not contain it."""
CONVERGED_WITHIN = 0.01
"""Relative difference of two successive differences below which they have converged."""
HOLDS_WITHIN = 0.1
"""Relative deviation from the difference quotient with the largest step, up to which a derivative also describes changes of that
size."""
MINOR = 0.01
"""Change of an elasticity that is irrelevant."""
ROUNDING = 1e-12
"""Error of a metric by rounding, relative to the metric."""
NEGLIGIBLE = 1e-6
"""An elasticity below this value cannot be distinguished from zero."""
NEIGHBOURING = 8
"""Steps by which an extremum's instant may move with the smallest change of the number and still be the same extremum."""


@dataclass(frozen=True)
class Pair:
    """A metric for the number increased and decreased by ``step``, and the instants [s] of an extremum; NaN for other metrics."""

    step: float
    above: float
    below: float
    instants: tuple[float, float]

    @property
    def slope(self) -> float:
        return (self.above - self.below) / (2 * self.step)

    def sides(self, value: float) -> tuple[float, float]:
        """The slopes below and above the number; the metric there is ``value``."""
        return (value - self.below) / self.step, (self.above - value) / self.step


@dataclass(frozen=True)
class Checked:
    """The difference with which a derivative was compared, and the reason for rejecting the derivative; empty if it is accepted.

    ``local`` is true for a derivative that is correct but does not describe changes as large as the largest step.
    """

    difference: float
    refused: str = ""
    local: bool = False


def checked(tangent: float, value: float, instant: float, pairs: Sequence[Pair], *, dt: float, scale: float) -> Checked:
    """Check the derivative of a metric.

    tangent, value, instant  the derivative, the metric and the instant of an extremum [s]
    pairs  values with smaller and smaller steps
    dt     step of the solver [s]
    scale  scale of the number
    """
    found = _confirmed(tangent, value, instant, pairs, dt=dt, scale=scale)
    widest = pairs[0].slope
    holds = abs(tangent - widest) <= HOLDS_WITHIN * max(abs(tangent), abs(widest)) + MINOR * abs(value) / scale
    return found if found.refused or holds else replace(found, local=True)


def _confirmed(tangent: float, value: float, instant: float, pairs: Sequence[Pair], *, dt: float, scale: float) -> Checked:
    slopes = [pair.slope for pair in pairs]
    if not isfinite(value) or not all(map(isfinite, slopes)):
        return Checked(inf, "the run, or a run near this value, diverges")
    if not isfinite(tangent):
        return Checked(slopes[1], "its tangent overflows: neighbouring motions separate exponentially (chaos or chattering)")
    finest = pairs[-1]
    same = all(abs(one - instant) <= NEIGHBOURING * dt for one in finest.instants) if isfinite(instant) else False
    moves = same and any(abs(one - instant) > 0.5 * dt for one in finest.instants)
    within = AGREES_BETWEEN_STEPS if moves else AGREES_WITHIN
    if not same and (corner := _corner(value, instant, pairs, scale)):
        return Checked(slopes[1], corner)
    for pair in pairs[1:]:
        if abs(tangent - pair.slope) <= within * abs(pair.slope) + _negligible(value, pair, scale):
            return Checked(pair.slope)
    for coarse, fine in pairwise(pairs):
        apart, small = abs(coarse.slope - fine.slope), _negligible(value, fine, scale)
        if apart <= CONVERGED_WITHIN * abs(fine.slope) + small and abs(tangent - fine.slope) <= 2 * apart + small:
            return Checked(fine.slope)
    return Checked(slopes[1], _reason(tangent, value, instant, pairs, scale, moves=moves))


def _negligible(value: float, pair: Pair, scale: float) -> float:
    """The size of a slope that cannot be distinguished from zero, including the rounding error of the difference."""
    return NEGLIGIBLE * abs(value) / scale + ROUNDING * abs(value) / pair.step


def _corner(value: float, instant: float, pairs: Sequence[Pair], scale: float) -> str:
    """The sentence on a corner, where the slopes on both sides differ by an amount that does not shrink with the step; empty
    without a corner."""
    middle, finest = pairs[-2], pairs[-1]
    gaps = [abs(above - below) for below, above in (pair.sides(value) for pair in (middle, finest))]
    below, above = finest.sides(value)
    if gaps[1] <= CONVERGED_WITHIN * max(abs(below), abs(above)) + _negligible(value, finest, scale):
        return ""
    if not 0.5 * gaps[0] <= gaps[1] <= 2 * gaps[0]:
        return ""
    passes = _passing(instant, finest.instants)
    return f"it has a corner here: its slope is {below:.3g} below this value and {above:.3g} above{passes}"


def _reason(tangent: float, value: float, instant: float, pairs: Sequence[Pair], scale: float, *, moves: bool) -> str:
    middle, finest = pairs[-2], pairs[-1]
    if moves:
        return (
            f"the extremum moves from one solver step to the next, where the slope is {tangent:.3g} and differences give "
            f"{finest.slope:.3g}: a smaller simulation.dt is needed"
        )
    if corner := _corner(value, instant, pairs, scale):
        return corner
    jumps = [abs(pair.above - pair.below) for pair in (middle, finest)]
    if jumps[1] > 0.5 * jumps[0] and jumps[1] > ROUNDING * abs(value):
        return f"it jumps by {jumps[1]:.3g} within {2 * finest.step:.1g} of this value: an event happens on one side only"
    said = ", ".join(f"{pair.slope:.3g}" for pair in pairs)
    if np.ptp([pair.slope for pair in pairs]) > CONVERGED_WITHIN * max(abs(pair.slope) for pair in pairs):
        return (
            f"its differences with smaller and smaller steps do not converge ({said}): the run is too sensitive or changes "
            f"branch too often"
        )
    both = f"its tangent gives {tangent:.5g}, but differences give {finest.slope:.5g}"
    if abs(tangent - finest.slope) <= NEARLY_WITHIN * abs(finest.slope):
        return f"{both}: the run changes branch (a limit, a projection) inside solver steps; a smaller simulation.dt is needed"
    return f"{both}: an event has a jump, which the tangent does not include"


def _passing(instant: float, others: tuple[float, float]) -> str:
    """The phrase for an extremum that passes from one instant to another."""
    if not isfinite(instant):
        return ""
    far = max(others, key=lambda one: abs(one - instant))
    first, second = (f"t = {one:.4g} s" for one in sorted((far, instant)))
    return "" if first == second else f", as the extremum passes between {first} and {second}"
