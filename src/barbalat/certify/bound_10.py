"""The condition on C(s) and the bound (10) of L1-AC, under the certificate's keys."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from barbalat.certify import laws, theorem1
from barbalat.certify.l1 import Enclosure
from barbalat.certify.loop_values import finite
from barbalat.controllers import L1Adaptive
from barbalat.linear import StateSpace
from barbalat.problem import Problem


class Reach(NamedTuple):
    """|x|_2 <= offset + factor/sqrt(Gamma), at all times."""

    offset: float
    factor: float


def condition(
    problem: Problem, C: StateSpace, values: dict[str, Any], guaranteed: set[str]
) -> tuple[theorem1.FilterCondition, Enclosure]:
    """||W_b (1 - C)||_1 theta_max < 1 with the filters that would satisfy it, and ||s W_b||_1."""
    known, theta_max = problem.known, values["theta_max"]
    found, slope = theorem1.filter_condition(known, C, theta_max), theorem1.derivative_norm(known)
    values["norms"] = {"W_b(1-C)": found.norm.ends, "sW_b": slope.ends}
    values["condition"] = {"value_upper": found.value_upper, "limit": 1.0, "holds": found.holds}
    values["kappa_admissible"] = finite(theorem1.kappa_admissible(known, theta_max))
    values["kappa_max"] = finite(theorem1.kappa_max(slope, theta_max))
    guaranteed |= {"norms", "condition", "kappa_admissible", "kappa_max"}
    return found, slope


def bound_10(
    problem: Problem,
    controller: L1Adaptive,
    C: StateSpace,
    model: theorem1.ModelBounds,
    values: dict[str, Any],
    guaranteed: set[str],
    findings: list[str],
) -> Reach | None:
    """The condition and, where it holds, the bound; None with the reason among the findings where there is none."""
    known, theta_max, nu_0 = problem.known, values["theta_max"], values["nu_0"]
    found, slope = condition(problem, C, values, guaranteed)
    void = laws.why_no_bound(controller, problem)
    if void is not None:
        findings.append(void)
        return None
    kappa = theorem1.time_constant(controller.filter)
    if kappa and np.ndim(controller.gamma) == 0:
        constants = theorem1.first_order_constants(nu_0, kappa, slope, theta_max, known.k_0, model)
        if constants is not None:
            values["nu_1"], values["nu_2"] = constants
            guaranteed |= {"nu_1", "nu_2"}
    if not found.holds:
        findings.append(f"||W_b (1 - C)||_1 theta_max = {found.value_upper:.4g} is not below 1: bound (10) says nothing here")
        return None
    level = laws.error_level(problem, controller, nu_0)
    values["error_bound"] = theorem1.l1_bound(level, 1.0, found, theta_max, known.k_0, model)
    guaranteed |= {"error_bound"}
    remaining, root_n = 1 - found.value_upper, math.sqrt(known.n)
    return Reach(model.x_m_euclidean + root_n * (values["error_bound"] - level / remaining), root_n * nu_0 / remaining)
