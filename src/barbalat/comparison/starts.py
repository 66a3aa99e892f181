"""Where controllers' estimates start: the same knowledge for all, or a sentence on who has another."""

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
    """theta_hat at t = 0, whatever it estimates; empty where the controller has no estimates."""
    return estimates_in(bound(problem, controller))


def estimates_in(equations: Equations | SampledEquations) -> Array:
    """Where these equations' estimates start."""
    state = equations.initial()
    return np.asarray(taken_from(state, main_estimates(state_parts(equations, state))), dtype=float)


def start_of(problem: Problem, controller: Controller) -> Array | None:
    """(p,) where a controller's estimates of theta start; None where it has none, or none that are known to be theta's."""
    start = initial_estimates(problem, controller)
    p, gains = len(problem.plant.theta), problem.known.inputs if problem.known.matched.gain_unknown else 0
    return start[:p] if len(start) in (p, p + gains) else None


def different_starts(problem: Problem, controllers: Sequence[Controller]) -> list[str]:
    """Sentences on who starts elsewhere than the first of those whose estimates are theta's; none where all start alike."""
    known = {one.name: start for one in controllers if (start := start_of(problem, one)) is not None}
    if not known:
        return []
    first, start = next(iter(known.items()))
    return [
        f"{name} starts with estimates of {validate.show(other)}, and {first} with {validate.show(start)}: the "
        "starts stand in the case, or in the controller's class, and are not tuned"
        for name, other in known.items()
        if not np.array_equal(other, start)
    ]
