"""The certificate of active disturbance rejection, a linear controller whose loop and margins are exact.

If the observer starts at x(0) with f_hat = 0, theta = theta_0, and b_0 is the input gain, the observer has no error: f_hat stays
zero and x equals x_m. The difference theta - theta_0 adds a matched disturbance (see ``fixed_loop``, where T is the response of x
to it).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from barbalat.certificates import theorems
from barbalat.certificates.assumptions import BEYOND_ONE_LINEAR_INPUT, nominal, of_linear_loop
from barbalat.certificates.bounds.known_command import KnownLoop
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Assumption, Entry
from barbalat.certificates.linear_loops.margin_values import with_dynamics
from barbalat.certificates.schemes import bounded_response
from barbalat.certificates.schemes.fixed_loop import FixedLoop, add_loop, cells
from barbalat.certificates.schemes.sampled_loop import LINEAR_CONTROLLER
from barbalat.certificates.schemes.unregistered import WHOLE_LOOP, add_linearised
from barbalat.certificates.step_limits.oscillator import largest_step
from barbalat.controllers.adrc import Adrc, Equations
from barbalat.linear.systems import StateSpace, sensitivity
from barbalat.problem.state_feedback import Known, Problem
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

STARTS_AT_THE_STATE = Assumption("the observer starts at x(0), with f_hat = 0")
STEP = "step_max is that of the linear loop, without the delay and limits"


def loop_at(theta: Array, equations: Equations, known: Known) -> StateSpace:
    """The loop broken at the plant's input, from v to -u, for the plant with ``theta``; the plant's states come first."""
    o, n, b_0 = equations.observer, known.n, equations.b_0
    feedback = np.hstack([equations.theta_0.T, np.eye(1)]) / b_0  # of (x_hat, f_hat)
    of_x, of_xi = (feedback @ o.N)[0], (feedback @ o.M)[0]
    A = np.block(
        [
            [known.A_m + np.outer(known.b, theta), np.zeros((n, len(o.F)))],
            [o.G - np.outer(b_0 * o.H[:, 0], of_x), o.F - np.outer(b_0 * o.H[:, 0], of_xi)],
        ]
    )
    return StateSpace(A, np.append(known.b, np.zeros(len(o.F))), np.append(of_x, of_xi), 0.0)


def loop_of(problem: Problem, controller: Adrc) -> FixedLoop | None:
    """The loop; None for several inputs or a regressor other than x."""
    if problem.plant.inputs > 1 or not problem.plant.is_linear:
        return None
    known, omega = problem.known, float(problem.plant.paths[0].gain)
    equations = controller.bind(known)
    other = "" if omega == controller.b_0 else f"input gain {omega:g}, where b_0 = {controller.b_0:g} is assumed"
    return FixedLoop(
        at=lambda theta: loop_at(theta, equations, known),
        theta_0=equations.theta_0[:, 0],
        norm="T",
        own=(STARTS_AT_THE_STATE, Assumption("b_0 is the input's gain", other)),
        integrates="f_hat follows every constant disturbance: T(0) = 0",
        gain=controller.b_0,
    )


def certificate(problem: Problem, controller: Adrc, simulation: Simulation) -> Certificate:
    """The bound on the error in the form of Theorem 1, exact margins and peaks for the true plant, and mu of the family."""
    loop, draft = loop_of(problem, controller), Draft(own=bounded_response.OF_RESPONSES)
    if loop is None:
        draft.note(BEYOND_ONE_LINEAR_INPUT)
        why = "a bound is known only for one input with phi(x) = x"
        draft.missing("error_bound", why, *of_linear_loop(*nominal(problem)), theorem=theorems.LINEAR_BEYOND)
        bounded_response.add_continuous(draft, problem, controller)
        add_linearised(draft, problem, controller, simulation)
        return draft.finish()
    add_loop(draft, problem, loop, controller, simulation.t_end)
    modes = np.linalg.eigvals(sensitivity(with_dynamics(problem, loop.at(problem.plant.theta))).A)
    draft.estimate({"step_max": largest_step(simulation, modes)}, STEP, of=WHOLE_LOOP)
    return draft.finish()


def grounds(problem: Problem, controller: Adrc, _: Simulation) -> dict[str, Any]:
    """The numbers of the loop with the observer."""
    equations = controller.bind(problem.known)
    observer = {key: getattr(equations.observer, key).tolist() for key in "FGHMN"}
    own = {"observer": observer, "b_0": controller.b_0, "theta_0": equations.theta_0[:, 0].tolist()}
    return {"scheme": "adrc", "P": problem.known.P.tolist()} | own


def known_loop(problem: Problem, controller: Adrc) -> KnownLoop | None:
    """The loop that is evaluated along its command."""
    loop = loop_of(problem, controller)
    return None if loop is None else loop.known_loop()


def linear_when(problem: Problem, _: Adrc) -> str | None:
    """The controller is linear on every plant with phi(x) = x, including those with several inputs."""
    return LINEAR_CONTROLLER if problem.plant.is_linear else None


def column(problem: Problem, controller: Adrc, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """The scheme's name in Table 1 and its cells."""
    kind = "disturbance observer" if controller.output is None else "extended-state observer"
    return f"active disturbance rejection, {kind}", cells(problem, loop_of(problem, controller), certificate)
