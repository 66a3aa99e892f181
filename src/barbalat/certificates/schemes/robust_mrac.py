"""The certificate of the MRAC with a normalised law and of the robust MRAC (14)-(16), and their column of Table 1."""

from __future__ import annotations

from typing import Any

from barbalat.adaptation.modifications.epsilon_modification import EpsilonModification
from barbalat.adaptation.modifications.fixed_sigma import FixedSigma
from barbalat.certificates.assumptions import EXACT_START, FROZEN, LINEAR, MATCHED, finish
from barbalat.certificates.bounds import laws, theorem_1
from barbalat.certificates.cells import NONLINEAR, Cell, limits_text, margins_cell
from barbalat.certificates.certificate import Certificate
from barbalat.certificates.rounding import down
from barbalat.certificates.schemes.state_feedback import margins_at_rest, parameter_errors, projected
from barbalat.certificates.step_limits import frozen_laws
from barbalat.controllers import NormalizedMrac, RobustMrac
from barbalat.controllers.robust_mrac import minimum_phase_model
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.state_feedback import Problem
from barbalat.solvers.simulation import Simulation


def column(problem: Problem, controller: NormalizedMrac | RobustMrac, values: dict[str, Any]) -> tuple[str, dict[str, Cell]]:
    """The scheme's name in Table 1 and its statements."""
    sentence, law = laws.convergence(controller.law, controller.bind(problem.known).box), controller.law
    to_zero, nothing = sentence.startswith("the tracking error converges to zero"), "nothing is guaranteed" in sentence
    cut = "corners" in sentence
    pulled = isinstance(law.leakage, (FixedSigma, EpsilonModification))  # type: ignore[attr-defined]
    settled = "V of the law never grows; they converge to theta where phi/m_s is persistently exciting"
    pull = "bounded, and pulled towards zero"
    cells = {
        "stability": Cell("not proven", sentence) if nothing else Cell("proven", "for every bounded r"),
        "tracking": Cell("proven", "converges to zero for every bounded r") if to_zero else Cell("not proven", sentence),
        "transient": Cell("not proven", "no bound before the estimates have settled"),
        "estimates": Cell("not proven", sentence) if cut else Cell("proven", pull if pulled else settled),
        "modelling_error": Cell("not proven", sentence) if nothing else _normalized_robustness(problem, controller),
        "tuning": Cell("estimate", limits_text(values)),
        "margins": margins_cell(values),
    }
    if not problem.plant.is_linear:  # the proof of boundedness needs |phi(x)| <= c |x|
        cells |= dict.fromkeys(("stability", "tracking", "modelling_error"), Cell("not proven", NONLINEAR))
    if not isinstance(controller, RobustMrac):
        return "normalised MRAC", cells
    degree = minimum_phase_model(controller.bind(problem.known).c_0, problem.known).relative_degree
    power = "" if degree == 1 else f"^{degree}"
    kept = f"the auxiliary input leaves 1 - 1/(tau s + 1){power} of c_0'e, of the order of tau; no number bounds it"
    ceiling = 1 / controller.normalization.delta_0
    window = f"tau_min < tau = {controller.tau:g} s < 1/delta_0 = {down(ceiling)} s (Theorem 2; tau_min grows with Delta)"
    cells["transient"] = Cell("proven", kept)
    cells["tuning"] = Cell("estimate", f"{window}; {limits_text(values)}")
    return "robust MRAC (14)-(16)", cells


def _normalized_robustness(problem: Problem, controller: NormalizedMrac | RobustMrac) -> Cell:
    if controller.normalization.alpha_0 == 0:
        return Cell("not proven", "needs the dynamic normalisation, alpha_0 > 0 in (16); it is 0 here")
    if not projected(problem, controller) and controller.law.leakage is None:  # type: ignore[attr-defined]
        return Cell("not proven", "needs projection or leakage, and there is neither")
    return Cell(
        "proven",
        "bounded, the mean square of e of the order of Delta, for every Delta that is small enough; how small is not computed",
    )


def certificate(problem: Problem, controller: RobustMrac | NormalizedMrac, simulation: Simulation) -> Certificate:
    """What is guaranteed is Lemma 1's boundedness and convergence; its constants are not computable from the case."""
    plant = problem.plant
    loop = ClosedLoop.of(problem, controller)
    values, findings = parameter_errors(problem, loop)
    del values["nu_0"]
    values.pop("nu_0_worst", None)
    values["initial_parameter_error"] = theorem_1.initial_parameter_error(loop.equations.initial().theta_hat, plant.theta)  # type: ignore[attr-defined]
    equations: Any = loop.equations
    values |= frozen_laws.of_parametric_model(problem, controller, equations, simulation)
    values |= margins_at_rest(problem, findings)
    if isinstance(controller, RobustMrac):
        values["tau_below"] = 1 / controller.normalization.delta_0  # Theorem 2: tau in (tau_min, 1/delta_0)
        if not controller.tau < values["tau_below"]:
            findings.append(
                f"Theorem 2 asks for tau < 1/delta_0 = {values['tau_below']:.4g} s, and tau is {controller.tau:.4g} s"
            )
    assumptions = [
        MATCHED + "; with modelling error only Theorem 2's existence statement remains",
        EXACT_START,
        "c_0 makes W_m minimum phase (checked)",
        FROZEN,
        laws.convergence(controller.law, controller.bind(problem.known).box) + "; no number bounds e",
        LINEAR,
    ]
    return finish(problem, values, {"initial_parameter_error"}, assumptions, findings)
