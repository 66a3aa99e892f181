"""The initial estimates of controllers. All controllers should have the same knowledge; a sentence names those that differ."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from barbalat import validate
from barbalat.loop.binding import bound
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller, Equations, SampledEquations
from barbalat.roles import main_estimates, state_parts, taken_from
from barbalat.validate import Array


def initial_estimates(problem: TrackingProblem, controller: Controller) -> Array:
    """Return theta_hat at t = 0, whatever it estimates; empty for a controller without estimates."""
    return estimates_in(bound(problem, controller))


def estimates_in(equations: Equations | SampledEquations) -> Array:
    """Return the initial estimates of these equations."""
    state = equations.initial()
    return np.asarray(taken_from(state, main_estimates(state_parts(equations, state))), dtype=float)


def start_of(problem: Problem, controller: Controller) -> Array | None:
    """Return a controller's initial estimates of theta (p,); None without estimates, or if they are not known to be estimates of
    theta."""
    start = initial_estimates(problem, controller)
    p, gains = len(problem.plant.theta), problem.known.inputs if problem.known.matched.gain_unknown else 0
    return start[:p] if len(start) in (p, p + gains) else None


def different_starts(problem: Problem, controllers: Sequence[Controller]) -> list[str]:
    """Return sentences on controllers whose initial estimates differ from those of the first controller that estimates theta."""
    known = {one.name: start for one in controllers if (start := start_of(problem, one)) is not None}
    if not known:
        return []
    first, start = next(iter(known.items()))
    return [
        f"{name} starts with estimates of {validate.show(other)}, and {first} with {validate.show(start)}"
        ": the initial estimates come from the case or from the controller's class, and are not tuned"
        for name, other in known.items()
        if not np.array_equal(other, start)
    ]
