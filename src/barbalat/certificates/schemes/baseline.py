"""The certificate of the baseline alone: ``fixed_loop`` around u = k_0 r - theta_0'x; for plants that are not linear or have
several inputs, only its margins."""

from __future__ import annotations

from typing import Any

import numpy as np

from barbalat.certificates import theorems
from barbalat.certificates.assumptions import BEYOND_ONE_LINEAR_INPUT
from barbalat.certificates.bounds.known_command import KnownLoop
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Entry
from barbalat.certificates.schemes import bounded_response
from barbalat.certificates.schemes.fixed_loop import ONE_LINEAR_INPUT, FixedLoop, add_loop, cells
from barbalat.certificates.schemes.sampled_loop import LINEAR_CONTROLLER
from barbalat.certificates.schemes.unregistered import add_linearised, add_step_of_modes
from barbalat.controllers import BaselineAlone
from barbalat.linear.systems import StateSpace
from barbalat.problem.state_feedback import Problem
from barbalat.solvers.simulation import Simulation


def loop_of(problem: Problem, controller: BaselineAlone) -> FixedLoop | None:
    """The loop broken at the plant's input; closed, it is the model if theta = theta_0. None for several inputs or a regressor
    other than x."""
    if problem.plant.inputs > 1 or not problem.plant.is_linear:
        return None
    known, theta_0 = problem.known, controller.bind(problem.known).theta_0
    return FixedLoop.with_gain_of_1(
        problem,
        at=lambda theta: StateSpace(known.A_m + np.outer(known.b, theta), known.b, theta_0, 0.0),
        theta_0=theta_0,
        norm="W_b",
        integrates="the baseline removes a constant disturbance from the state",
    )


def certificate(problem: Problem, controller: BaselineAlone, simulation: Simulation) -> Certificate:
    """The bound on the error in the form of Theorem 1, margins and peaks for the true plant, and mu of the family."""
    draft, loop = Draft(own=bounded_response.OF_RESPONSES), loop_of(problem, controller)
    if loop is None:
        draft.note(BEYOND_ONE_LINEAR_INPUT)
        draft.missing("error_bound", ONE_LINEAR_INPUT, theorem=theorems.LINEAR_BEYOND)
        bounded_response.add_continuous(draft, problem, controller)
        add_linearised(draft, problem, controller, simulation)
    else:
        add_loop(draft, problem, loop, controller, simulation.t_end)
        add_step_of_modes(draft, problem, controller, simulation)
    return draft.finish()


def grounds(problem: Problem, controller: BaselineAlone, _: Simulation) -> dict[str, Any]:
    """The numbers of the loop."""
    theta_0 = controller.bind(problem.known).theta_0
    return {"scheme": "baseline", "P": problem.known.P.tolist(), "theta_0": theta_0.tolist()}


def known_loop(problem: Problem, controller: BaselineAlone) -> KnownLoop | None:
    """The loop that is evaluated along its command."""
    loop = loop_of(problem, controller)
    return None if loop is None else loop.known_loop()


def linear_when(problem: Problem, _: BaselineAlone) -> str | None:
    """The controller is linear on a plant whose regressor is the state."""
    return LINEAR_CONTROLLER if problem.plant.is_linear else None


def column(problem: Problem, controller: BaselineAlone, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """The scheme's name in Table 1 and its cells."""
    return "the baseline alone, u = k_0 r - theta_0'x", cells(problem, loop_of(problem, controller), certificate)
