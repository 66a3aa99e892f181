"""The certificate of the output-feedback MRAC: theta*, the linear loop there, what the law guarantees."""

from __future__ import annotations

from typing import Any

import numpy as np

from barbalat.adaptation.guarantee import Estimates
from barbalat.adaptation.output_lyapunov import LyapunovLaw
from barbalat.certificates.bounds import laws
from barbalat.certificates.cells import Cell, limits_text, margins_cell
from barbalat.certificates.certificate import Certificate
from barbalat.certificates.linear_loops.margin_values import margins_of
from barbalat.certificates.schemes.output_feedback import LINEAR_LOOP, REST
from barbalat.certificates.step_limits import output_mrac
from barbalat.controllers.output.matching import filter_polynomial, matching_parameters
from barbalat.controllers.output.mrac import MracOutput
from barbalat.linear.systems import TransferFunction
from barbalat.problem.output_feedback import OutputProblem
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array


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


def certificate(problem: OutputProblem, controller: MracOutput, simulation: Simulation) -> Certificate:
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
        assumptions.append(LINEAR_LOOP)
        if equations.box is not None and not equations.box.contains(theta):
            findings.append("theta* lies outside the known set: with projection, convergence is not guaranteed")
        if len(plant.poles) < n:
            findings.append(
                f"theta* is one of many: the plant is of order {len(plant.poles)}, the controller is designed for {n}"
            )
    else:
        findings += _unmodelled(plant, controller)
    found = laws.guarantee_of(law, equations.box)
    sentence = laws.output_convergence(found, normalised=not isinstance(law, LyapunovLaw))
    assumptions.append(f"guaranteed for such a plant: {sentence}; no number bounds e")
    certificate = Certificate(values, frozenset(), tuple(assumptions), tuple(findings))
    return output_mrac.added(certificate, problem, controller, simulation)


def column(problem: OutputProblem, controller: MracOutput, values: dict[str, Any]) -> tuple[str, dict[str, Cell]]:
    """The scheme's name in Table 1 and its statements."""
    law, order = controller.law, len(problem.plant.transfer_function.poles)
    lyapunov = isinstance(law, LyapunovLaw)
    name = "MRAC with output feedback, " + ("unnormalised Lyapunov law" if lyapunov else "normalised law")
    found = laws.guarantee_of(law, controller.bind(problem.known).box)
    sentence = laws.output_convergence(found, normalised=not lyapunov)
    converges = found.error_to_zero and not (lyapunov and found.leaks)
    open_ = None
    if order > controller.order:
        open_ = f"the plant is of order {order} and the design of {controller.order}: the rest is unmodelled"
    elif problem.plant.f is not None:
        open_ = "f(t, y) acts, and the law knows linear plants only"
    elif not found.bounded:
        open_ = sentence
    vanishing = Cell("proven", "converges to zero for every bounded r")
    kept = Cell("not proven", "converges to a set: the law is modified")
    auxiliary = "the auxiliary input leaves 1 - 1/(tau s + 1)^n* of the error, of the order of tau; no number"
    pulled = found.estimates is Estimates.PULLED
    transient = Cell("proven", auxiliary) if controller.tau is not None and open_ is None else Cell("not proven", "no bound")
    return name, {
        "stability": Cell("proven", "for every bounded r") if open_ is None else Cell("not proven", open_),
        "tracking": (vanishing if converges else kept) if open_ is None else Cell("not proven", open_),
        "transient": transient,
        "estimates": _estimates(open_, pulled),
        "modelling_error": _robustness(controller) if found.bounded or lyapunov else Cell("not proven", sentence),
        "tuning": Cell("estimate", limits_text(values)),
        "margins": margins_cell(values),
    }


def _estimates(open_: str | None, pulled: bool) -> Cell:
    if open_ is not None:
        return Cell("not proven", open_)
    if pulled:
        return Cell("proven", "bounded, and pulled towards zero")
    return Cell("proven", "V of the law never grows; they converge to theta* where the regressor is persistently exciting")


def _robustness(controller: MracOutput) -> Cell:
    law = controller.law
    if isinstance(law, LyapunovLaw):
        if law.leakage is None and law.dead_zone is None:
            return Cell("not proven", "not robust: the estimates may drift until the loop bursts (Rohrs)")
        return Cell(
            "not proven", "the estimates stay bounded; that all signals do is proven from a limited set of initial states only"
        )
    if controller.normalization.alpha_0 == 0:
        return Cell("not proven", "needs the dynamic normalisation, alpha_0 > 0 in (16); it is 0 here")
    bounded = controller.lower is not None or laws.guarantee_of(law, None).leaks
    if not bounded:
        return Cell("not proven", "needs projection of all estimates or leakage, and there is neither")
    return Cell(
        "proven",
        "bounded, the mean square of e of the order of Delta, for every Delta that is small enough; how small is not computed",
    )
