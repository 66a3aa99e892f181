"""What the certificates of the state-feedback schemes share."""

from __future__ import annotations

from typing import Any

from barbalat.certificates.assumptions import (
    ASSUMED,
    BEYOND,
    EXACT_START,
    FROZEN,
    IN_THE_SET,
    MATCHED,
    ON_THE_BOX,
    OUTSIDE,
    finish,
)
from barbalat.certificates.bounds import laws, theorem_1
from barbalat.certificates.cells import Cell
from barbalat.certificates.certificate import Certificate
from barbalat.certificates.linear_loops import over_known_set
from barbalat.certificates.linear_loops.ideal import known_parameters
from barbalat.certificates.linear_loops.margin_values import margins_of
from barbalat.certificates.step_limits import any_regressor, frozen_laws
from barbalat.controllers import L1Adaptive, Mrac, NormalizedMrac, RobustMrac
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.solvers.simulation import Simulation


def lyapunov_estimates(problem: Problem, controller: Mrac | L1Adaptive) -> Cell:
    """The estimates of the law (4), (7)."""
    if (void := laws.why_no_bound(controller, problem)) is not None:
        return Cell("not proven", f"bounded; {void}")
    convergence = "they converge to theta where the regressor is persistently exciting"
    if controller.learning is not None:
        convergence = "they converge to theta once the memory has seen every direction"
    return Cell("proven", f"theta_tilde'Gamma^-1 theta_tilde never exceeds its initial value; {convergence}")


def unproven_robustness(problem: Problem, controller: Mrac | L1Adaptive) -> Cell:
    """The unnormalised law beside a modelling error: nothing is proven of x."""
    if controller.leakage is not None or controller.dead_zone is not None:
        return Cell("not proven", "bounded estimates; that x stays bounded is proven for bounded disturbances, not for Delta_m")
    kept = "projection keeps the estimates in the known set; " if projected(problem, controller) else "the estimates may drift; "
    return Cell("not proven", kept + "that x stays bounded is not proven without normalisation")


def projected(problem: Problem, controller: Mrac | L1Adaptive | NormalizedMrac | RobustMrac) -> bool:
    """Whether the estimates are kept in the known set."""
    return problem.uncertainty is not None and controller.projection is not False


def parameter_errors(problem: Problem, loop: ClosedLoop) -> tuple[dict[str, Any], list[str]]:
    """nu_0 for the case's theta, and for the worst theta in the known set."""
    theta_hat0 = loop.equations.initial().theta_hat  # type: ignore[attr-defined]
    known, box = problem.known, problem.uncertainty
    findings: list[str] = []
    values: dict[str, Any] = {"nu_0": theorem_1.nu_0(theorem_1.initial_parameter_error(theta_hat0, problem.plant.theta), known)}
    if box is not None:
        worst = theorem_1.largest_parameter_error(theta_hat0, box)
        values["nu_0_worst"] = theorem_1.nu_0(worst, known)
        if not box.contains(problem.plant.theta):
            findings.append(OUTSIDE)
    return values, findings


def beyond_the_paper(problem: Problem, controller: Controller, simulation: Simulation) -> Certificate:
    """Several inputs, a regressor other than x, an unknown input gain: the Lyapunov bound, which none of these changes."""
    loop = ClosedLoop.of(problem, controller)
    if loop.parameters == 0:
        return finish(problem, {}, set(), [MATCHED], [BEYOND])
    equations: Any = loop.equations
    error = theorem_1.initial_parameter_error(equations.initial().theta_hat, problem.parameters)
    values: dict[str, Any] = {}
    guaranteed: set[str] = set()
    assumptions = [MATCHED, EXACT_START, "the regressor phi(x) is known", FROZEN]
    findings = [BEYOND]
    if isinstance(controller, (Mrac, L1Adaptive)):
        values["nu_0"] = theorem_1.nu_0(error, problem.known)
        guaranteed = {"nu_0"}
        void = laws.why_no_bound(controller, problem)
        if void is not None:
            findings.append(void)
        elif isinstance(controller, Mrac):
            values["error_bound"] = laws.error_level(problem, controller, values["nu_0"])
            guaranteed |= {"error_bound"}
        values |= any_regressor.of_lyapunov_law(problem, controller, simulation, values["nu_0"])
        assumptions += [ON_THE_BOX] if "error_bound" in values else [ON_THE_BOX, ASSUMED]
    elif isinstance(controller, (RobustMrac, NormalizedMrac)):
        values["initial_parameter_error"] = error
        guaranteed = {"initial_parameter_error"}
        values |= frozen_laws.of_parametric_model(problem, controller, equations, simulation)
    if equations.box is not None:
        assumptions.insert(1, IN_THE_SET)
    if problem.known.box is not None and not problem.known.box.contains(problem.parameters):
        findings.append(OUTSIDE)
    return finish(problem, values, guaranteed, assumptions, findings)


def margins_at_rest(problem: Problem, findings: list[str]) -> dict[str, Any]:
    """Of the loop with C = 1, at the case's theta and over the known set."""
    plant = problem.plant
    values = margins_of(problem, known_parameters(plant, plant.theta), over_known_set.AT_REST, findings)
    return values | over_known_set.at_rest(problem, findings)
