"""The certificate of the output-feedback MRAC: theta*, the linear loop there, what the law guarantees."""

from __future__ import annotations

import numpy as np

from barbalat.adaptation.guarantee import Estimates, Guarantee
from barbalat.adaptation.law import FreezableLaw, OutputErrorLaw
from barbalat.certificates.assumptions import bounded_command, exact_plant, measured, undisturbed
from barbalat.certificates.bounds import laws
from barbalat.certificates.cells import estimate, limits_text, margins_cell, nothing, statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Assumption, Entry
from barbalat.certificates.linear_loops.margin_values import add_margins
from barbalat.certificates.quantities import Quantity
from barbalat.certificates.schemes import midpoint
from barbalat.certificates.schemes.output_feedback import LINEAR_LOOP, START_AT_REST
from barbalat.certificates.step_limits import output_mrac
from barbalat.controllers.output.matching import filter_polynomial, matching_parameters
from barbalat.controllers.output.mrac import MracOutput
from barbalat.linear.systems import TransferFunction
from barbalat.problem.output_feedback import OutputProblem
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

OWN_QUANTITIES = {"theta_star": Quantity("parameters with which the plant is the model")}


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
    if isinstance(law, FreezableLaw) and law.drifts:
        found.append("the unnormalised law without a modification is not robust: the estimates may drift to a burst")
    return found


def certificate(problem: OutputProblem, controller: MracOutput, simulation: Simulation) -> Certificate:
    """theta*, the margins there, the limits of gain and step; no number bounds the error of these schemes."""
    controller.bind(problem.known)  # refuses what contradicts the assumptions
    plant, W_m = problem.plant.transfer_function, problem.reference_model.transfer_function
    draft, n = Draft(own=OWN_QUANTITIES), controller.order
    draft.missing("error_bound", "no number bounds e of these schemes")
    if len(plant.poles) <= n:
        Lambda = filter_polynomial(n, W_m, controller.filter_poles)
        theta = matching_parameters(plant, W_m, Lambda)
        draft.advise({"theta_star": theta.tolist()})
        add_margins(
            draft, problem, (matched_feedback(theta, Lambda) * plant).realise(), "with the parameters at theta*", LINEAR_LOOP
        )
        if len(plant.poles) < n:
            draft.note(f"theta* is one of many: the plant is of order {len(plant.poles)}, the controller is designed for {n}")
    else:
        for sentence in _unmodelled(plant, controller):
            draft.note(sentence)
    output_mrac.add_limits(draft, problem, controller, simulation)
    return draft.finish()


def midpoint_form(problem: OutputProblem, controller: MracOutput, _: float) -> midpoint.MidpointForm:
    """Say what the sampled form keeps: what its law's own implicit step keeps."""
    return midpoint.of_law(controller.law, controller.bind(problem.known).box)


def rests_on(problem: OutputProblem, controller: MracOutput) -> tuple[Assumption, ...]:
    """What the guarantees of these schemes rest on, checked on the case."""
    n, n_star, order = controller.order, controller.relative_degree, len(problem.plant.transfer_function.poles)
    beyond = f"the plant is of order {order} and the design of {n}: the rest is unmodelled" if order > n else ""
    known_set, theta = controller.bind(problem.known).box, _theta_star(problem, controller)
    inside = known_set is None or theta is None or known_set.contains(theta)
    outside = "" if inside else "theta* outside the known set"
    return (
        Assumption(f"the plant is of order {n} and relative degree {n_star}, minimum phase, its gain of the sign given", beyond),
        Assumption("the plant is linear", "f(t, y) acts, and the law knows linear plants only" if problem.plant.f else ""),
        Assumption("theta* lies in the known set, and the estimates are projected onto it", outside),
        exact_plant(problem),
        undisturbed(problem),
        measured(problem),
        bounded_command(problem),
        START_AT_REST,
    )


def column(problem: OutputProblem, controller: MracOutput, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """The scheme's name in Table 1 and its cells."""
    found = laws.guarantee_of(controller.law, controller.bind(problem.known).box)
    theta = _theta_star(problem, controller)
    rest = (*rests_on(problem, controller), laws.bounds_the_parameters(found, theta))
    known, pulled = found.estimates is not Estimates.UNKNOWN, found.estimates is Estimates.PULLED
    settled = "V of the law never grows"
    if found.bounded:
        settled += "; where the regressor is persistently exciting, which isn't checked here, they converge"
    auxiliary = "the auxiliary input leaves 1 - 1/(tau s + 1)^n* of the error, of the order of tau; no number"

    def claimed(key: str, text: str, holds: bool) -> Entry:
        return statement(key, text, *rest) if holds else nothing(key, laws.kept_from_zero(found))

    return "MRAC with output feedback, " + ("unnormalised Lyapunov law" if controller.unnormalized else "normalised law"), {
        "stability": claimed("stability", "for every bounded r", found.bounded),
        "tracking": claimed("tracking", "converges to zero for every bounded r", found.error_to_zero),
        "transient": nothing("transient", "no bound")
        if controller.tau is None
        else claimed("transient", auxiliary, found.bounded),
        "estimates": claimed("estimates", "bounded, and pulled towards zero" if pulled else settled, known),
        "modelling_error": _robustness(problem, controller, found),
        "tuning": estimate("tuning", limits_text(certificate)),
        "margins": margins_cell(certificate),
    }


def _theta_star(problem: OutputProblem, controller: MracOutput) -> Array | None:
    """The parameters with which the plant is the model; None where the plant is of higher order than designed for."""
    plant, W_m, n = problem.plant.transfer_function, problem.reference_model.transfer_function, controller.order
    if len(plant.poles) > n:
        return None
    return matching_parameters(plant, W_m, filter_polynomial(n, W_m, controller.filter_poles))


def _robustness(problem: OutputProblem, controller: MracOutput, found: Guarantee) -> Entry:
    law = controller.law
    if isinstance(law, OutputErrorLaw):
        if not isinstance(law, FreezableLaw):
            return nothing("modelling_error", f"nothing is known of {type(law).__name__}")
        if law.drifts:
            return nothing("modelling_error", "not robust: the estimates may drift until the loop bursts (Rohrs)")
        why = "the estimates stay bounded; that all signals do is known from a limited set of initial states only"
        return nothing("modelling_error", why)
    if controller.normalization.alpha_0 == 0:
        return nothing("modelling_error", "needs the dynamic normalisation, alpha_0 > 0 in (16); it is 0 here")
    if not found.bounded:
        return nothing("modelling_error", found.why)
    if controller.lower is None and not found.leaks:
        return nothing("modelling_error", "needs projection of all estimates or leakage, and there is neither")
    present = ", ".join(found.broken for found in rests_on(problem, controller) if found.broken)
    text = "bounded, the mean square of e of the order of Delta, for every Delta that is small enough; how small is not computed"
    small = Assumption(
        "the case's own modelling error is small enough",
        f"{present}: whether that is small enough is not known" if present else "",
    )
    ceiling = 1 / controller.normalization.delta_0
    above = controller.tau is not None and controller.tau >= ceiling
    below = Assumption(f"tau < 1/delta_0 = {ceiling:.4g} s", f"tau is not below 1/delta_0 = {ceiling:.4g} s" if above else "")
    enough = laws.bounds_the_parameters(found, _theta_star(problem, controller))
    return statement("modelling_error", text, small, below, enough)
