"""The true values of a loop's estimates, and the set onto which they are projected, from the roles that the equations declare.

A law from outside the package may estimate anything, such as the weights of a network, or nothing. Its estimates are compared
with the problem's parameters only if they are declared as such, explicitly or by convention, and if their number is the same.
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
    """The true values (p,), one for each entry of theta_hat; None if the problem does not know them, or if their number
    differs."""
    return None if loop.estimates is None else truth_of(problem, loop.estimates)


def truth_of(problem: TrackingProblem, part: StatePart) -> Array | None:
    """The true values (p,) of these estimates; None if they are unknown."""
    role, found = part.role, None
    if role.true is not None:
        found = _of_role(role, problem) if isinstance(problem, Problem) else None
    elif role.of == THETA:
        found = problem.true_parameters
    return np.ravel(found) if found is not None and np.size(found) == part.size else None


def _of_role(role: Role, problem: Problem) -> Array | None:
    """The true values by a role, from the true theta and gains."""
    assert role.true is not None
    omega = np.array([path.gain for path in problem.surroundings.paths])
    if problem.simulated is None:
        return role.true(problem.plant.theta, omega)
    values, p = problem.true_parameters, len(problem.plant.theta)
    if values is None:
        return None
    return role.true(values[:p], omega if problem.input_gain is None else values[p:])


def not_the_parameters(problem: TrackingProblem, loop: ClosedLoop) -> str | None:
    """Return a sentence if a scheme's estimates and the problem's parameters differ in number, and the scheme does not declare
    them.

    A scheme without estimates, or one that declares what it estimates, gets no such sentence.
    """
    found, expected = loop.estimates, problem.parameters
    if found is None or found.role.of != THETA or expected is None or found.size in (0, len(expected)):
        return None
    return (
        f"it has {counted(found.size, 'estimate')} and the problem {counted(len(expected), 'parameter')}: no true values "
        "of its estimates are known"
    )


def estimate_set(loop: ClosedLoop) -> EstimateSet | None:
    """The set onto which theta_hat is projected; None if the scheme does not declare a set, or uses the declared name for a
    different set."""
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


def estimate_names(problem: TrackingProblem, loop: ClosedLoop) -> tuple[str, ...]:
    """(p,) names without a hat; the last ones are omega, or omega_1, omega_2, ..., if they estimate unknown input gains."""
    found = loop.estimates
    if found is None:
        return ()
    if found.role.of != THETA or found.role.names is not None or not isinstance(problem, Problem) or problem.input_gain is None:
        return found.names
    m = problem.plant.inputs
    if found.size != len(problem.parameters):
        return found.names
    return (*found.names[:-m], *(("omega",) if m == 1 else (f"omega_{i + 1}" for i in range(m))))
