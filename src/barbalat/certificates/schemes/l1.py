"""The certificate of L1-AC (5)-(8), which is MRAC with a filter: the condition on C(s), the bound (10), and the column of Table
1."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from barbalat.certificates import theorems
from barbalat.certificates.assumptions import (
    FREQUENCIES_TRIED,
    FROZEN_LAW,
    beyond_the_paper,
    constant_in_the_end,
    theta_in_the_set,
)
from barbalat.certificates.bounds import any_command, disturbed, known_command, laws, theorem_1
from barbalat.certificates.bounds.model import ModelBounds, model_bounds
from barbalat.certificates.cells import denied, estimate, limits_text, margins_cell, nothing, statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import NUMBERS_ALONE, Assumption, Entry
from barbalat.certificates.grounds import of_lyapunov_law, of_system
from barbalat.certificates.linear_loops import over_known_set
from barbalat.certificates.linear_loops.ideal import fast_adaptation
from barbalat.certificates.linear_loops.margin_values import add_adapting_margins, add_margins, finite
from barbalat.certificates.linear_loops.over_known_set import robustness
from barbalat.certificates.quantities import Quantity
from barbalat.certificates.requested_keys import is_needed
from barbalat.certificates.rows import down, up
from barbalat.certificates.schemes import midpoint, mrac
from barbalat.certificates.schemes.state_feedback import (
    add_ingredients,
    add_margins_at_rest,
    add_no_bound_over_the_set,
    add_parameter_errors,
    carried,
    lyapunov_estimates,
    of_lyapunov_law_beyond,
    of_the_case,
    of_the_lyapunov_law,
    projected,
    unproven_robustness,
)
from barbalat.certificates.schemes.unregistered import add_at_rest
from barbalat.certificates.step_limits import any_regressor, frozen_laws
from barbalat.controllers import L1Adaptive
from barbalat.controllers.l1 import Equations
from barbalat.linear.enclosure import Enclosure
from barbalat.linear.systems import StateSpace
from barbalat.problem.state_feedback import Problem
from barbalat.solvers.simulation import Simulation

OWN_QUANTITIES = {
    "kappa_admissible": Quantity(
        "largest kappa found for which the condition holds with C = 1/(kappa s + 1)", "s", below=True, timeless=True
    ),
    "kappa_max": Quantity("1/(theta_max ||sW_b||_1) of Theorem 1", "s", below=True, timeless=True),
    "nu_1": Quantity("of (10)"),
    "nu_2": Quantity("of (10)"),
    "reference_error_bound": Quantity(
        "bound on every component of x - x_ref at all times; x_ref is the filtered loop with theta known"
    ),
}
FILTER_AT_REST = Assumption("the filter starts at rest")
"""This holds by construction."""
REACH_ASSUMED = "|x| in the adaptation frequency is the model's bound plus nu_0/sqrt(Gamma): an estimate"


class StateReach(NamedTuple):
    """|x|_2 <= offset + factor/sqrt(Gamma), at all times."""

    offset: float
    factor: float


def certificate(problem: Problem, controller: L1Adaptive, simulation: Simulation) -> Certificate:
    """The condition on C(s), the bound (10), the limits on gain and step, the margins of the linear loops."""
    if beyond_the_paper(problem):
        return _beyond_the_paper(problem, controller, simulation)
    equations, draft = controller.bind(problem.known), Draft(own=OWN_QUANTITIES)
    C, model = equations.C, model_bounds(problem)
    add_parameter_errors(draft, problem, equations)
    add_ingredients(draft, problem, equations.estimate_set, model, problem.known.departures)
    reach: StateReach | None = None
    assumed: tuple[str, ...] = (FROZEN_LAW,)
    if equations.estimate_set is None:
        _without_projection(draft, problem, controller)
    else:
        reach = _add_bound_10(draft, problem, controller, C, model)
        if reach is not None and disturbed.is_disturbed(problem):
            add_no_bound_over_the_set(draft, problem)
        elif reach is not None and (is_needed(known_command.KEY) or is_needed(any_command.KEY)):
            _add_bounds_over_cells(draft, problem, controller, simulation.t_end)
    if reach is None:  # no bound on x is known: use the model's bound as an assumption, and say so
        reach, assumed = StateReach(model.x_m_euclidean, draft["nu_0"]), (FROZEN_LAW, REACH_ASSUMED)
    limits = frozen_laws.of_lyapunov_law(
        problem, controller.gamma, simulation, reach.offset, reach.factor, np.linalg.eigvals(C.A)
    )
    draft.estimate(frozen_laws.with_modifications(limits, controller, simulation), *assumed)
    if not laws.is_modified(controller):
        motion = frozen_laws.of_the_motion(problem, controller.gamma, simulation, filter_poles=np.linalg.eigvals(C.A))
        draft.estimate(motion, FROZEN_LAW)
    if controller.filter is None:
        add_margins_at_rest(draft, problem)
    elif problem.plant.baseline is not None:
        add_at_rest(draft, problem, controller)
    else:
        _add_margins_of_the_limit(draft, problem, equations)
    if controller.filter is None or problem.plant.baseline is None:
        add_adapting_margins(draft, problem, controller)
    return draft.finish()


def _beyond_the_paper(problem: Problem, controller: L1Adaptive, simulation: Simulation) -> Certificate:
    excited = any_regressor.Excited(problem, controller, divides_by_gain=False)
    if controller.filter is None:
        return of_lyapunov_law_beyond(excited, simulation)
    poles = np.linalg.eigvals(controller.filter.realise().A)
    return of_lyapunov_law_beyond(excited, simulation, poles, no_bound="no bound is known for this scheme on this plant")


def grounds(problem: Problem, controller: L1Adaptive, _: Simulation) -> dict[str, Any]:
    """The numbers of Theorem 1 (ii); with C = 1, the numbers of (i)."""
    equations = controller.bind(problem.known)
    scheme = "mrac" if controller.filter is None else "l1"
    carries = disturbed.is_disturbed(problem)
    found = of_lyapunov_law(scheme, equations, controller.gamma, problem.known, controller, carries=carries)
    return found | {"filter": of_system(equations.C)}


def midpoint_form(problem: Problem, controller: L1Adaptive, sample_time: float) -> midpoint.MidpointForm:
    """The midpoint form of the predictor; with C = 1, the midpoint form of MRAC."""
    delayed = () if controller.filter is not None else mrac.one_sample_of_delay(problem, sample_time)
    return midpoint.of_predictor(problem, controller, *delayed)


def _without_projection(draft: Draft, problem: Problem, controller: L1Adaptive) -> None:
    """Without projection there is no condition on C(s); with C = 1 the bound (9) still holds."""
    why, void = "without projection there is no theta_max", laws.why_no_bound(controller, problem)
    draft.missing("condition", why)
    if controller.filter is None and void is None:
        level = disturbed.level(problem, controller, draft["nu_0"])
        draft.guarantee("error_bound", level.value, *of_the_case(problem, None, acting=carried(problem, controller)))
    else:
        missed = laws.theorem_of_modified(controller, problem) or theorems.FILTER_WITHOUT_SET
        reason = void or f"{why}, so the bound (10) has no meaning"
        draft.missing("error_bound", reason, *of_the_case(problem, None), theorem=missed)


def add_condition(draft: Draft, problem: Problem, C: StateSpace) -> tuple[theorem_1.FilterCondition, Enclosure]:
    """Add ||W_b (1 - C)||_1 theta_max < 1 with the filters that would satisfy it, and ||s W_b||_1."""
    known, theta_max = problem.known, draft["theta_max"]
    found, slope = theorem_1.filter_condition(known, C, theta_max), theorem_1.derivative_norm(known)
    draft.guarantee("norms", {"W_b(1-C)": found.norm.ends, "sW_b": slope.ends}, NUMBERS_ALONE)
    draft.guarantee("condition", {"value_upper": found.value_upper, "limit": 1.0, "holds": found.holds}, NUMBERS_ALONE)
    if is_needed("kappa_admissible"):
        draft.guarantee("kappa_admissible", finite(theorem_1.kappa_admissible(known, theta_max)), NUMBERS_ALONE)
    draft.guarantee("kappa_max", finite(theorem_1.kappa_max(slope, theta_max)), NUMBERS_ALONE)
    return found, slope


def _add_bound_10(draft: Draft, problem: Problem, controller: L1Adaptive, C: StateSpace, model: ModelBounds) -> StateReach | None:
    """Add the condition and, if it holds, the bound. Return None if there is no bound; the entry gives the reason."""
    known, theta_max, nu_0 = problem.known, draft["theta_max"], draft["nu_0"]
    found, slope = add_condition(draft, problem, C)
    void = laws.why_no_bound(controller, problem)
    if void is not None:
        theorem = laws.theorem_of_modified(controller, problem)
        draft.missing("error_bound", void, *of_the_case(problem, controller.bind(known).estimate_set), theorem=theorem)
        draft.missing("reference_error_bound", void)
        add_no_bound_over_the_set(draft, problem, void)
        return None
    rests_on = (*of_the_case(problem, controller.bind(known).estimate_set), FILTER_AT_REST)
    kappa = theorem_1.time_constant(controller.filter)
    if kappa and np.ndim(controller.gamma) == 0:
        constants = theorem_1.first_order_constants(nu_0, kappa, slope, theta_max, float(known.adapted_command), model)
        if constants is not None:
            for key, value in zip(("nu_1", "nu_2"), constants, strict=True):
                draft.guarantee(key, value, *rests_on)
    if not found.holds:
        not_below = _too_large(found.value_upper)
        why = f"{not_below}: bound (10) gives no information here"
        draft.missing("error_bound", why, *rests_on, theorem=theorems.FILTER_NOT_SMALL)
        draft.missing("reference_error_bound", f"{not_below}: the distance to the reference system is not bounded")
        add_no_bound_over_the_set(draft, problem, not_below)
        return None
    undisturbed = laws.error_level(problem, controller, nu_0)
    draft.guarantee("reference_error_bound", theorem_1.reference_error_bound(undisturbed, found, C), *rests_on)
    level = disturbed.level(problem, controller, nu_0)
    bound = theorem_1.l1_bound(level.value, 1.0, found, theta_max, float(known.adapted_command), model)
    estimate_set, acting = controller.bind(known).estimate_set, carried(problem, controller)
    draft.guarantee("error_bound", bound, *of_the_case(problem, estimate_set, acting=acting), FILTER_AT_REST)
    remaining, root_n = 1 - found.value_upper, math.sqrt(known.n)
    offset = bound - (level.value - level.pushed) / remaining
    return StateReach(model.x_m_euclidean + root_n * offset, root_n * level.nu / remaining)


def _add_bounds_over_cells(draft: Draft, problem: Problem, controller: L1Adaptive, t_end: float) -> None:
    """Add the bounds for every theta of the known set, for all commands and for the command of the case."""
    loop = known_loop(problem, controller)
    rests_on = (*of_the_case(problem, controller.bind(problem.known).estimate_set), FILTER_AT_REST, theta_in_the_set(problem))
    any_command.add(draft, problem, loop, rests_on)
    if is_needed(known_command.KEY):
        known_command.add(draft, problem, loop, t_end, rests_on)


def known_loop(problem: Problem, controller: L1Adaptive) -> known_command.KnownLoop:
    """e = G[(theta - theta_0)'x - k_0 r] + C[x_tilde], G = W_b (1 - C)."""
    known, equations = problem.known, controller.bind(problem.known)
    A, B, _, _ = theorem_1.filtered_model(known, equations.C)
    origin = np.zeros(known.n) if known.theta_0 is None else known.theta_0
    x_tilde = known_command.of_adapting(problem, known, controller.gamma, equations.theta_hat0)
    N, passes = theorem_1.filter_condition(known, equations.C, 0.0).norm.upper, float(known.adapted_command)
    return known_command.KnownLoop(A, B[:, 0], origin, passes, N, theorem_1.filter_norm(equations.C) * x_tilde)


def _add_margins_of_the_limit(draft: Draft, problem: Problem, equations: Equations) -> None:
    """Add margins and mu of the fast-adaptation limit of L1-AC, a linear controller with S = 1 - C at theta = 0."""
    plant, C, known_set = problem.plant, equations.C, None if equations.estimate_set is None else problem.known.theta_set
    add_margins(draft, problem, fast_adaptation(plant, C), over_known_set.LOOP_OF_FAST_ADAPTATION)
    over_known_set.add_filtered(draft, problem, C)
    if known_set is not None:
        at_centre = fast_adaptation(replace(plant, theta=known_set.middle), C)
        tried = f"{FREQUENCIES_TRIED}; its loop is the limit of fast adaptation inside the projection bounds"
        draft.estimate(robustness(at_centre, known_set, None, draft.notes), tried)


def column(problem: Problem, controller: L1Adaptive, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """The scheme's name in Table 1 and its cells."""
    if controller.filter is None:
        return "filtered MRAC (5)-(8) with C = 1, the standard MRAC", mrac.cells(problem, controller, certificate)
    values = certificate.values
    stability = _stability(problem, controller, certificate)
    tuning = [limits_text(certificate)]
    if values.get("kappa_admissible") is not None:
        tuning.append(f"with C = 1/(kappa s + 1) the condition holds up to kappa = {down(values['kappa_admissible'])} s")
    return "filtered MRAC, L1-AC (5)-(8)", {
        "stability": stability,
        "tracking": _tracking(problem, controller, stability),
        "transient": _transient(certificate),
        "estimates": lyapunov_estimates(problem, controller, certificate, bounded=stability.applies),
        "modelling_error": unproven_robustness(problem, controller),
        "tuning": estimate("tuning", "; ".join(tuning)),
        "margins": margins_cell(certificate),
    }


def _stability(problem: Problem, controller: L1Adaptive, certificate: Certificate) -> Entry:
    condition = certificate.values.get("condition")
    rests_on, bound = of_the_lyapunov_law(problem, controller, certificate), certificate.entry("error_bound")
    if bound is not None and bound.kind == "guaranteed":
        rests_on = bound.rests_on
    if condition is None and projected(controller.bind(problem.known).estimate_set):
        return nothing("stability", "the condition on C(s) is not known for this plant", *rests_on)
    if condition is None:
        why = "without projection onto a known set there is no theta_max for the condition on C(s)"
        return nothing("stability", why, *rests_on)
    value = up(condition["value_upper"])
    if not condition["holds"]:
        return denied("stability", _too_large(condition["value_upper"]), *rests_on)
    return statement("stability", f"since ||W_b (1 - C)||_1 theta_max <= {value} < 1", *rests_on)


def _too_large(upper: float) -> str:
    return f"||W_b (1 - C)||_1 theta_max is only known to be <= {up(upper)}, but must be below 1"


def _tracking(problem: Problem, controller: L1Adaptive, stability: Entry) -> Entry:
    """Theorem 1 (iii): x_tilde, x_tilde' and theta_hat' vanish, and lim sup |x'| <= N theta_max lim sup |x'| if r becomes
    constant. A memory without forgetting is not covered, because its contribution to the law need not vanish."""
    if not stability.applies:
        return nothing("tracking", stability.why)
    constant = constant_in_the_end(problem)
    if constant.broken or controller.learning is not None or laws.why_no_bound(controller, problem) is not None:
        return nothing("tracking", "e does not converge to zero in general: an error of the order of the filter's lag remains")
    rests_on = of_the_case(problem, controller.bind(problem.known).estimate_set)
    return statement("tracking", "converges to zero for the case's r (Theorem 1 (iii))", *rests_on, FILTER_AT_REST, constant)


def _transient(certificate: Certificate) -> Entry:
    bound = certificate.entry("error_bound")
    if bound is None or bound.value is None:
        return nothing("transient", "no bound is known" if bound is None else bound.why)
    size = f"|e| <= {up(bound.value)} at all times, (10){known_command.told(certificate)}"
    text = f"{size}; the filter's contribution remains for any Gamma"
    return statement("transient", text, *bound.rests_on)
