"""The certificate of MRAC with a closed-loop reference model: the bounds from its Lyapunov function, and its column of Table
1.

V = e_c'P e_c + theta_tilde'Gamma^-1 theta_tilde has V' <= -|e_c|^2 with P of A_m + L, so |e_c|_2 <= nu_0/sqrt(Gamma) with that P.
The error with respect to the open-loop model (2) is e = [I - (sI - A_m)^-1 L] e_c; the L1 norm of this operator transfers the
bound.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from barbalat.certificates.assumptions import BEYOND_ONE_LINEAR_INPUT, FROZEN_LAW, beyond_the_paper, theta_in_the_set
from barbalat.certificates.bounds import disturbed, known_command, laws, theorem_1
from barbalat.certificates.bounds.model import model_bounds
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Entry
from barbalat.certificates.grounds import of_lyapunov_law
from barbalat.certificates.schemes.mrac import lyapunov_cells
from barbalat.certificates.schemes.state_feedback import (
    add_margins_at_rest,
    add_no_bound_over_the_set,
    add_parameter_errors,
    carried_along,
    of_the_case,
    of_the_lyapunov_law,
)
from barbalat.certificates.schemes.unregistered import add_adapting, add_at_rest
from barbalat.certificates.step_limits import frozen_laws
from barbalat.certificates.step_limits.oscillator import Oscillator
from barbalat.controllers import MracClosedLoop
from barbalat.linear.enclosure import OUTWARD_FACTOR
from barbalat.linear.l1_norms import l1_norm
from barbalat.problem.state_feedback import Problem
from barbalat.solvers.simulation import Simulation


def certificate(problem: Problem, controller: MracClosedLoop, simulation: Simulation) -> Certificate:
    """The bound on e, the limits on gain and step, the margins with constant estimates."""
    known, draft, n = problem.known, Draft(), problem.known.n
    equations = controller.bind(known)
    closed = replace(known, A_m=known.A_m + equations.L)  # this is the controller's P
    carried = l1_norm(known.A_m, -equations.L, np.eye(n), np.eye(n))
    add_parameter_errors(draft, problem, equations, closed)
    draft.note("nu_0 uses the controller's P, which belongs to A_m + L")
    nu_0, nu_0_worst = draft["nu_0"], draft.get("nu_0_worst")
    level = disturbed.level(problem, controller, nu_0, closed)
    bound = carried.upper * level.value * OUTWARD_FACTOR
    corners = laws.keeps_V_in_corners(controller.gamma, equations.estimate_set)
    rests_on = (*of_the_case(problem, equations.estimate_set, bound, carried_along(problem, equations.estimate_set)), corners)
    draft.guarantee("error_bound", bound, *rests_on)
    if nu_0_worst is not None and not level.pushed:
        worst = carried.upper * theorem_1.mrac_bound(nu_0_worst, laws.least_gain(controller.gamma)) * OUTWARD_FACTOR
        draft.guarantee("error_bound_worst", worst, *rests_on, theta_in_the_set(problem))
        command = carried.upper * known_command.of_adapting(problem, closed, controller.gamma, equations.theta_hat0)
        draft.guarantee(known_command.KEY, command * OUTWARD_FACTOR, *rests_on, theta_in_the_set(problem))
    elif level.pushed:
        add_no_bound_over_the_set(draft, problem)
    if beyond_the_paper(problem):
        draft.note(BEYOND_ONE_LINEAR_INPUT)
        add_at_rest(draft, problem, controller)
        return draft.finish()
    oscillator = Oscillator(closed, simulation.solver, np.append(np.linalg.eigvals(known.A_m), frozen_laws.input_poles(problem)))
    reach = np.sqrt(n) * carried.upper
    offset, factor = model_bounds(problem).x_m_euclidean + reach * level.pushed, reach * level.nu
    limits = frozen_laws.of_lyapunov_law(problem, controller.gamma, simulation, offset, factor, oscillator=oscillator)
    draft.estimate(limits, FROZEN_LAW)
    draft.estimate(frozen_laws.of_the_motion(problem, controller.gamma, simulation, oscillator), FROZEN_LAW)
    add_margins_at_rest(draft, problem)
    add_adapting(draft, problem, controller)
    return draft.finish()


def grounds(problem: Problem, controller: MracClosedLoop, _: Simulation) -> dict[str, Any]:
    """The numbers of Theorem 1 (i) with A_m + L in place of A_m."""
    equations = controller.bind(problem.known)
    closed = replace(problem.known, A_m=problem.known.A_m + equations.L)
    carries = disturbed.is_disturbed(problem)
    return of_lyapunov_law("mrac-closed-loop", equations, controller.gamma, closed, carries=carries) | {"L": equations.L.tolist()}


def column(problem: Problem, controller: MracClosedLoop, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """The scheme's name in Table 1 and its cells."""
    return "MRAC with a closed-loop reference model", lyapunov_cells(
        problem, certificate, of_the_lyapunov_law(problem, controller, certificate)
    )
