"""The certificate of MRAC with a normalised law and of the robust MRAC (14)-(16), and their column of Table 1.

The guarantees are boundedness and convergence by Lemma 1, whose constants can't be computed from the case.
"""

from __future__ import annotations

from typing import Any

from barbalat.adaptation.guarantee import Estimates, Guarantee
from barbalat.certificates import theorems
from barbalat.certificates.assumptions import (
    BEYOND_ONE_LINEAR_INPUT,
    FROZEN_LAW,
    MEAN_SQUARE,
    beyond_the_paper,
    bounded_command,
    departures,
    small_enough,
)
from barbalat.certificates.bounds import laws, theorem_1
from barbalat.certificates.cells import NONLINEAR, estimate, limits_text, margins_cell, nothing, statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import NUMBERS_ALONE, Assumption, Entry
from barbalat.certificates.grounds import plain
from barbalat.certificates.quantities import Quantity
from barbalat.certificates.rows import down
from barbalat.certificates.schemes import midpoint
from barbalat.certificates.schemes.state_feedback import add_margins_at_rest, inside, of_the_case, projected
from barbalat.certificates.schemes.unregistered import add_at_rest
from barbalat.certificates.step_limits import any_regressor, frozen_laws
from barbalat.controllers import NormalizedMrac, RobustMrac
from barbalat.controllers.parametric_model import minimum_phase_model
from barbalat.controllers.robust_mrac import Equations
from barbalat.problem.state_feedback import Problem
from barbalat.solvers.simulation import Simulation

OWN_QUANTITIES = {"tau_below": Quantity("1/delta_0, the upper limit on tau (Theorem 2)", "s")}
MINIMUM_PHASE = Assumption("c_0 makes W_m minimum phase")
"""``bind`` rejects other c_0."""
SEVERAL_INPUTS = "not known: Theorem 2 is for one input"


def certificate(problem: Problem, controller: RobustMrac | NormalizedMrac, simulation: Simulation) -> Certificate:
    """The initial parameter error, the limits on the step, the margins with constant estimates and, with an auxiliary input, the
    limit on tau."""
    equations, draft = controller.bind(problem.known), Draft(own=OWN_QUANTITIES)
    error = theorem_1.initial_parameter_error(equations.theta_hat0, problem.plant.theta)
    draft.guarantee("initial_parameter_error", error, *(inside(problem, equations.estimate_set) or (NUMBERS_ALONE,)))
    draft.missing(
        "error_bound",
        "Lemma 1's constants cannot be computed from the case",
        *of_the_case(problem, equations.estimate_set),
        theorem=theorems.LEMMA_1,
    )
    if beyond_the_paper(problem):
        draft.note(BEYOND_ONE_LINEAR_INPUT)
        draft.estimate(frozen_laws.of_parametric_model(problem, equations, simulation), FROZEN_LAW)
        add_at_rest(draft, problem, controller)
        return draft.finish()
    limits = frozen_laws.of_parametric_model(problem, equations, simulation)
    draft.estimate(limits, FROZEN_LAW)
    draft.estimate(any_regressor.of_parametric_model_at_model(problem, equations, simulation, limits), FROZEN_LAW)
    add_margins_at_rest(draft, problem)
    if controller.tau is not None:
        draft.advise({"tau_below": 1 / controller.normalization.delta_0})
        below = _below_the_ceiling(controller, controller.tau)
        if below.broken:
            draft.note(f"{below.sentence}, but {below.broken}")
    return draft.finish()


def grounds(problem: Problem, controller: NormalizedMrac | RobustMrac, _: Simulation) -> dict[str, Any]:
    """The initial estimates."""
    equations = controller.bind(problem.known)
    projects = equations.estimate_set is not None
    return {"scheme": "robust-mrac", "theta_hat0": plain(equations.theta_hat0), "projection": projects}


def midpoint_form(problem: Problem, controller: NormalizedMrac | RobustMrac, _: float) -> midpoint.MidpointForm:
    """Return the properties that the sampled form preserves: those of the implicit step of its law."""
    return midpoint.of_law(controller.law, controller.bind(problem.known).estimate_set)


def column(problem: Problem, controller: NormalizedMrac | RobustMrac, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """The scheme's name in Table 1 and its cells."""
    estimate_set = controller.bind(problem.known).estimate_set
    found = laws.guarantee_of(controller.law, estimate_set)
    rests_on = (*of_the_case(problem, estimate_set), MINIMUM_PHASE, laws.bounds_the_parameters(found, problem.parameters))
    why = laws.kept_from_zero(found)

    def claimed(key: str, text: str, holds: bool) -> Entry:
        return statement(key, text, *rests_on) if holds else nothing(key, why, *rests_on)

    cells = {
        "stability": claimed("stability", "for every bounded r", found.bounded),
        "tracking": claimed("tracking", "converges to zero for every bounded r", found.error_to_zero),
        "transient": nothing("transient", "no bound until the estimates have settled"),
        "estimates": claimed("estimates", _estimates(found, problem.plant.is_linear), found.estimates is not Estimates.UNKNOWN),
        "modelling_error": _robustness(problem, controller, found),
        "tuning": estimate("tuning", limits_text(certificate)),
        "margins": margins_cell(certificate),
    }
    if controller.tau is not None:
        below = _below_the_ceiling(controller, controller.tau)
        cells["transient"] = _transient(problem, controller, *rests_on, below) if found.bounded else nothing("transient", why)
        cells["tuning"] = estimate("tuning", f"{_window(controller, controller.tau)}; {limits_text(certificate)}")
    if not problem.plant.is_linear:  # the proof of boundedness needs |phi(x)| <= c |x|
        cells |= {key: nothing(key, NONLINEAR, *rests_on) for key in ("stability", "tracking", "modelling_error", "transient")}
    return "normalised MRAC" if controller.tau is None else "robust MRAC (14)-(16)", cells


def _below_the_ceiling(controller: NormalizedMrac | RobustMrac, tau: float) -> Assumption:
    ceiling = 1 / controller.normalization.delta_0  # Theorem 2: tau in (tau_min, 1/delta_0)
    broken = "" if tau < ceiling else f"tau is {tau:.4g} s"
    return Assumption(f"Theorem 2 requires tau < 1/delta_0 = {ceiling:.4g} s", broken)


def _window(controller: NormalizedMrac | RobustMrac, tau: float) -> str:
    ceiling = down(1 / controller.normalization.delta_0)
    if _below_the_ceiling(controller, tau).broken:
        return f"tau = {tau:g} s is not below 1/delta_0 = {ceiling} s, as Theorem 2 requires"
    asked = f"tau = {tau:g} s is below 1/delta_0 = {ceiling} s, as Theorem 2 requires"
    return f"{asked}; tau_min, which grows with Delta, is not computed"


def _transient(problem: Problem, controller: NormalizedMrac | RobustMrac, *rests_on: Assumption) -> Entry:
    equations, degree = controller.bind(problem.known), 1
    if isinstance(equations, Equations):
        degree = minimum_phase_model(equations.c_0, problem.known).relative_degree
    power = "" if degree == 1 else f"^{degree}"
    kept = f"the auxiliary input leaves 1 - 1/(tau s + 1){power} of c_0'e, of the order of tau; there is no numerical bound"
    return statement("transient", kept, *rests_on)


def _estimates(found: Guarantee, linear: bool) -> str:
    if found.estimates is Estimates.PULLED:
        return "bounded, and pulled towards zero"
    exciting = "; if phi/m_s is persistently exciting, which is not checked here, the estimates converge to theta"
    return f"V of the law never grows{exciting if found.bounded and linear else ''}"


def _robustness(problem: Problem, controller: NormalizedMrac | RobustMrac, found: Guarantee) -> Entry:
    estimate_set = controller.bind(problem.known).estimate_set
    if not found.bounded:
        return nothing("modelling_error", found.why)
    if problem.plant.inputs > 1:
        return nothing("modelling_error", SEVERAL_INPUTS)
    if controller.normalization.alpha_0 == 0:
        return nothing("modelling_error", "needs the dynamic normalisation, alpha_0 > 0 in (16); it is 0 here")
    if not projected(estimate_set) and not found.leaks:
        return nothing("modelling_error", "needs projection or leakage, but the law has neither")
    present = ", ".join(departures(problem))
    ceiling = () if controller.tau is None else (_below_the_ceiling(controller, controller.tau),)
    enough = laws.bounds_the_parameters(found, problem.parameters)
    rests_on = (small_enough(present), bounded_command(problem), *inside(problem, estimate_set), MINIMUM_PHASE, enough, *ceiling)
    return statement("modelling_error", MEAN_SQUARE, *rests_on)
