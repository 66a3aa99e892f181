"""What a loop's estimates are called, and are to become: the problem's parameters, or the ideal gains that follow from them."""

from __future__ import annotations

import numpy as np

from barbalat.estimating import GainEstimating, IdealReporting, NamingEstimates, Reporting
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.validate import Array


def true_values(problem: TrackingProblem, loop: ClosedLoop) -> Array | None:
    """(p,); None where the problem does not know them."""
    equations = loop.continuous
    if isinstance(equations, GainEstimating) and isinstance(problem, Problem):
        return equations.ideal_gains(problem.plant.theta, _effectiveness(problem))
    return problem.parameters


def ideal_reported(problem: TrackingProblem, loop: ClosedLoop) -> dict[str, Array]:
    """By the names of what is reported; without those of which no ideal value is known."""
    equations = loop.continuous
    if isinstance(equations, IdealReporting) and isinstance(problem, Problem):
        return equations.ideal_reported(problem.plant.theta, _effectiveness(problem))
    return {}


def estimate_names(loop: ClosedLoop) -> tuple[str, ...]:
    """(p,), without a hat."""
    equations = loop.continuous
    if isinstance(equations, NamingEstimates):
        return equations.estimate_names
    return tuple(f"theta_{i + 1}" for i in range(loop.parameters))


def reporting(loop: ClosedLoop) -> Reporting | None:
    """The equations that report beside theta_hat: the loop's own, or those that Euler's steps are taken of."""
    found = (one for one in (loop.equations, loop.continuous) if isinstance(one, Reporting))
    return next(found, None)


def _effectiveness(problem: Problem) -> Array:
    return np.array([path.gain for path in problem.plant.paths])
