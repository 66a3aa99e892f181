"""What a loop's estimates are to become, and the set that they are projected onto, by the roles that the equations declare.

A law from outside the package may estimate anything: the weights of a network, or nothing. Its estimates are compared with the
problem's parameters only where they are declared as theirs, or by convention, and where there are as many of them.
"""

from __future__ import annotations

import numpy as np

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.known_set import EstimateSet, ParameterBall, ParameterBox, ParameterProduct, Projecting
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.roles import THETA, Role, StatePart
from barbalat.validate import Array, counted


def true_values(problem: TrackingProblem, loop: ClosedLoop) -> Array | None:
    """(p,), one for each entry of theta_hat; None where the problem does not know them, or knows another number of them."""
    return None if loop.estimates is None else truth_of(problem, loop.estimates)


def truth_of(problem: TrackingProblem, part: StatePart) -> Array | None:
    """(p,), what these estimates are to become; None where nothing is known to be that."""
    role, found = part.role, None
    if role.true is not None:
        found = _of_role(role, problem) if isinstance(problem, Problem) else None
    elif role.of == THETA:
        found = problem.true_parameters
    return np.ravel(found) if found is not None and np.size(found) == part.size else None


def _of_role(role: Role, problem: Problem) -> Array | None:
    """What a role makes of the true theta and gains."""
    assert role.true is not None
    omega = np.array([path.gain for path in problem.surroundings.paths])
    if problem.simulated is None:
        return role.true(problem.plant.theta, omega)
    values, p = problem.true_parameters, len(problem.plant.theta)
    if values is None:
        return None
    return role.true(values[:p], omega if problem.input_gain is None else values[p:])


def not_the_parameters(problem: TrackingProblem, loop: ClosedLoop) -> str | None:
    """A sentence where a scheme has another number of estimates than the problem has parameters, and says nothing of them.

    Whoever estimates nothing, or declares what else is estimated, needs no such sentence.
    """
    found, expected = loop.estimates, problem.parameters
    if found is None or found.role.of != THETA or expected is None or found.size in (0, len(expected)):
        return None
    return (
        f"it has {counted(found.size, 'estimate')} and the problem {counted(len(expected), 'parameter')}: no true values "
        "of its estimates are known"
    )


def estimate_set(loop: ClosedLoop) -> EstimateSet | None:
    """What theta_hat is projected onto; None where the scheme says nothing of it, or keeps another set under that name."""
    if loop.estimates is None:
        return None
    role, equations = loop.estimates.role, loop.continuous
    box = role.within
    if box is None and role.of == THETA:
        box = equations.estimate_set if isinstance(equations, Projecting) else None
    if not isinstance(box, (ParameterBox, ParameterBall, ParameterProduct)):
        return None
    bounded = len(box.extent[0])
    fits = bounded <= loop.parameters if isinstance(box, ParameterProduct) and box.theta is None else bounded == loop.parameters
    return box if fits else None


def estimate_names(loop: ClosedLoop) -> tuple[str, ...]:
    """(p,), without a hat."""
    return () if loop.estimates is None else loop.estimates.names
