"""The certificate of a linear controller u = k_0 r - theta_0'x + K(s)[c'(x_m - x)]: ``fixed_loop`` with S = 1/(1 + K W_m).

The error obeys e = W_b(s) S(s)[(theta - theta_0)'x].
"""

from __future__ import annotations

from typing import Any

import numpy as np

from barbalat.certificates.bounds.known_command import KnownLoop
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Assumption, Entry
from barbalat.certificates.grounds import of_system
from barbalat.certificates.schemes import bounded_response
from barbalat.certificates.schemes.fixed_loop import FixedLoop, add_loop, cells
from barbalat.certificates.schemes.sampled_loop import LINEAR_CONTROLLER
from barbalat.certificates.schemes.unregistered import add_step_of_modes
from barbalat.controllers import LinearFeedback, linear_feedback
from barbalat.linear.systems import StateSpace
from barbalat.problem.state_feedback import Known, Problem
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array


def loop_at(theta: Array, equations: linear_feedback.Equations, known: Known) -> StateSpace:
    """The loop broken at the plant's input, from v to -u, for the plant with ``theta``; the plant's states come first."""
    K, n = equations.K, known.n
    A = np.block([[known.A_m + np.outer(known.b, theta), np.zeros((n, K.order))], [np.outer(K.B, equations.c), K.A]])
    C = np.concatenate([equations.theta_0 + K.D * equations.c, K.C])
    return StateSpace(A, np.concatenate([known.b, np.zeros(K.order)]), C, 0.0)


def loop_of(problem: Problem, controller: LinearFeedback) -> FixedLoop:
    """The loop with K(s), whose margins are computed."""
    known = problem.known
    equations = controller.bind(known)
    return FixedLoop.with_gain_of_1(
        problem,
        at=lambda theta: loop_at(theta, equations, known),
        theta_0=equations.theta_0,
        norm="W_b S",
        own=(Assumption("K(s) starts at rest"),),
        integrates="K(s) has a pole at zero: S(0) = 0",
        unmodelled=controller.unmodelled,
    )


def certificate(problem: Problem, controller: LinearFeedback, simulation: Simulation) -> Certificate:
    """The bound on the error in the form of Theorem 1, margins and peaks for the true plant, and mu of the family."""
    loop, draft = loop_of(problem, controller), Draft(own=bounded_response.OF_RESPONSES)
    add_loop(draft, problem, loop, controller, simulation.t_end)
    add_step_of_modes(draft, problem, controller, simulation)
    return draft.finish()


def grounds(problem: Problem, controller: LinearFeedback, _: Simulation) -> dict[str, Any]:
    """The numbers of the loop with K(s)."""
    equations = controller.bind(problem.known)
    own = {"K": of_system(equations.K), "c": equations.c.tolist(), "theta_0": equations.theta_0.tolist()}
    return {"scheme": "linear", "P": problem.known.P.tolist()} | own


def known_loop(problem: Problem, controller: LinearFeedback) -> KnownLoop:
    """The loop that is evaluated along its command."""
    return loop_of(problem, controller).known_loop()


def linear_when(problem: Problem, _: LinearFeedback) -> str | None:
    """The controller is linear on every plant that it supports."""
    return LINEAR_CONTROLLER if problem.plant.is_linear else None


def column(problem: Problem, controller: LinearFeedback, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """The scheme's name in Table 1 and its cells."""
    return "linear feedback", cells(problem, loop_of(problem, controller), certificate)
