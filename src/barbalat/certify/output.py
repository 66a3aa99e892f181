"""Certificates of the output-feedback schemes: condition (20), the linear loops that they are, margins.

With G = N_g/D_g, C = N_c/D_c, G_m = m/(s + m),
    H(s) = G G_m/(C G + (1 - C) G_m) = m N_g D_c/[N_c N_g (s + m) + m (D_c - N_c) D_g],
so that H (1 - C) has m N_g (D_c - N_c) over the same denominator.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from barbalat.certify.certificate import Certificate
from barbalat.certify.l1 import Enclosure, l1_norm
from barbalat.certify.loop_values import finite, margins_of
from barbalat.controllers.output.l1 import L1Output, LinearEquivalent, fast_limit, linear_equivalent
from barbalat.controllers.output.linear import LinearOutput
from barbalat.controllers.output.lyapunov import LyapunovLaw
from barbalat.controllers.output.matching import filter_polynomial, matching_parameters
from barbalat.controllers.output.mrac import MracOutput
from barbalat.grid import Simulation
from barbalat.linear import TransferFunction
from barbalat.output_problem import OutputProblem
from barbalat.solvers import Tableau
from barbalat.validate import Array, InputError

REST = "plant, model and controller start at rest"
LINEAR = "margins are exact for the linear loop named; limits at the input, and f(y), are not in it"


def certificate(problem: OutputProblem, controller: Any, simulation: Simulation) -> Certificate:
    """The certificate of one output-feedback controller."""
    match controller:
        case L1Output():
            return _l1(problem, controller, simulation)
        case MracOutput():
            return _mrac(problem, controller)
        case LinearOutput():
            findings: list[str] = []
            values = margins_of(problem, (controller.loop * problem.plant.transfer_function).realise(), "itself", findings)
            return Certificate(values, frozenset(), (REST, LINEAR), tuple(findings))
    raise InputError(f"no certificate is known for {type(controller).__name__}")


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


def _l1(problem: OutputProblem, controller: L1Output, simulation: Simulation) -> Certificate:
    plant = problem.plant.transfer_function
    G = plant if controller.design_plant is None else controller.design_plant
    findings: list[str] = []
    values: dict[str, Any] = {}
    guaranteed: set[str] = set()
    try:
        norm = condition_norm(controller, G)
        upper = norm.upper * controller.lipschitz
        values["norms"] = {"H(1-C)": {"lower": norm.lower, "upper": norm.upper}}
        values["condition"] = {"value_upper": upper, "limit": 1.0, "holds": upper < 1, "of": "H (1 - C)", "times": "L"}
        guaranteed = {"norms", "condition"}
    except InputError as error:
        findings.append(str(error))
        values["condition"] = {"value_upper": None, "limit": 1.0, "holds": False, "of": "H (1 - C)", "times": "L"}
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
    assumptions = [
        "(18): y = G(s)[u + d + f(y)], f with the Lipschitz constant given; G is the design plant where one is given",
        REST,
        "gamma_max and step_max are those of the pair sigma, y_hat alone: estimates for the loop",
        LINEAR,
    ]
    return Certificate(values, frozenset(guaranteed), tuple(assumptions), tuple(findings))


def _coefficients(linear: LinearEquivalent) -> dict[str, dict[str, list[float]]]:
    """Of u = feedforward[r] - feedback[y], highest power first."""
    return {name: {"num": system.num.tolist(), "den": system.den.tolist()} for name, system in linear._asdict().items()}


def _limits(controller: L1Output, simulation: Simulation) -> dict[str, Any]:
    """The largest gamma for this step, the largest step for this gamma: s^2 + m s + gamma m within the solver's region."""
    solver, m = simulation.solver, controller.m
    gamma = _largest(lambda value: _bears(solver, simulation.dt, m, value), controller.gamma)
    step = _largest(lambda value: _bears(solver, value, m, controller.gamma), simulation.dt)
    return {"gamma_max": finite(gamma), "step_max": finite(step)}


def _bears(solver: Tableau, h: float, m: float, gamma: float) -> bool:
    poles: Array = np.roots([1.0, m, gamma * m])
    return bool((np.abs(solver.amplification(h * poles)) <= 1).all())


def _largest(bears: Any, start: float) -> float:
    """The largest value up to which it bears all, to 1e-9: by doubling or halving from ``start``, then bisection."""
    low = start
    while not bears(low):
        low /= 2
        if low < 1e-300:
            return 0.0
    high = 2 * low
    while bears(high):
        low, high = high, 2 * high
        if math.isinf(high):
            return math.inf
    while high - low > 1e-9 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if bears(middle) else (low, middle)
    return low


def matched_feedback(theta: Array, Lambda: Array) -> TransferFunction:
    """K(s) of u = -K[y] + ..., for fixed parameters: -(theta_2'alpha + theta_3 Lambda)/(Lambda - theta_1'alpha)."""
    n = len(Lambda)
    theta_1, theta_2, theta_3 = theta[: n - 1], theta[n - 1 : 2 * n - 2], theta[2 * n - 2]
    num = np.polyadd(theta_2 if n > 1 else [0.0], theta_3 * Lambda)
    return TransferFunction(-num, np.polysub(Lambda, theta_1 if n > 1 else [0.0]))


def _mrac(problem: OutputProblem, controller: MracOutput) -> Certificate:
    plant, W_m = problem.plant.transfer_function, problem.reference_model.transfer_function
    Lambda = filter_polynomial(controller.order, W_m, controller.filter_poles)
    values: dict[str, Any] = {}
    findings: list[str] = []
    n, n_star, law = controller.order, controller.relative_degree, controller.law
    assumptions = [f"the plant is of order {n} and relative degree {n_star}, minimum phase, its gain of the sign given", REST]
    if len(plant.poles) == n:
        theta = matching_parameters(plant, W_m, Lambda)
        values["theta_star"] = theta.tolist()
        loop = (matched_feedback(theta, Lambda) * plant).realise()
        values |= margins_of(problem, loop, "with the parameters at theta*", findings)
        assumptions.append(LINEAR)
        lower, upper = controller.lower, controller.upper
        if lower is not None and upper is not None and not ((lower <= theta).all() and (theta <= upper).all()):
            findings.append("theta* lies outside the known set: with projection, convergence is not guaranteed")
    else:
        findings.append(
            f"the plant is of order {len(plant.poles)}, the controller is designed for {n}: the rest is unmodelled, "
            "and no theta* gives the model exactly"
        )
        if isinstance(law, LyapunovLaw) and law.leakage is None and law.dead_zone is None:
            findings.append("the unnormalised law without a modification is not robust: the estimates may drift to a burst")
    lyapunov = isinstance(law, LyapunovLaw)
    guarantee = "e -> 0, all signals bounded" if lyapunov else "all signals bounded, epsilon m in L2, e -> 0"
    assumptions.append(f"guaranteed for such a plant: {guarantee}; no number bounds e")
    return Certificate(values, frozenset(), tuple(assumptions), tuple(findings))
