"""The certificate of the standard MRAC (3)-(4): the bound (9), and its column of Table 1."""

from __future__ import annotations

from typing import Any

from barbalat.certificates.assumptions import (
    EXACT_START,
    FROZEN,
    IN_THE_SET,
    LINEAR,
    MATCHED,
    OF_THE_PROBLEM,
    finish,
)
from barbalat.certificates.bounds import laws, theorem_1
from barbalat.certificates.bounds.model import model_bounds
from barbalat.certificates.cells import Cell, limits_text, margins_cell
from barbalat.certificates.certificate import Certificate
from barbalat.certificates.linear_loops.margin_values import adapting_margins
from barbalat.certificates.rounding import up
from barbalat.certificates.schemes.state_feedback import (
    lyapunov_estimates,
    margins_at_rest,
    parameter_errors,
    unproven_robustness,
)
from barbalat.certificates.step_limits import frozen_laws
from barbalat.controllers import Mrac
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.state_feedback import Problem
from barbalat.solvers.simulation import Simulation


def column(problem: Problem, controller: Mrac, values: dict[str, Any]) -> tuple[str, dict[str, Cell]]:
    """The scheme's name in Table 1 and its statements."""
    void = laws.why_no_bound(controller, problem)
    cells = {
        "stability": Cell("proven", "for every Gamma > 0 and every bounded r"),
        "tracking": Cell("proven", "converges to zero for every bounded r") if void is None else Cell("not proven", void),
        "estimates": lyapunov_estimates(problem, controller),
        "modelling_error": unproven_robustness(problem, controller),
        "tuning": Cell("estimate", "the bound falls with 1/sqrt(Gamma); " + limits_text(values)),
        "margins": margins_cell(values),
    }
    if "error_bound" in values:
        text = f"|e| <= nu_0/sqrt(Gamma) = {up(values['error_bound'])} at all times, (9)"
        if "error_bound_worst" in values:
            text += f"; {up(values['error_bound_worst'])} for the worst theta of the known set"
        cells["transient"] = Cell("proven", text)
    else:
        cells["transient"] = Cell("not proven", "no bound")
    return "standard MRAC (3)-(4)", cells


def certificate(problem: Problem, controller: Mrac, simulation: Simulation) -> Certificate:
    """The bound (9), the limits of gain and step, the margins of the linear loops."""
    loop = ClosedLoop.of(problem, controller)
    values, findings = parameter_errors(problem, loop)
    guaranteed = {"nu_0", "nu_0_worst"}
    void = laws.why_no_bound(controller, problem)
    if void is not None:
        findings.append(void)
    else:
        values["error_bound"] = laws.error_level(problem, controller, values["nu_0"])
        if "nu_0_worst" in values:
            values["error_bound_worst"] = theorem_1.mrac_bound(values["nu_0_worst"], laws.least_gain(controller.gamma))
        guaranteed |= {"error_bound", "error_bound_worst"}
    equations: Any = loop.equations
    model = model_bounds(problem)
    values |= theorem_1.ingredients(problem.known, equations.box, model)
    guaranteed |= OF_THE_PROBLEM & values.keys()
    values |= frozen_laws.with_modifications(
        frozen_laws.of_lyapunov_law(problem, controller.gamma, simulation, model.x_m_euclidean, values["nu_0"]),
        controller,
        simulation,
    )
    values |= margins_at_rest(problem, findings)
    values |= adapting_margins(problem, loop, findings)
    assumptions = [MATCHED, EXACT_START, FROZEN, LINEAR]
    if equations.box is not None:
        assumptions.insert(1, IN_THE_SET)
    return finish(problem, values, guaranteed, assumptions, findings)
