"""The values between which a controller's estimates stay."""

from __future__ import annotations

import numpy as np

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.true_values import estimate_set
from barbalat.problem.known_set import UNREACHED_BOUND
from barbalat.validate import Array


def estimate_limits(loop: ClosedLoop) -> tuple[Array, Array] | None:
    """The least and the largest value of each estimate in the set that it is projected onto; infinite where it has none."""
    box = estimate_set(loop)
    if box is None:
        return None
    low, high = np.full((2, loop.parameters), np.inf) * [[-1.0], [1.0]]
    if box.sphere is not None:
        first = slice(0, box.sphere.size)
        low[first], high[first] = box.sphere.extent
    if box.intervals is not None:
        last = slice(len(low) - box.intervals.size, len(low))
        low[last], high[last] = box.intervals.extent
    return np.where(low <= -UNREACHED_BOUND, -np.inf, low), np.where(high >= UNREACHED_BOUND, np.inf, high)
