"""The certificate of the baseline alone: ``fixed_loop`` around u = k_0 r - theta_0'x; for other plants than linear ones with
one input, its margins."""

from __future__ import annotations

import numpy as np

from barbalat.certificates.assumptions import BEYOND_ONE_LINEAR_INPUT, beyond_the_paper
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Entry
from barbalat.certificates.schemes.fixed_loop import FixedLoop, add_loop, cells
from barbalat.certificates.schemes.sampled_loop import LINEAR_CONTROLLER
from barbalat.certificates.schemes.unregistered import add_linearised, add_step_of_modes
from barbalat.controllers import BaselineAlone
from barbalat.linear.systems import StateSpace
from barbalat.problem.state_feedback import Problem
from barbalat.solvers.simulation import Simulation


def loop_of(problem: Problem, controller: BaselineAlone) -> FixedLoop:
    """The loop broken at the plant's input; with theta = theta_0 the closed loop is the model."""
    known, theta_0 = problem.known, controller.bind(problem.known).theta_0
    return FixedLoop(
        at=lambda theta: StateSpace(known.A_m + np.outer(known.b, theta), known.b, theta_0, 0.0),
        theta_0=theta_0,
        norm="W_b",
        own=(),
        integrates="the baseline removes a constant disturbance from the state",
    )


def certificate(problem: Problem, controller: BaselineAlone, simulation: Simulation) -> Certificate:
    """The bound of the error in the form of Theorem 1, margins and peaks for the true plant, mu of the family."""
    draft = Draft()
    if beyond_the_paper(problem):
        draft.note(BEYOND_ONE_LINEAR_INPUT)
        add_linearised(draft, problem, controller, simulation)
    else:
        add_loop(draft, problem, loop_of(problem, controller), simulation.t_end)
        add_step_of_modes(draft, problem, controller, simulation)
    return draft.finish()


def linear_when(problem: Problem, _: BaselineAlone) -> str | None:
    """The controller is linear on a plant whose regressor is the state."""
    return LINEAR_CONTROLLER if problem.plant.is_linear else None


def column(problem: Problem, controller: BaselineAlone, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """The scheme's name in Table 1 and its cells."""
    loop = None if beyond_the_paper(problem) else loop_of(problem, controller)
    return "the baseline alone, u = k_0 r - theta_0'x", cells(problem, loop, certificate)
