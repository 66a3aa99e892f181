"""Margins of a linear sampled loop over the known set: its extreme points, the case's theta, and seeded points for stability.

One delay margin from sample to sample takes as long as a hundred of the others: it is computed where the phase margin over its
frequency is least.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from barbalat.certificates.linear_loops.worst_case import EXACT_VERTICES, MARGIN_NAMES, WorstCase, points_inside
from barbalat.linear.margins import Margins, margins
from barbalat.linear.sampled_loop import SampledLoop
from barbalat.linear.sampled_margins import delay_margin
from barbalat.problem.known_set import KnownSet
from barbalat.validate import Array, InputError

POINTS_INSIDE, DELAYS = 100, 3
"""Seeded points at which stability alone is asked for, and points at which the delay margin is computed."""
SEARCHED = (
    "from sample to sample: the set's {extremes} extreme points, the case's theta, {inside} seeded points inside for stability "
    "alone; the delay margin at the {delays} where the phase margin over its frequency is least: the least found, no guarantee"
)


def sampled_worst_case(loop_at: Callable[[Array], SampledLoop], delay: float, known_set: KnownSet, theta: Array) -> WorstCase:
    """The least margins beside ``delay`` of one input's loop; ``loop_at`` gives it for a theta."""
    rng = np.random.default_rng(0)
    extremes = known_set.extreme_points(rng, EXACT_VERTICES)
    own = np.reshape([theta] if known_set.contains(theta) else [], (-1, known_set.size))
    inside = points_inside(known_set, rng, np.mean(known_set.extent, axis=0), 1.0, POINTS_INSIDE)
    looked_at = np.concatenate([extremes, own])
    searched = SEARCHED.format(extremes=len(extremes), inside=POINTS_INSIDE, delays=min(DELAYS, len(looked_at)))
    points = np.concatenate([looked_at, inside])
    radii = np.array([loop_at(point).radius(delay) for point in points])
    if radii.max() >= 1:
        return WorstCase({}, points[int(radii.argmax())], searched)
    found = [margins(loop_at(point).as_continuous(delay)) for point in looked_at]
    least = {name: _least(name, found, looked_at) for name in MARGIN_NAMES if name != "delay"}
    order = np.argsort([one.delay for one in found], kind="stable")[:DELAYS]
    delays = [(value, looked_at[k]) for k in order if (value := _delay(loop_at(looked_at[k]), delay)) is not None]
    if delays:
        least["delay"] = min(delays, key=lambda one: one[0])
    return WorstCase(least, None, searched)


def _least(name: str, found: list[Margins], points: Array) -> tuple[float, Array]:
    """The least of a margin and where; of a factor below 1 the largest."""
    values = np.array([getattr(one, name) for one in found])
    k = int(values.argmax() if name == "gain_down" else values.argmin())
    return float(values[k]), points[k]


def _delay(loop: SampledLoop, delay: float) -> float | None:
    """None where none is found up to the longest that is tried."""
    try:
        return delay_margin(loop, delay)
    except InputError:
        return None
