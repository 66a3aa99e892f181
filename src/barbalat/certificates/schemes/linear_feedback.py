"""What is certain of a linear controller on the family (1): its own bound of the error, in Theorem 1's form, and mu.

With u = k_0 r - theta_0'x + K(s)[c'(x_m - x)] the error obeys e = W_b(s) S(s)[(theta - theta_0)'x], S = 1/(1 + K W_m), and
e(0) = 0. So with N = ||W_b S||_1 and d = max |theta - theta_0|_1 over the known set, N d < 1 gives

    ||e||_inf <= N d ||x_m||_inf / (1 - N d),

which is (10) with S in the place of 1 - C, no parameter error to forget, and k_0 r not filtered.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from barbalat.certificates.assumptions import (
    MATCHED,
    TRIED,
    finish,
)
from barbalat.certificates.bounds import theorem_1
from barbalat.certificates.bounds.model import ModelBounds, model_bounds
from barbalat.certificates.cells import Cell, margins_cell
from barbalat.certificates.certificate import Certificate
from barbalat.certificates.linear_loops import over_known_set
from barbalat.certificates.linear_loops.margin_values import margins_of
from barbalat.certificates.linear_loops.robustness import robustness
from barbalat.certificates.linear_loops.worst_case import Family
from barbalat.certificates.rounding import up
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
    equations = controller.bind(known)
    values: dict[str, Any] = {}
    findings: list[str] = []
    guaranteed: set[str] = set()
    if known_set is not None:
        try:
            condition, error_bound = bound(equations, known, model_bounds(problem).x_m)
        except InputError as error:
            findings.append(str(error))
        else:
            values["norms"] = {"W_b S": condition.norm.ends}
            values["condition"] = {"of": "W_b S", "value_upper": condition.value_upper, "limit": 1.0, "holds": condition.holds}
            guaranteed |= {"norms", "condition"}
            if condition.holds:
                values["error_bound"] = error_bound
                guaranteed |= {"error_bound"}
        if not known_set.contains(problem.plant.theta):
            findings.append("the true theta lies outside the known set: the bound of the error does not hold")
    values |= margins_of(problem, loop_at(problem.plant.theta, equations, known), "with the true parameters", findings)
    family = Family(problem.plant, lambda plant: loop_at(plant.theta, equations, known))
    values |= over_known_set.fixed(problem, family, findings)
    centre = problem.plant.theta if known_set is None else known_set.middle
    values |= robustness(loop_at(centre, equations, known), known_set, controller.unmodelled, findings)
    assumptions = [MATCHED, "x_m(0) = x(0), and K(s) starts at rest", "theta lies in the known set", TRIED]
    return finish(problem, values, guaranteed, assumptions, findings)


def column(_: Problem, __: LinearFeedback, values: dict[str, Any]) -> tuple[str, dict[str, Cell]]:
    """The scheme's name in Table 1 and its statements."""
    bounded = "error_bound" in values
    condition = values.get("condition")
    small_gain = "" if condition is None else f"||W_b S||_1 times the set's radius <= {up(condition['value_upper'])}"
    mu = values.get("mu_parameters")
    robustly = "" if mu is None else f"mu over the known set = {mu:.4g}, below 1 where every constant theta in it is stable"
    return "linear feedback", {
        "stability": Cell("proven" if bounded else "not proven", small_gain or "without a known set there is nothing to cover"),
        "tracking": Cell("not proven", "not to zero in general; to zero for a constant r where K(s) integrates"),
        "transient": Cell("proven", f"|e| <= {up(values['error_bound'])} at all times")
        if bounded
        else Cell("not proven", "no bound"),
        "estimates": Cell("estimate", "it estimates nothing"),
        "modelling_error": Cell("estimate", robustly or "see its margins"),
        "tuning": Cell("estimate", "no adaptive gain"),
        "margins": margins_cell(values),
    }
