"""The certificate of the output-feedback MRAC: theta*, the linear loop there, what the law guarantees."""

from __future__ import annotations

from typing import Any

import numpy as np

from barbalat.certify import laws
from barbalat.certify.certificate import Certificate
from barbalat.certify.loop_values import margins_of
from barbalat.controllers.output.lyapunov import LyapunovLaw
from barbalat.controllers.output.matching import filter_polynomial, matching_parameters
from barbalat.controllers.output.mrac import MracOutput
from barbalat.linear import TransferFunction
from barbalat.output_problem import OutputProblem
from barbalat.validate import Array

REST = "plant, model and controller start at rest"
LINEAR = "margins are exact for the linear loop named; limits at the input, and f(t, y), are not in it"


def matched_feedback(theta: Array, Lambda: Array) -> TransferFunction:
    """K(s) of u = -K[y] + ..., for fixed parameters: -(theta_2'alpha + theta_3 Lambda)/(Lambda - theta_1'alpha)."""
    n = len(Lambda)
    theta_1, theta_2, theta_3 = theta[: n - 1], theta[n - 1 : 2 * n - 2], theta[2 * n - 2]
    num = np.polyadd(theta_2 if n > 1 else [0.0], theta_3 * Lambda)
    return TransferFunction(-num, np.polysub(Lambda, theta_1 if n > 1 else [0.0]))


def _unmodelled(plant: TransferFunction, controller: MracOutput) -> list[str]:
    """What a plant of higher order than designed for has, as sentences."""
    law = controller.law
    found = [
        f"the plant is of order {len(plant.poles)}, the controller is designed for {controller.order}: the rest is unmodelled, "
        "and no theta* gives the model exactly"
    ]
    if not plant.is_minimum_phase:
        found.append(f"the plant has a zero with real part {plant.zeros.real.max():.6g}")
    if plant.is_stable and np.sign(plant.dc_gain) == -controller.sign:
        found.append(f"the plant's gain at zero frequency is {plant.dc_gain:.6g}, against sign = {controller.sign}")
    if isinstance(law, LyapunovLaw) and law.leakage is None and law.dead_zone is None:
        found.append("the unnormalised law without a modification is not robust: the estimates may drift to a burst")
    return found


def certificate(problem: OutputProblem, controller: MracOutput) -> Certificate:
    """theta*, the margins there, and what is guaranteed in words: no number bounds the error of these schemes."""
    equations = controller.bind(problem.known)  # refuses what contradicts the assumptions
    plant, W_m = problem.plant.transfer_function, problem.reference_model.transfer_function
    values: dict[str, Any] = {}
    findings: list[str] = []
    n, n_star, law = controller.order, controller.relative_degree, controller.law
    assumptions = [f"the plant is of order {n} and relative degree {n_star}, minimum phase, its gain of the sign given", REST]
    if len(plant.poles) <= n:
        Lambda = filter_polynomial(n, W_m, controller.filter_poles)
        theta = matching_parameters(plant, W_m, Lambda)
        values["theta_star"] = theta.tolist()
        loop = (matched_feedback(theta, Lambda) * plant).realise()
        values |= margins_of(problem, loop, "with the parameters at theta*", findings)
        assumptions.append(LINEAR)
        if equations.box is not None and not equations.box.contains(theta):
            findings.append("theta* lies outside the known set: with projection, convergence is not guaranteed")
        if len(plant.poles) < n:
            findings.append(
                f"theta* is one of many: the plant is of order {len(plant.poles)}, the controller is designed for {n}"
            )
    else:
        findings += _unmodelled(plant, controller)
    assumptions.append(f"guaranteed for such a plant: {laws.output_convergence(law, equations.box)}; no number bounds e")
    return Certificate(values, frozenset(), tuple(assumptions), tuple(findings))
