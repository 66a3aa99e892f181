"""Oscillating estimates: a metric of sweeps in addition to the judge's verdict, which does not consider estimates."""

from __future__ import annotations

import numpy as np

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.true_values import estimate_set, true_values
from barbalat.problem.known_set import Projecting
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.kernel.metrics import Metrics
from barbalat.validate import Array

SPAN_SHARE = 0.1
"""Smallest fraction of its known range over which an oscillating estimate moves in the tail."""
CROSSINGS_MULTIPLE = 2.0
"""Multiple of the speed at which the estimate would cross its range whenever the model crosses its range; a faster estimate
counts as oscillating."""
POINT_SHARE, ROUNDING_SHARE = 1e-3, 1e-9
"""A range narrower than the first fraction of its largest value, or than the second fraction of the largest value of all ranges,
counts as a point: its estimate is known and does not oscillate."""


def rings(metrics: Metrics, width: Array, crossings: float) -> Array:
    """(M,) whether a run has an estimate that oscillates in the tail.

    width      (p,) width of the known range of each estimate; infinite if the range is unknown, 0 if it is nearly a point
    crossings  rate at which the model crosses its range [1/s]
    """
    span = metrics.theta_hat_tail_max - metrics.theta_hat_tail_min
    fast = metrics.theta_hat_variation_rate > CROSSINGS_MULTIPLE * crossings * width
    return np.asarray((fast & (span > SPAN_SHARE * width) & (width > 0)).any(axis=1))


FILLED_SHARE = 0.9
"""Smallest fraction of its known range over which an estimate must move in the tail to count as filling the range."""


def fills(metrics: Metrics, width: Array) -> Array:
    """(M,) whether a run has an estimate that moves in the tail from end to end of its known range."""
    span = metrics.theta_hat_tail_max - metrics.theta_hat_tail_min
    return np.asarray(((span >= FILLED_SHARE * width) & (width > 0)).any(axis=1))


def known_width(problem: TrackingProblem, controller: Controller) -> Array:
    """The width of the known set in the direction of each estimate, (p,). Without a set it is the width of -|theta|_2 ...
    |theta|_2, or infinite without theta.

    The width is 0 where the set is nearly a point, because an estimate that is projected onto it hardly moves.
    """
    loop = ClosedLoop.of(problem, controller)
    theta, known_set = true_values(problem, loop), estimate_set(loop)
    if known_set is None and theta is not None and isinstance(problem.known, Projecting):
        known_set = problem.known.estimate_set  # for example, a network's weights have no known set
    if known_set is not None and known_set.bounds_theta:
        extents = [part.extent for part in (known_set.sphere, known_set.intervals) if part is not None]
        low, high = (np.concatenate(ends)[: loop.parameters] for ends in zip(*extents, strict=True))
        size = np.maximum(np.abs(low), np.abs(high))
        point = high - low <= np.maximum(POINT_SHARE * size, ROUNDING_SHARE * size.max(initial=0.0))
        return np.where(point, 0.0, high - low)
    return np.full(loop.parameters, np.inf if theta is None else 2 * float(np.linalg.norm(theta)))
