"""What the certificates of the state-feedback schemes share."""

from __future__ import annotations

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
from barbalat.certificates.bounds import disturbed, laws, theorem_1
from barbalat.certificates.bounds.formulas import largest_square
from barbalat.certificates.bounds.model import ModelBounds, state_bounds
from barbalat.certificates.cells import nothing, statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import NUMBERS_ALONE, Assumption, Entry
from barbalat.certificates.linear_loops import over_known_set
from barbalat.certificates.linear_loops.ideal import known_parameters
from barbalat.certificates.linear_loops.margin_values import PLAIN_LAW_ONLY, add_margins
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
"""Where a run counts as diverged: without a bound of e, phi is looked at up to there."""


def of_the_case(
    problem: Problem, estimate_set: EstimateSet | None, error: float | None = None, acting: Assumption | None = None
) -> tuple[Assumption, ...]:
    """What the bounds of Theorem 1 rest on: the plant (1) as it stands and, with projection, theta in the known set.

    ``error`` is the bound of |e_i| that would follow, where there is one; ``acting`` what may act on the plant, by default
    nothing.
    """
    regressor = () if problem.plant.is_linear else (KNOWN_REGRESSOR, bounded_regressor(problem, error))
    return (*nominal(problem, acting=acting), *inside(problem, estimate_set), *regressor)


def of_the_lyapunov_law(problem: Problem, controller: laws.LyapunovScheme, certificate: Certificate) -> tuple[Assumption, ...]:
    """The assumptions of a Lyapunov law's V; with a leakage or a dead zone V is bounded all the same."""
    estimate_set, bound = controller.bind(problem.known).estimate_set, certificate.entry("error_bound")
    case = of_the_case(problem, estimate_set, None if bound is None else bound.value)
    return (*case, laws.keeps_V_in_corners(controller.gamma, estimate_set))


def carried(problem: Problem, controller: laws.ModifiedScheme) -> Assumption:
    """Disturbances that the bound of V carries along: bounded ones, beside estimates that are projected."""
    if not disturbed.is_disturbed(problem):
        return undisturbed(problem)
    words = []
    if problem.plant.baseline is not None:
        words.append("disturbance, beside a baseline")
    elif disturbed.push(problem) is None:
        words.append("a disturbance without a bound")
    if not projected(controller.bind(problem.known).estimate_set):
        words.append("disturbance, with estimates that no projection bounds")
    if controller.learning is not None:
        words.append("disturbance, which the memory learns from")
    sentence = "disturbances are bounded, and the estimates are projected onto the known set"
    return Assumption(sentence, ", ".join(words), theorems.UNPROJECTED)


def inside(problem: Problem, estimate_set: EstimateSet | None) -> tuple[Assumption, ...]:
    """Theta in the set that is projected onto, where one is."""
    return () if estimate_set is None else (projected_onto(problem, estimate_set),)


def bounded_regressor(problem: Problem, error: float | None) -> Assumption:
    """A formula may divide by zero: then bounded states don't bound phi(x), and no solution need go on."""
    reach = np.full(problem.plant.n, LARGEST_STATE) if error is None else np.array(state_bounds(problem)) + error
    finite = np.isfinite(largest_square(problem.plant.regressor, -reach, reach))
    why = "" if finite else "phi(x) is not known to be finite wherever x may go"
    return Assumption("phi(x) is bounded where x is", why, theorems.REGRESSOR)


def commands_and_gains(problem: Problem) -> tuple[str, str]:
    """Say for which r and Gamma a Lyapunov function holds: for the case's own where phi(x) is known to be finite only so far.

    The first is of r alone.
    """
    everywhere = problem.plant.is_linear or not bounded_regressor(problem, None).broken
    return ("every bounded r", "every Gamma > 0 and every bounded r") if everywhere else ("this r", "this Gamma and this r")


def lyapunov_estimates(problem: Problem, controller: laws.ModifiedScheme, certificate: Certificate, *, bounded: bool) -> Entry:
    """The estimates of the law (4), (7); that they converge is said only where the signals are ``bounded``."""
    void = laws.why_no_bound(controller, problem)
    if void is not None:
        return nothing("estimates", void)
    text = "theta_tilde'Gamma^-1 theta_tilde never exceeds its initial value"
    if bounded and controller.learning is not None and controller.learning.forgetting == 0:
        text += "; once the memory has seen every direction, which isn't checked here, they converge to theta"
    elif bounded and controller.learning is None:
        text += "; where phi is persistently exciting, which isn't checked here, they converge to theta"
    return statement("estimates", text, *of_the_lyapunov_law(problem, controller, certificate))


def unproven_robustness(problem: Problem, controller: laws.ModifiedScheme) -> Entry:
    """The unnormalised law beside a modelling error: nothing is proven of x."""
    if controller.leakage is not None or controller.dead_zone is not None:
        why = "bounded estimates; that x stays bounded is known for bounded disturbances, not for Delta_m"
    elif projected(controller.bind(problem.known).estimate_set):
        why = "projection keeps the estimates in the known set; that x stays bounded is not known without normalisation"
    else:
        why = "the estimates may drift; that x stays bounded is not known without normalisation"
    return nothing("modelling_error", why)


def projected(estimate_set: EstimateSet | None) -> bool:
    """Whether the estimates are kept in the known set."""
    return estimate_set is not None and estimate_set.bounds_theta


def add_parameter_errors(draft: Draft, problem: Problem, equations: laws.Bound, closed: Known | None = None) -> None:
    """nu_0 for the case's theta, and for the worst theta in the known set, with P of ``closed``."""
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
    """Add what (9) and (10) are computed from, which no controller and no theta changes.

    adapted  the known set of what is left to adaptation; that of theta by default
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
    """Certify a plant beyond the paper's: the Lyapunov bound, which none of the plant's additions changes, and the solver's
    limits.

    ``no_bound`` says why a scheme has none even with the plain law.
    """
    problem, controller, draft = excited.problem, excited.controller, Draft()
    draft.note(BEYOND_ONE_LINEAR_INPUT)
    equations = controller.bind(problem.known)
    _add_nu_0(draft, problem, equations, problem.known)
    void = laws.why_no_bound(controller, problem) or no_bound
    if void:
        of_the_law = laws.theorem_of_modified(controller, problem) or theorems.FILTER_BEYOND
        draft.missing("error_bound", void, *of_the_case(problem, equations.estimate_set), theorem=of_the_law)
    else:
        bound = disturbed.level(problem, controller, draft["nu_0"]).value
        acting = carried(problem, controller)
        draft.guarantee("error_bound", bound, *of_the_case(problem, equations.estimate_set, bound, acting))
    limits = any_regressor.of_lyapunov_law(excited, simulation, draft["nu_0"], filter_poles)
    draft.estimate(limits, FROZEN_LAW, ON_THE_BOX, *((ERROR_ASSUMED,) if void or disturbed.is_disturbed(problem) else ()))
    draft.estimate(any_regressor.of_lyapunov_law_at_model(excited, simulation, filter_poles), FROZEN_LAW)
    add_at_rest(draft, problem, cast("Controller", controller), none=PLAIN_LAW_ONLY if laws.is_modified(controller) else "")
    return draft.finish()


def add_margins_at_rest(draft: Draft, problem: Problem) -> None:
    """Add the margins of the loop with C = 1, at the case's theta and over the known set."""
    plant = problem.plant
    add_margins(draft, problem, known_parameters(plant, plant.theta), over_known_set.LOOP_AT_REST)
    over_known_set.add_at_rest(draft, problem)
