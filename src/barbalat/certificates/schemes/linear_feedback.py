"""What is certain of a linear controller on the family (1): its own bound of the error, in Theorem 1's form, and mu.

With u = k_0 r - theta_0'x + K(s)[c'(x_m - x)] the error obeys e = W_b(s) S(s)[(theta - theta_0)'x], S = 1/(1 + K W_m), and
e(0) = 0. So with N = ||W_b S||_1 and d = max |theta - theta_0|_1 over the known set, N d < 1 gives

    ||e||_inf <= N d ||x_m||_inf / (1 - N d),

which is (10) with S in the place of 1 - C, no parameter error to forget, and k_0 r not filtered.
"""

from __future__ import annotations

import numpy as np

from barbalat.certificates.assumptions import (
    BEYOND_ONE_LINEAR_INPUT,
    FREQUENCIES_TRIED,
    beyond_the_paper,
    constant_in_the_end,
    nominal,
    theta_in_the_set,
)
from barbalat.certificates.bounds import theorem_1
from barbalat.certificates.bounds.model import ModelBounds, model_bounds
from barbalat.certificates.cells import advice, estimate, margins_cell, nothing, statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import NUMBERS_ALONE, Assumption, Entry
from barbalat.certificates.linear_loops import over_known_set
from barbalat.certificates.linear_loops.margin_values import add_margins
from barbalat.certificates.linear_loops.robustness import robustness
from barbalat.certificates.linear_loops.worst_case import Family
from barbalat.certificates.rounding import up
from barbalat.certificates.schemes.output_feedback import NEGLIGIBLE_STEADY_ERROR
from barbalat.controllers import LinearFeedback, linear_feedback
from barbalat.linear.enclosure import Enclosure
from barbalat.linear.interconnections import sensitivity
from barbalat.linear.l1_norms import l1_norm
from barbalat.linear.systems import StateSpace
from barbalat.problem.state_feedback import Known, Problem
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError


def loop_at(theta: Array, equations: linear_feedback.Equations, known: Known) -> StateSpace:
    """The loop broken at the plant's input, from v to -u, on the plant with ``theta``; the plant's states come first."""
    K, n = equations.K, known.n
    A = np.block([[known.A_m + np.outer(known.b, theta), np.zeros((n, K.order))], [np.outer(K.B, equations.c), K.A]])
    C = np.concatenate([equations.theta_0 + K.D * equations.c, K.C])
    return StateSpace(A, np.concatenate([known.b, np.zeros(K.order)]), C, 0.0)


def error_norm(equations: linear_feedback.Equations, known: Known) -> Enclosure:
    """||W_b S||_1: from a matched disturbance to the error, with theta = theta_0; InputError where that is unstable."""
    S = sensitivity(loop_at(equations.theta_0, equations, known))
    n = known.n
    if not np.linalg.eigvals(S.A).real.max() < 0:
        raise InputError("the linear loop is unstable with the nominal parameters: no bound of the error exists")
    return l1_norm(S.A, S.B[:, None], np.eye(n, len(S.A)), np.zeros((n, 1)))


def bound(equations: linear_feedback.Equations, known: Known, x_m: float) -> tuple[theorem_1.FilterCondition, float]:
    """The condition N d < 1, and the bound of |e| that it gives; ``x_m`` bounds the model's states."""
    assert known.theta_set is not None
    d = known.theta_set.farthest_1(equations.theta_0)
    condition = theorem_1.small_gain(error_norm(equations, known), d)
    nothing = ModelBounds(0.0, x_m, x_m)
    return condition, theorem_1.l1_bound(0.0, 1.0, condition, d, 0.0, nothing)


def certificate(problem: Problem, controller: LinearFeedback, _: Simulation) -> Certificate:
    """The error's bound in Theorem 1's form, margins and peaks on the true plant, mu of the family."""
    known, known_set = problem.known, problem.uncertainty
    equations, draft = controller.bind(known), Draft()
    if beyond_the_paper(problem):
        draft.note(BEYOND_ONE_LINEAR_INPUT)
        return draft.finish()
    if known_set is not None:
        try:
            condition, error_bound = bound(equations, known, model_bounds(problem).x_m)
        except InputError as error:
            draft.missing("error_bound", str(error))
        else:
            draft.guarantee("norms", {"W_b S": condition.norm.ends}, NUMBERS_ALONE)
            found = {"of": "W_b S", "value_upper": condition.value_upper, "limit": 1.0, "holds": condition.holds}
            draft.guarantee("condition", found, NUMBERS_ALONE)
            if condition.holds:
                draft.guarantee("error_bound", error_bound, *rests_on(problem))
            else:
                draft.missing("error_bound", "||W_b S||_1 times the set's radius is not below 1")
    add_margins(draft, problem, loop_at(problem.plant.theta, equations, known), "with the true parameters")
    family = Family(problem.plant, lambda plant: loop_at(plant.theta, equations, known), problem.sensor_lag)
    over_known_set.add_fixed(draft, problem, family)
    centre = problem.plant.theta if known_set is None else known_set.middle
    draft.estimate(
        robustness(loop_at(centre, equations, known), known_set, controller.unmodelled, draft.notes), FREQUENCIES_TRIED
    )
    return draft.finish()


def rests_on(problem: Problem) -> tuple[Assumption, ...]:
    """What the bound of the error rests on."""
    return (*nominal(problem), Assumption("K(s) starts at rest"), theta_in_the_set(problem))


def column(problem: Problem, controller: LinearFeedback, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """The scheme's name in Table 1 and its cells."""
    values, bound = certificate.values, certificate.entry("error_bound")
    condition, mu = values.get("condition"), values.get("mu_parameters")
    small_gain = "" if condition is None else f"||W_b S||_1 times the set's radius <= {up(condition['value_upper'])}"
    robustly = (
        "see its margins"
        if mu is None
        else (f"mu over the known set = {mu:.4g}, below 1 where every constant theta in it is stable")
    )
    if bound is None or bound.value is None:
        why = small_gain or ("without a known set there is nothing to cover" if bound is None else bound.why)
        stability, transient = nothing("stability", why), nothing("transient", "no bound: " + why)
    else:
        stability = statement("stability", small_gain, *rests_on(problem))
        transient = statement("transient", f"|e| <= {up(bound.value)} at all times", *rests_on(problem))
    return "linear feedback", {
        "stability": stability,
        "tracking": _tracking(problem, controller, stability),
        "transient": transient,
        "estimates": advice("estimates", "it estimates nothing"),
        "modelling_error": estimate("modelling_error", robustly),
        "tuning": advice("tuning", "no adaptive gain"),
        "margins": margins_cell(certificate),
    }


def _tracking(problem: Problem, controller: LinearFeedback, stability: Entry) -> Entry:
    """With S(0) = 0 to zero where r comes to rest: lim sup |e'| <= N d lim sup |e'| by small gain, so that x' vanishes."""
    if not stability.applies:
        return nothing("tracking", stability.why)
    equations, constant = controller.bind(problem.known), constant_in_the_end(problem)
    S = sensitivity(loop_at(equations.theta_0, equations, problem.known))
    left = np.abs(np.linalg.solve(S.A, S.B)[: problem.known.n]).max()  # W_b(0) S(0)
    if constant.broken or left > NEGLIGIBLE_STEADY_ERROR:
        return nothing("tracking", "not to zero in general: what theta - theta_0 adds is attenuated, not estimated")
    integrator = Assumption("K(s) has a pole at zero: S(0) = 0")
    return statement("tracking", "converges to zero for the case's r", *rests_on(problem), integrator, constant)
