"""What the certificates of the state-feedback schemes share."""

from __future__ import annotations

from typing import Any

import numpy as np

from barbalat.certificates.assumptions import (
    BEYOND_ONE_LINEAR_INPUT,
    ERROR_ASSUMED,
    FROZEN_LAW,
    ON_THE_BOX,
    nominal,
    projected_onto,
    theta_in_the_set,
)
from barbalat.certificates.bounds import laws, theorem_1
from barbalat.certificates.bounds.model import ModelBounds, state_bounds
from barbalat.certificates.bounds.regressor import largest_square
from barbalat.certificates.cells import nothing, statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Assumption, Entry
from barbalat.certificates.linear_loops import over_known_set
from barbalat.certificates.linear_loops.ideal import known_parameters
from barbalat.certificates.linear_loops.margin_values import add_margins
from barbalat.certificates.step_limits import any_regressor, frozen_laws
from barbalat.controllers import L1Adaptive, Mrac, MracClosedLoop, NormalizedMrac, RobustMrac
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.known_set import EstimateSet, KnownSet
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.solvers.simulation import Simulation

KNOWN_REGRESSOR = Assumption("the regressor phi(x) is known")
LARGEST_STATE = 1e12
"""Where a run counts as diverged: without a bound of e, phi is looked at up to there."""


def of_the_case(problem: Problem, box: EstimateSet | None, error: float | None = None) -> tuple[Assumption, ...]:
    """What the bounds of Theorem 1 rest on: the plant (1) as it stands and, with projection, theta in the known set.

    ``error`` is the bound of |e_i| that would follow, where there is one.
    """
    regressor = () if problem.plant.is_linear else (KNOWN_REGRESSOR, bounded_regressor(problem, error))
    return (*nominal(problem), *inside(problem, box), *regressor)


def of_the_lyapunov_law(
    problem: Problem, controller: Mrac | L1Adaptive | MracClosedLoop, certificate: Certificate
) -> tuple[Assumption, ...]:
    """What its V rests on; with a leakage or a dead zone V is bounded all the same."""
    box, bound = controller.bind(problem.known).box, certificate.entry("error_bound")
    case = of_the_case(problem, box, None if bound is None else bound.value)
    return (*case, laws.keeps_V_in_corners(controller.gamma, box))


def inside(problem: Problem, box: EstimateSet | None) -> tuple[Assumption, ...]:
    """Theta in the set that is projected onto, where one is."""
    return () if box is None else (projected_onto(problem, box),)


def bounded_regressor(problem: Problem, error: float | None) -> Assumption:
    """A formula may divide by zero: then bounded states don't bound phi(x), and no solution need go on."""
    reach = np.full(problem.plant.n, LARGEST_STATE) if error is None else np.array(state_bounds(problem)) + error
    finite = np.isfinite(largest_square(problem.plant.regressor, -reach, reach))
    return Assumption("phi(x) is bounded where x is", "" if finite else "phi(x) is not known to be finite wherever x may go")


def lyapunov_estimates(problem: Problem, controller: Mrac | L1Adaptive, certificate: Certificate, *, bounded: bool) -> Entry:
    """The estimates of the law (4), (7); that they converge is said only where the signals are ``bounded``."""
    void = laws.why_no_bound(controller, problem)
    if void is not None:
        return nothing("estimates", void)
    text = "theta_tilde'Gamma^-1 theta_tilde never exceeds its initial value"
    if bounded and controller.learning is not None:
        text += "; once the memory has seen every direction, which isn't checked here, they converge to theta"
    elif bounded:
        text += "; where phi is persistently exciting, which isn't checked here, they converge to theta"
    return statement("estimates", text, *of_the_lyapunov_law(problem, controller, certificate))


def unproven_robustness(problem: Problem, controller: Mrac | L1Adaptive) -> Entry:
    """The unnormalised law beside a modelling error: nothing is proven of x."""
    if controller.leakage is not None or controller.dead_zone is not None:
        why = "bounded estimates; that x stays bounded is known for bounded disturbances, not for Delta_m"
    elif projected(problem, controller):
        why = "projection keeps the estimates in the known set; that x stays bounded is not known without normalisation"
    else:
        why = "the estimates may drift; that x stays bounded is not known without normalisation"
    return nothing("modelling_error", why)


def unfiltered(controller: Mrac | L1Adaptive) -> bool:
    """Whether the scheme is the MRAC, as L1-AC with C = 1 is."""
    return isinstance(controller, Mrac) or controller.filter is None


def projected(problem: Problem, controller: Mrac | L1Adaptive | NormalizedMrac | RobustMrac) -> bool:
    """Whether the estimates are kept in the known set."""
    return problem.uncertainty is not None and controller.projection is not False


def add_parameter_errors(draft: Draft, problem: Problem, loop: ClosedLoop) -> None:
    """nu_0 for the case's theta, and for the worst theta in the known set."""
    equations: Any = loop.equations
    theta_hat0 = equations.initial().theta_hat
    known, known_set = problem.known, problem.uncertainty
    error = theorem_1.initial_parameter_error(theta_hat0, problem.plant.theta)
    draft.guarantee("nu_0", theorem_1.nu_0(error, known), *inside(problem, equations.box))
    if known_set is not None:
        worst = theorem_1.largest_parameter_error(theta_hat0, known_set)
        draft.guarantee("nu_0_worst", theorem_1.nu_0(worst, known), theta_in_the_set(problem))


def add_ingredients(draft: Draft, problem: Problem, box: KnownSet | None, model: ModelBounds) -> None:
    """What (9) and (10) are computed from, which no controller and no theta changes."""
    values = theorem_1.ingredients(problem.known, box, model)
    draft.advise({"P": values.pop("P")})
    for key, value in values.items():
        draft.guarantee(key, value)


def beyond_the_paper(problem: Problem, controller: Controller, simulation: Simulation) -> Certificate:
    """Several inputs, a regressor other than x, an unknown input gain: the Lyapunov bound, which none of these changes."""
    loop, draft = ClosedLoop.of(problem, controller), Draft()
    draft.note(BEYOND_ONE_LINEAR_INPUT)
    if loop.parameters == 0:
        return draft.finish()
    if not isinstance(controller, (Mrac, L1Adaptive, RobustMrac, NormalizedMrac)):
        return draft.finish()
    equations: Any = loop.equations
    error = theorem_1.initial_parameter_error(equations.initial().theta_hat, problem.parameters)
    in_the_set = inside(problem, equations.box)
    if isinstance(controller, (Mrac, L1Adaptive)):
        draft.guarantee("nu_0", theorem_1.nu_0(error, problem.known), *in_the_set)
        void = laws.why_no_bound(controller, problem)
        if void is not None:
            draft.missing("error_bound", void)
        elif unfiltered(controller):
            bound = laws.error_level(problem, controller, draft["nu_0"])
            draft.guarantee("error_bound", bound, *of_the_case(problem, equations.box, bound))
        else:
            draft.missing("error_bound", "no bound is known for this scheme on this plant")
        assumed = (ON_THE_BOX,) if void is None and unfiltered(controller) else (ON_THE_BOX, ERROR_ASSUMED)
        limits = any_regressor.of_lyapunov_law(problem, controller, simulation, draft["nu_0"])
        draft.estimate(limits, FROZEN_LAW, *assumed)
    else:
        draft.guarantee("initial_parameter_error", error, *in_the_set)
        draft.estimate(frozen_laws.of_parametric_model(problem, controller, equations, simulation), FROZEN_LAW)
    return draft.finish()


def add_margins_at_rest(draft: Draft, problem: Problem) -> None:
    """Of the loop with C = 1, at the case's theta and over the known set."""
    plant = problem.plant
    add_margins(draft, problem, known_parameters(plant, plant.theta), over_known_set.AT_REST)
    over_known_set.add_at_rest(draft, problem)
