"""Certificates of the output-feedback schemes: condition (20), the linear loops that they are, margins.

With G = N_g/D_g, C = N_c/D_c, G_m = m/(s + m),
    H(s) = G G_m/(C G + (1 - C) G_m) = m N_g D_c/[N_c N_g (s + m) + m (D_c - N_c) D_g],
so that H (1 - C) has m N_g (D_c - N_c) over the same denominator.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from barbalat.certificates.bounds.slopes import steepest_seen
from barbalat.certificates.cells import Cell, limits_text, margins_cell
from barbalat.certificates.certificate import Certificate
from barbalat.certificates.linear_loops.margin_values import finite, margins_of
from barbalat.certificates.rounding import up
from barbalat.certificates.schemes.output_feedback import FROM_REST, LINEAR_LOOP, bounds, of_linear_loop
from barbalat.controllers.output.l1 import L1Output, LinearEquivalent, fast_limit, linear_equivalent
from barbalat.linear.enclosure import OUTWARD, Enclosure
from barbalat.linear.l1_norms import l1_norm
from barbalat.linear.largest import largest_from
from barbalat.linear.systems import TransferFunction
from barbalat.problem.output_feedback import OutputProblem
from barbalat.solvers import Tableau
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

LIMITS = 1e-9
"""Relative width of the limits of gain and step: far below what an estimate is worth."""


def small_gain_system(controller: L1Output, G: TransferFunction) -> TransferFunction:
    """H(s)(1 - C(s)) of (20)."""
    C, m = controller.filter, controller.m
    one_minus = np.polysub(C.den, C.num)
    den = np.polyadd(np.polymul(np.polymul(C.num, G.num), [1.0, m]), m * np.polymul(one_minus, G.den))
    return TransferFunction(m * np.polymul(G.num, one_minus), den)


def condition_norm(controller: L1Output, G: TransferFunction) -> Enclosure:
    """||H(1 - C)||_1; InputError where H is not stable."""
    system = small_gain_system(controller, G)
    if not system.is_stable:
        raise InputError(f"H(s) of (20) is not stable: a pole has real part {system.poles.real.max():.6g}")
    state_space = system.realise()
    return l1_norm(state_space.A, state_space.B[:, None], state_space.C[None], np.array([[state_space.D]]))


def certificate(problem: OutputProblem, controller: L1Output, simulation: Simulation) -> Certificate:
    """Condition (20), the bounds of y and e, the linear controller that this scheme is, its margins."""
    plant = problem.plant.transfer_function
    G = plant if controller.design_plant is None else controller.design_plant
    findings: list[str] = []
    values, guaranteed = bounds(problem, controller, simulation, findings)
    condition = _condition(controller, G, _lipschitz(problem, controller, values, findings), findings)
    values |= condition | {"norms": values.get("norms", {}) | condition.get("norms", {}) or None}
    guaranteed |= {"norms", "condition"} if "norms" in condition else set()
    if not same_response(G, plant):
        findings.append("(20) is judged for the design plant, which is not the plant; the bounds and margins are of the plant")
    values["adaptation_frequency"] = math.sqrt(controller.gamma * controller.m)
    values |= _limits(controller, simulation)
    equivalent, tends_to = linear_equivalent(controller), fast_limit(controller)
    values["linear_equivalent"] = _coefficients(equivalent)
    values["linear_equivalent_limit"] = _coefficients(tends_to)
    K = equivalent.feedback
    values |= margins_of(problem, (K * plant).realise(), "that the controller is while sigma is inside its bounds", findings)
    limit = margins_of(problem, (tends_to.feedback * plant).realise(), "for gamma -> infinity", findings)
    if "delay_margin" in limit:
        values["delay_margin_limit"] = limit["delay_margin"]
    findings.append(
        "inside the bounds of sigma this controller is linear, with a pole at s = 0: integral action; projection stops the "
        "integrator at the bounds: anti-windup"
    )
    assumptions = (
        *FROM_REST,
        "(20) is of the limit gamma -> infinity and of a sigma without bounds; output_bound and error_bound are of this gamma",
        "gamma_max and step_max are those of the pair sigma, y_hat alone: estimates for the loop",
        LINEAR_LOOP,
    )
    return Certificate(values, frozenset(guaranteed), assumptions, tuple(findings))


def _lipschitz(problem: OutputProblem, controller: L1Output, values: dict[str, Any], findings: list[str]) -> float | None:
    """L of (20): as given unless f contradicts it, 0 without f, the slope of f within the bound of y; None if none is known."""
    f, given = problem.plant.f, controller.lipschitz
    if f is None:
        return given or 0.0
    if given is None:
        if "slope" not in values:
            findings.append("condition (20) can't be judged: the plant has f(t, y), and no lipschitz is given")
        found: float | None = values.get("slope")
        return found
    least = steepest_seen(f, values.get("output_bound", 0.0))
    if least > given * OUTWARD:
        where = "within the bound of y" if "slope" in values else "at y = 0"
        findings.append(f"lipschitz = {given:g} is no Lipschitz constant of f, whose slope reaches {least:.6g} {where}")
        return least
    if "slope" not in values:
        findings.append(f"that lipschitz = {given:g} bounds the slope of f is assumed, not shown")
    return given


def _condition(controller: L1Output, G: TransferFunction, L: float | None, findings: list[str]) -> dict[str, Any]:
    """||H(1 - C)||_1 and, with L, condition (20)."""
    named = {"limit": 1.0, "of": "H (1 - C)", "times": "L"}
    try:
        norm = condition_norm(controller, G)
    except InputError as error:
        findings.append(str(error))
        return {"condition": {"value_upper": None, "holds": False} | named}
    values: dict[str, Any] = {"norms": {"H(1-C)": norm.ends}}
    if L is not None:
        upper = norm.upper * L * OUTWARD
        values["condition"] = {"value_upper": upper, "holds": upper < 1} | named
    return values


def same_response(one: TransferFunction, other: TransferFunction) -> bool:
    """Whether two transfer functions have the same coefficients, to rounding."""
    return all(
        len(a) == len(b) and np.allclose(a, b, rtol=1e-12, atol=0) for a, b in ((one.num, other.num), (one.den, other.den))
    )


def _coefficients(linear: LinearEquivalent) -> dict[str, dict[str, list[float]]]:
    """Of u = feedforward[r] - feedback[y], highest power first."""
    return {name: {"num": system.num.tolist(), "den": system.den.tolist()} for name, system in linear._asdict().items()}


def _limits(controller: L1Output, simulation: Simulation) -> dict[str, Any]:
    """The largest gamma for this step, the largest step for this gamma: s^2 + m s + gamma m within the solver's region."""
    solver, m = simulation.solver, controller.m
    gamma = largest_from(lambda value: _bears(solver, simulation.dt, m, value), controller.gamma, within=LIMITS)
    step = largest_from(lambda value: _bears(solver, value, m, controller.gamma), simulation.dt, within=LIMITS)
    return {"gamma_max": finite(gamma), "step_max": finite(step)}


def _bears(solver: Tableau, h: float, m: float, gamma: float) -> bool:
    poles: Array = np.roots([1.0, m, gamma * m])
    return bool((np.abs(solver.amplification(h * poles)) <= 1).all())


def column(problem: OutputProblem, controller: L1Output, values: dict[str, Any]) -> tuple[str, dict[str, Cell]]:
    """The scheme's name in Table 1 and its statements."""
    condition = values.get("condition")
    value = "unknown" if condition is None or condition["value_upper"] is None else f"<= {up(condition['value_upper'])}"
    stated = f"condition (20): ||H(1 - C)||_1 L {value}"
    inside = ""
    if "sigma_needed" in values:
        inside = f"; |sigma| <= {up(values['sigma_needed'])} stays inside its bound {controller.sigma_bound:g}"
    return "L1 output feedback (18)-(21), a linear controller with integral action", {
        **of_linear_loop(problem, values, f"{inside}; {stated}", f"no bound in this case; {stated}, for gamma -> infinity"),
        "estimates": Cell("estimate", "sigma is the state of an integrator, not a parameter: nothing is learnt"),
        "modelling_error": Cell("estimate", "that of its linear loop: see the margins"),
        "tuning": Cell("estimate", limits_text(values)),
        "margins": margins_cell(values),
    }
