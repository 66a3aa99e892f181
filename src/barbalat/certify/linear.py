"""What is certain of a linear controller on the family (1): its own bound of the error, in Theorem 1's form, and mu.

With u = k_0 r - theta_0'x + K(s)[c'(x_m - x)] the error obeys e = W_b(s) S(s)[(theta - theta_0)'x], S = 1/(1 + K W_m), and
e(0) = 0. So with N = ||W_b S||_1 and d = max |theta - theta_0|_1 over the known set, N d < 1 gives

    ||e||_inf <= N d ||x_m||_inf / (1 - N d),

which is (10) with S in the place of 1 - C, no parameter error to forget, and k_0 r not filtered.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from barbalat.certify import over_known_set, theorem1
from barbalat.certify.l1 import Enclosure, l1_norm
from barbalat.certify.loop_values import margins_of
from barbalat.certify.margins import sensitivity
from barbalat.certify.robust import MatchedFamily, RobustStability, robust_stability
from barbalat.certify.worst_case import Family
from barbalat.controllers import LinearFeedback, linear_feedback
from barbalat.known_set import KnownSet, ParameterBox
from barbalat.linear import StateSpace, TransferFunction
from barbalat.problem import Known, Problem
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


def bound(equations: linear_feedback.Equations, known: Known, x_m: float) -> tuple[theorem1.FilterCondition, float]:
    """The condition N d < 1, and the bound of |e| that it gives; ``x_m`` bounds the model's states."""
    assert known.theta_set is not None
    d = known.theta_set.farthest_1(equations.theta_0)
    condition = theorem1.small_gain(error_norm(equations, known), d)
    nothing = theorem1.ModelBounds(0.0, x_m, x_m)
    return condition, theorem1.l1_bound(0.0, 1.0, condition, d, 0.0, nothing)


def certificate_values(problem: Problem, controller: LinearFeedback) -> tuple[dict[str, Any], set[str], list[str]]:
    """Values by the certificate's keys, the guaranteed ones among them, and findings."""
    known, known_set = problem.known, problem.uncertainty
    equations = controller.bind(known)
    values: dict[str, Any] = {}
    findings: list[str] = []
    guaranteed: set[str] = set()
    if known_set is not None:
        try:
            condition, error_bound = bound(equations, known, theorem1.model_bounds(problem).x_m)
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
    return values, guaranteed, findings


def robustness(
    loop: StateSpace, known_set: KnownSet | None, weight: TransferFunction | None, findings: list[str]
) -> dict[str, Any]:
    """mu against the known set, against the unmodelled dynamics of size ``weight``, and against both, by the certificate's keys.

    ``loop`` stands at the set's centre, or where there is none, at the true theta.
    """
    values: dict[str, Any] = {}

    def measure(width: Array, weight: TransferFunction | None) -> RobustStability:
        return robust_stability(MatchedFamily(loop=loop, width=width, weight=weight))

    width = np.zeros(1) if known_set is None else known_set.extent[1] - known_set.middle
    try:
        if known_set is not None:
            found = measure(width, None)
            values |= {"mu_parameters": found.peak, "parameter_scale": found.scale if found.peak > 0 else None}
            if found.delta is not None:
                values["theta_destabilising"] = (known_set.middle + width * found.delta).tolist()
            if not isinstance(known_set, ParameterBox):
                findings.append("mu is that of the box around the known set: more than the set's own")
        if weight is not None:
            values["mu_dynamics"] = measure(0 * width, weight).peak
            if known_set is not None:
                both = measure(width, weight)
                values |= {"mu": both.peak, "mu_frequency": both.frequency}
    except InputError as error:
        findings.append(str(error))
    return values
