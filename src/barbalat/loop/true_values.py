"""What a loop's estimates are called, what they are to become, and the set that they are projected onto.

A law from outside the package may estimate anything: the weights of a network, or nothing. Its estimates are compared with the
problem's parameters only where there are as many of them.
"""

from __future__ import annotations

import numpy as np

from barbalat.estimating import GainEstimating, IdealReporting, NamingEstimates, Reporting
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.known_set import EstimateSet, ParameterBall, ParameterBox, ParameterProduct, Projecting
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.validate import Array, counted


def true_values(problem: TrackingProblem, loop: ClosedLoop) -> Array | None:
    """(p,), one for each estimate; None where the problem does not know them, or knows another number of them."""
    equations = loop.continuous
    if isinstance(equations, GainEstimating) and isinstance(problem, Problem):
        found = equations.ideal_gains(problem.plant.theta, _effectiveness(problem))
    else:
        found = problem.parameters
    return found if found is not None and len(found) == loop.parameters else None


def not_the_parameters(problem: TrackingProblem, loop: ClosedLoop) -> str | None:
    """A sentence where a scheme estimates another number of quantities than the problem has parameters, and says nothing of them.

    Whoever estimates nothing, or names its estimates or their ideal values, needs no such sentence.
    """
    equations, expected = loop.continuous, problem.parameters
    if isinstance(equations, (GainEstimating, NamingEstimates)) or expected is None or loop.parameters in (0, len(expected)):
        return None
    return (
        f"it has {counted(loop.parameters, 'estimate')} and the problem {counted(len(expected), 'parameter')}: no true values "
        "of its estimates are known"
    )


def estimate_set(loop: ClosedLoop) -> EstimateSet | None:
    """What the scheme projects its estimates onto; None where it says nothing of it, or keeps another set under that name."""
    box = loop.continuous.box if isinstance(loop.continuous, Projecting) else None
    if not isinstance(box, (ParameterBox, ParameterBall, ParameterProduct)):
        return None
    bounded = len(box.extent[0])
    fits = bounded <= loop.parameters if isinstance(box, ParameterProduct) and box.theta is None else bounded == loop.parameters
    return box if fits else None


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
