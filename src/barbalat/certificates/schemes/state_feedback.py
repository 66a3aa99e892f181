"""Shared parts of the certificates of the state-feedback schemes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, cast

import numpy as np

from barbalat.certificates import theorems
from barbalat.certificates.assumptions import (
    BEYOND_ONE_LINEAR_INPUT,
    ERROR_ASSUMED,
    FROZEN_LAW,
    ON_THE_BOX,
    nominal,
    projected_onto,
    theta_in_the_set,
    undisturbed,
)
from barbalat.certificates.bounds import disturbed, known_command, laws, theorem_1
from barbalat.certificates.bounds.formulas import largest_square
from barbalat.certificates.bounds.model import ModelBounds, state_bounds
from barbalat.certificates.cells import nothing, statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import NUMBERS_ALONE, Assumption, Entry
from barbalat.certificates.linear_loops import over_known_set
from barbalat.certificates.linear_loops.ideal import known_parameters
from barbalat.certificates.linear_loops.margin_values import PLAIN_LAW_ONLY, add_margins
from barbalat.certificates.requested_keys import is_needed
from barbalat.certificates.schemes.unregistered import add_at_rest
from barbalat.certificates.step_limits import any_regressor
from barbalat.linear.conditions import smallest_eigenvalue
from barbalat.linear.enclosure import OUTWARD_FACTOR
from barbalat.problem.known_set import EstimateSet, KnownSet
from barbalat.problem.state_feedback import Known, Problem
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

if TYPE_CHECKING:
    from barbalat.protocols import Controller

KNOWN_REGRESSOR = Assumption("the regressor phi(x) is known")
LARGEST_STATE = 1e12
"""The size at which a run counts as diverged: without a bound on e, phi is evaluated up to this size."""


def of_the_case(
    problem: Problem, estimate_set: EstimateSet | None, error: float | None = None, acting: Assumption | None = None
) -> tuple[Assumption, ...]:
    """The assumptions of Theorem 1's bounds: the plant (1) without additions and, with projection, theta in the known set.

    ``error`` is the bound on |e_i| that would follow, if there is one; ``acting`` replaces the assumption that nothing acts on
    the plant.
    """
    regressor = () if problem.plant.is_linear else (KNOWN_REGRESSOR, bounded_regressor(problem, error))
    return (*nominal(problem, acting=acting), *inside(problem, estimate_set), *regressor)


def of_the_lyapunov_law(problem: Problem, controller: laws.LyapunovScheme, certificate: Certificate) -> tuple[Assumption, ...]:
    """The assumptions for the V of a Lyapunov law; with a leakage or a dead zone, V is still bounded."""
    estimate_set, bound = controller.bind(problem.known).estimate_set, certificate.entry("error_bound")
    case = of_the_case(problem, estimate_set, None if bound is None else bound.value)
    return (*case, laws.keeps_V_in_corners(controller.gamma, estimate_set))


def carried(problem: Problem, controller: laws.ModifiedScheme) -> Assumption:
    """The disturbances that V includes for a law that may learn from a memory."""
    return carried_along(problem, controller.bind(problem.known).estimate_set, learns=controller.learning is not None)


def carried_along(problem: Problem, estimate_set: EstimateSet | None, *, learns: bool = False) -> Assumption:
    """Disturbances that the bound on V includes: bounded disturbances, if the estimates are projected."""
    if not disturbed.is_disturbed(problem):
        return undisturbed(problem)
    words = []
    if problem.plant.baseline is not None:
        words.append("disturbance, with a baseline")
    elif disturbed.push(problem, problem.known) is None:
        words.append("a disturbance without a bound")
    if not projected(estimate_set):
        words.append("disturbance, with estimates not bounded by projection")
    if learns:
        words.append("disturbance, which the memory learns from")
    sentence = "disturbances are bounded, and the estimates are projected onto the known set"
    return Assumption(sentence, ", ".join(words), theorems.UNPROJECTED)


def inside(problem: Problem, estimate_set: EstimateSet | None) -> tuple[Assumption, ...]:
    """The assumption that theta is in the projection set, if there is one."""
    return () if estimate_set is None else (projected_onto(problem, estimate_set),)


def bounded_regressor(problem: Problem, error: float | None) -> Assumption:
    """The assumption that bounded states bound phi(x). A formula may divide by zero, and a solution may then end in finite
    time."""
    reach = np.full(problem.plant.n, LARGEST_STATE) if error is None else np.array(state_bounds(problem)) + error
    finite = np.isfinite(largest_square(problem.plant.regressor, -reach, reach))
    why = "" if finite else "phi(x) is not known to be finite for all x that may occur"
    return Assumption("phi(x) is bounded if x is", why, theorems.REGRESSOR)


def commands_and_gains(problem: Problem) -> tuple[str, str]:
    """The words for the commands and gains for which a Lyapunov function holds: only those of the case, if phi(x) is known to be
    finite only for these.

    The first phrase is about r alone.
    """
    everywhere = problem.plant.is_linear or not bounded_regressor(problem, None).broken
    return ("every bounded r", "every Gamma > 0 and every bounded r") if everywhere else ("this r", "this Gamma and this r")


def lyapunov_estimates(problem: Problem, controller: laws.ModifiedScheme, certificate: Certificate, *, bounded: bool) -> Entry:
    """The estimates of the law (4), (7); convergence is claimed only if the signals are ``bounded``."""
    void = laws.why_no_bound(controller, problem)
    if void is not None:
        return nothing("estimates", void)
    text = "theta_tilde'Gamma^-1 theta_tilde never exceeds its initial value"
    if bounded and controller.learning is not None and controller.learning.forgetting == 0:
        text += "; once the memory contains every direction, which is not checked here, the estimates converge to theta"
    elif bounded and controller.learning is None:
        text += "; if phi is persistently exciting, which is not checked here, the estimates converge to theta"
    return statement("estimates", text, *of_the_lyapunov_law(problem, controller, certificate))


def unproven_robustness(problem: Problem, controller: laws.ModifiedScheme) -> Entry:
    """The unnormalised law under a modelling error: nothing is proven about x."""
    if controller.leakage is not None or controller.dead_zone is not None:
        why = "bounded estimates; boundedness of x is known for bounded disturbances, not for Delta_m"
    elif projected(controller.bind(problem.known).estimate_set):
        why = "projection keeps the estimates in the known set; boundedness of x is not known without normalisation"
    else:
        why = "the estimates may drift; boundedness of x is not known without normalisation"
    return nothing("modelling_error", why)


def projected(estimate_set: EstimateSet | None) -> bool:
    """Whether the estimates are kept in the known set."""
    return estimate_set is not None and estimate_set.bounds_theta


def add_parameter_errors(draft: Draft, problem: Problem, equations: laws.Bound, closed: Known | None = None) -> None:
    """Add nu_0 for the theta of the case and for the worst theta in the known set, with the P of ``closed``."""
    known, known_set = closed or problem.known, problem.uncertainty
    _add_nu_0(draft, problem, equations, known)
    if known_set is not None and problem.input_gain is None:
        worst = known_set.farthest(equations.theta_hat0) * OUTWARD_FACTOR
        draft.guarantee("nu_0_worst", theorem_1.nu_0(worst, known), theta_in_the_set(problem))


def _add_nu_0(draft: Draft, problem: Problem, equations: laws.Bound, known: Known) -> None:
    error = theorem_1.initial_parameter_error(equations.theta_hat0, problem.parameters)
    draft.guarantee("nu_0", theorem_1.nu_0(error, known), *(inside(problem, equations.estimate_set) or (NUMBERS_ALONE,)))


def add_ingredients(
    draft: Draft, problem: Problem, estimate_set: EstimateSet | None, model: ModelBounds, adapted: KnownSet | None = None
) -> None:
    """Add the quantities in (9) and (10) that depend neither on the controller nor on theta.

    adapted  the known set of the adapted part; by default the known set of theta
    """
    known = problem.known
    draft.advise({"P": known.P.tolist()})
    draft.guarantee("lambda_min", smallest_eigenvalue(known.P), NUMBERS_ALONE)
    if estimate_set is not None and known.theta_set is not None:
        draft.guarantee("theta_max", (adapted or known.theta_set).theta_max, NUMBERS_ALONE)
    draft.guarantee("bounds", {"r": model.r, "x_m": model.x_m}, NUMBERS_ALONE)


def of_lyapunov_law_beyond(
    excited: any_regressor.Excited, simulation: Simulation, filter_poles: Array | None = None, *, no_bound: str = ""
) -> Certificate:
    """Certify a plant that is more general than the paper's: with the Lyapunov bound, which the generalisations do not change,
    and the limits of the solver.

    ``no_bound`` is the reason if a scheme has no bound even with the plain law.
    """
    problem, controller, draft = excited.problem, excited.controller, Draft()
    draft.note(BEYOND_ONE_LINEAR_INPUT)
    equations = controller.bind(problem.known)
    _add_nu_0(draft, problem, equations, problem.known)
    void = laws.why_no_bound(controller, problem) or no_bound
    if void:
        of_the_law = laws.theorem_of_modified(controller, problem) or theorems.FILTER_BEYOND
        draft.missing("error_bound", void, *of_the_case(problem, equations.estimate_set), theorem=of_the_law)
        add_no_bound_over_the_set(draft, problem, void)
    else:
        bound = disturbed.level(problem, controller, draft["nu_0"]).value
        acting = carried(problem, controller)
        draft.guarantee("error_bound", bound, *of_the_case(problem, equations.estimate_set, bound, acting))
        _add_worst_beyond(draft, problem, controller, equations)
    limits = any_regressor.of_lyapunov_law(excited, simulation, draft["nu_0"], filter_poles)
    draft.estimate(limits, FROZEN_LAW, ON_THE_BOX, *((ERROR_ASSUMED,) if void or disturbed.is_disturbed(problem) else ()))
    draft.estimate(any_regressor.of_lyapunov_law_at_model(excited, simulation, filter_poles), FROZEN_LAW)
    add_at_rest(draft, problem, cast("Controller", controller), none=PLAIN_LAW_ONLY if laws.is_modified(controller) else "")
    if problem.plant.is_linear and problem.plant.inputs == 1 and filter_poles is None:
        over_known_set.add_at_rest(draft, problem, gain_estimated=problem.input_gain is not None)
    return draft.finish()


OVER_THE_SET = ("error_bound_worst", known_command.KEY)
"""The keys of bounds on e for every theta of the known set."""


def add_no_bound_over_the_set(draft: Draft, problem: Problem, why: str = "") -> None:
    """Add the reason why the bounds on e for every theta of the known set are missing: by default, that a disturbance acts."""
    if problem.uncertainty is not None and is_needed(*OVER_THE_SET):
        because = why or "with disturbances it is computed for the case's theta only"
        draft.all_missing(OVER_THE_SET, because, theorem="" if why else theorems.DISTURBED_SET)


def _add_worst_beyond(draft: Draft, problem: Problem, controller: laws.LyapunovScheme, equations: laws.Bound) -> None:
    """Add the bounds for the worst parameters, theta and the input gains, in the projection set."""
    known_set, P = equations.estimate_set, problem.known.P
    if known_set is None or not known_set.bounds_theta:
        return
    if disturbed.is_disturbed(problem):
        add_no_bound_over_the_set(draft, problem)
        return
    least = smallest_eigenvalue(P)
    far = disturbed.farthest(known_set, equations.theta_hat0)
    worst = far / math.sqrt(least * laws.least_gain(controller.gamma)) * OUTWARD_FACTOR**2
    rests_on = of_the_case(problem, known_set, worst)
    draft.guarantee("error_bound_worst", worst, *rests_on)
    component = min(worst, worst * known_command.largest_component(P, least) * OUTWARD_FACTOR)
    draft.guarantee(known_command.KEY, component, *rests_on)


def add_margins_at_rest(draft: Draft, problem: Problem) -> None:
    """Add the margins of the loop with C = 1, at the theta of the case and over the known set."""
    plant = problem.plant
    add_margins(draft, problem, known_parameters(plant, plant.theta), over_known_set.LOOP_AT_REST)
    over_known_set.add_at_rest(draft, problem)
