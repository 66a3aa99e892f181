"""The condition on C(s) and the bound (10) of L1-AC, under the certificate's keys."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from barbalat.certificates.assumptions import (
    EXACT_START,
    FROZEN,
    IN_THE_SET,
    LINEAR,
    MATCHED,
    OF_THE_PROBLEM,
    TRIED,
    finish,
)
from barbalat.certificates.bounds import laws, theorem_1
from barbalat.certificates.bounds.model import ModelBounds, model_bounds
from barbalat.certificates.cells import Cell, limits_text, margins_cell
from barbalat.certificates.certificate import Certificate
from barbalat.certificates.linear_loops import over_known_set
from barbalat.certificates.linear_loops.ideal import fast_adaptation
from barbalat.certificates.linear_loops.margin_values import adapting_margins, finite, margins_of
from barbalat.certificates.linear_loops.robustness import robustness
from barbalat.certificates.rounding import down, up
from barbalat.certificates.schemes import mrac
from barbalat.certificates.schemes.state_feedback import (
    lyapunov_estimates,
    margins_at_rest,
    parameter_errors,
    projected,
    unproven_robustness,
)
from barbalat.certificates.step_limits import frozen_laws
from barbalat.controllers import L1Adaptive
from barbalat.linear.enclosure import Enclosure
from barbalat.linear.systems import StateSpace
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.state_feedback import Problem
from barbalat.solvers.simulation import Simulation


class Reach(NamedTuple):
    """|x|_2 <= offset + factor/sqrt(Gamma), at all times."""

    offset: float
    factor: float


def condition(
    problem: Problem, C: StateSpace, values: dict[str, Any], guaranteed: set[str]
) -> tuple[theorem_1.FilterCondition, Enclosure]:
    """||W_b (1 - C)||_1 theta_max < 1 with the filters that would satisfy it, and ||s W_b||_1."""
    known, theta_max = problem.known, values["theta_max"]
    found, slope = theorem_1.filter_condition(known, C, theta_max), theorem_1.derivative_norm(known)
    values["norms"] = {"W_b(1-C)": found.norm.ends, "sW_b": slope.ends}
    values["condition"] = {"value_upper": found.value_upper, "limit": 1.0, "holds": found.holds}
    values["kappa_admissible"] = finite(theorem_1.kappa_admissible(known, theta_max))
    values["kappa_max"] = finite(theorem_1.kappa_max(slope, theta_max))
    guaranteed |= {"norms", "condition", "kappa_admissible", "kappa_max"}
    return found, slope


def bound_10(
    problem: Problem,
    controller: L1Adaptive,
    C: StateSpace,
    model: ModelBounds,
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
    kappa = theorem_1.time_constant(controller.filter)
    if kappa and np.ndim(controller.gamma) == 0:
        constants = theorem_1.first_order_constants(nu_0, kappa, slope, theta_max, known.k_0, model)
        if constants is not None:
            values["nu_1"], values["nu_2"] = constants
            guaranteed |= {"nu_1", "nu_2"}
    if not found.holds:
        findings.append(f"||W_b (1 - C)||_1 theta_max = {found.value_upper:.4g} is not below 1: bound (10) says nothing here")
        return None
    level = laws.error_level(problem, controller, nu_0)
    values["error_bound"] = theorem_1.l1_bound(level, 1.0, found, theta_max, known.k_0, model)
    guaranteed |= {"error_bound"}
    remaining, root_n = 1 - found.value_upper, math.sqrt(known.n)
    return Reach(model.x_m_euclidean + root_n * (values["error_bound"] - level / remaining), root_n * nu_0 / remaining)


def column(problem: Problem, controller: L1Adaptive, values: dict[str, Any]) -> tuple[str, dict[str, Cell]]:
    """The scheme's name in Table 1 and its statements."""
    if controller.filter is None:
        _, cells = mrac.column(problem, controller, values)  # type: ignore[arg-type]  # with C = 1 the two coincide
        return "filtered MRAC (5)-(8) with C = 1, the standard MRAC", cells
    condition = values.get("condition")
    void = laws.why_no_bound(controller, problem)
    if condition is None and projected(problem, controller):
        why = Cell("not proven", "the condition on C(s) is not known for this plant")
    elif condition is None:
        why = Cell("not proven", "without a known set that is projected onto there is no theta_max for the condition on C(s)")
    elif not condition["holds"]:
        value = up(condition["value_upper"])
        why = Cell("not proven", f"||W_b (1 - C)||_1 theta_max is only known to be <= {value}, and 1 is needed")
    else:
        why = Cell("proven", f"since ||W_b (1 - C)||_1 theta_max <= {up(condition['value_upper'])} < 1")
    transient = Cell("not proven", void or "no bound")
    if "error_bound" in values:
        transient = Cell(
            "proven", f"|e| <= {up(values['error_bound'])} at all times, (10); the filter's part stays however large Gamma is"
        )
    tuning = [limits_text(values)]
    if values.get("kappa_admissible") is not None:
        tuning.append(f"with C = 1/(kappa s + 1) the condition holds up to kappa = {down(values['kappa_admissible'])} s")
    vanishes = (
        "not to zero in general: an error of the order of the filter's lag stays; to zero for a constant r (Theorem 1 (iii))"
    )
    return "filtered MRAC, L1-AC (5)-(8)", {
        "stability": why,
        "tracking": Cell("not proven", vanishes if why.kind == "proven" else "nothing, without bounded signals"),
        "transient": transient,
        "estimates": lyapunov_estimates(problem, controller),
        "modelling_error": unproven_robustness(problem, controller),
        "tuning": Cell("estimate", "; ".join(tuning)),
        "margins": margins_cell(values),
    }


def certificate(problem: Problem, controller: L1Adaptive, simulation: Simulation) -> Certificate:
    """The condition on C(s), the bound (10), the limits of gain and step, the margins of the linear loops."""
    known = problem.known
    loop = ClosedLoop.of(problem, controller)
    equations: Any = loop.equations
    C: StateSpace = equations.C
    values, findings = parameter_errors(problem, loop)
    guaranteed = {"nu_0", *(key for key in ("nu_0_worst",) if key in values)}
    assumptions = [MATCHED, EXACT_START, "the filter starts at rest", FROZEN, LINEAR]
    model = model_bounds(problem)
    values |= theorem_1.ingredients(known, equations.box, model)
    guaranteed |= OF_THE_PROBLEM & values.keys()
    reach = None
    if equations.box is None:
        findings.append("without projection there is no theta_max, so the condition on C(s) and the bound (10) have no meaning")
    else:
        assumptions.insert(1, IN_THE_SET)
        reach = bound_10(problem, controller, C, model, values, guaranteed, findings)
    if reach is None:  # no bound on x: take what the model asks for, and say so
        reach = Reach(model.x_m_euclidean, values["nu_0"])
        assumptions.append("|x| in the adaptation frequency is the model's bound plus nu_0/sqrt(Gamma): an estimate")
    values |= frozen_laws.with_modifications(
        frozen_laws.of_lyapunov_law(problem, controller.gamma, simulation, reach.offset, reach.factor, np.linalg.eigvals(C.A)),
        controller,
        simulation,
    )
    if controller.filter is None:
        values |= margins_at_rest(problem, findings)
    else:
        values |= _margins_of_the_limit(problem, equations, assumptions, findings)
    values |= adapting_margins(problem, loop, findings)
    return finish(problem, values, guaranteed, assumptions, findings)


def _margins_of_the_limit(problem: Problem, equations: Any, assumptions: list[str], findings: list[str]) -> dict[str, Any]:
    """Margins and mu of what L1-AC tends to for fast adaptation: a linear controller with S = 1 - C at theta = 0."""
    plant, C, known_set = problem.plant, equations.C, equations.box
    values = margins_of(problem, fast_adaptation(plant, C), over_known_set.FAST, findings)
    values |= over_known_set.filtered(problem, C, findings)
    if known_set is not None:
        at_centre = fast_adaptation(replace(plant, theta=known_set.middle), C)
        values |= robustness(at_centre, known_set, None, findings)
        assumptions.append(f"{TRIED}; its loop is the limit of fast adaptation inside the projection bounds")
    return values
