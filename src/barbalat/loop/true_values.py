"""What a loop's estimates are to become: the problem's parameters, or the ideal gains that follow from them."""

from __future__ import annotations

import numpy as np

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import GainEstimating
from barbalat.validate import Array


def true_values(problem: TrackingProblem, loop: ClosedLoop) -> Array | None:
    """(p,); None where the problem does not know them."""
    equations = loop.continuous
    if isinstance(equations, GainEstimating) and isinstance(problem, Problem):
        return equations.ideal_gains(problem.plant.theta, np.array([path.gain for path in problem.plant.paths]))
    return problem.parameters
