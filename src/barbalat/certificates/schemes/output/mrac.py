"""The certificate of the output-feedback MRAC: theta*, the linear loop with theta*, and the guarantees of the law."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from barbalat.adaptation.guarantee import Estimates, Guarantee
from barbalat.adaptation.law import AdaptiveLaw, FreezableLaw, OutputErrorLaw
from barbalat.certificates import theorems
from barbalat.certificates.assumptions import MEAN_SQUARE, bounded_command, exact_plant, measured, small_enough, undisturbed
from barbalat.certificates.bounds import laws
from barbalat.certificates.cells import estimate, limits_text, margins_cell, nothing, statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Assumption, Entry, NotApplicable
from barbalat.certificates.linear_loops.margin_values import add_margins
from barbalat.certificates.quantities import Quantity
from barbalat.certificates.schemes import midpoint
from barbalat.certificates.schemes.output_feedback import LINEAR_LOOP, START_AT_REST
from barbalat.certificates.step_limits.frozen_laws import STEP_TOO_LONG, input_poles, of_decay
from barbalat.certificates.step_limits.oscillator import amplifies, largest_step
from barbalat.controllers.output import mrac_normalized, mrac_unnormalized
from barbalat.controllers.output.matching import filter_polynomial, matching_parameters
from barbalat.controllers.output.mrac import MracOutput
from barbalat.linear.l1_norms import l1_norm
from barbalat.linear.largest import largest_from
from barbalat.linear.systems import TransferFunction
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import jacobian_function
from barbalat.problem.known_set import Gain
from barbalat.problem.output_feedback import OutputProblem
from barbalat.protocols import BoundedSignal
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

OWN_QUANTITIES = {"theta_star": Quantity("parameters with which the loop equals the model")}


def matched_feedback(theta: Array, Lambda: Array) -> TransferFunction:
    """K(s) of u = -K[y] + ..., for fixed parameters: -(theta_2'alpha + theta_3 Lambda)/(Lambda - theta_1'alpha)."""
    n = len(Lambda)
    theta_1, theta_2, theta_3 = theta[: n - 1], theta[n - 1 : 2 * n - 2], theta[2 * n - 2]
    num = np.polyadd(theta_2 if n > 1 else [0.0], theta_3 * Lambda)
    return TransferFunction(-num, np.polysub(Lambda, theta_1 if n > 1 else [0.0]))


def _unmodelled(plant: TransferFunction, controller: MracOutput) -> list[str]:
    """Sentences about a plant of higher order than the design plant."""
    law = controller.law
    found = [
        f"the plant has order {len(plant.poles)}, but the controller is designed for {controller.order}: the rest is "
        f"unmodelled, and no theta* gives the model exactly"
    ]
    if not plant.is_minimum_phase:
        found.append(f"the plant has a zero with real part {plant.zeros.real.max():.6g}")
    if plant.is_stable and np.sign(plant.dc_gain) == -controller.sign:
        found.append(f"the plant's gain at zero frequency is {plant.dc_gain:.6g}, which contradicts sign = {controller.sign}")
    if isinstance(law, FreezableLaw) and law.drifts:
        found.append("the unnormalised law without a modification is not robust: the estimates may drift until the loop bursts")
    return found


def certificate(problem: OutputProblem, controller: MracOutput, simulation: Simulation) -> Certificate:
    """theta*, the margins with it, the limits on gain and step; these schemes have no numerical bound on the error."""
    controller.bind(problem.known)  # rejects settings that contradict the assumptions
    plant, W_m = problem.plant.transfer_function, problem.reference_model.transfer_function
    draft, n = Draft(own=OWN_QUANTITIES), controller.order
    draft.missing("error_bound", "the theorems for these schemes give no number", theorem=theorems.LEMMA_1_OUTPUT)
    if len(plant.poles) <= n:
        Lambda = filter_polynomial(n, W_m, controller.filter_poles)
        theta = matching_parameters(plant, W_m, Lambda)
        draft.advise({"theta_star": theta.tolist()})
        add_margins(
            draft, problem, (matched_feedback(theta, Lambda) * plant).realise(), "with the parameters at theta*", LINEAR_LOOP
        )
        if len(plant.poles) < n:
            draft.note(f"theta* is not unique: the plant has order {len(plant.poles)}, but the controller is designed for {n}")
    else:
        for sentence in _unmodelled(plant, controller):
            draft.note(sentence)
    add_limits(draft, problem, controller, simulation)
    return draft.finish()


def midpoint_form(problem: OutputProblem, controller: MracOutput, _: float) -> midpoint.MidpointForm:
    """Return the properties that the sampled form preserves: those of the implicit step of its law."""
    return midpoint.of_law(controller.law, controller.bind(problem.known).estimate_set)


def rests_on(problem: OutputProblem, controller: MracOutput) -> tuple[Assumption, ...]:
    """The assumptions of the guarantees of these schemes, checked for the case."""
    n, n_star, order = controller.order, controller.relative_degree, len(problem.plant.transfer_function.poles)
    beyond = f"the plant has order {order}, but the design has order {n}: the rest is unmodelled" if order > n else ""
    known_set, theta = controller.bind(problem.known).estimate_set, _theta_star(problem, controller)
    inside = known_set is None or theta is None or known_set.contains(theta)
    outside = "" if inside else "theta* outside the known set"
    return (
        Assumption(
            f"the plant is of order {n} and relative degree {n_star}, minimum phase, with a gain of the given sign", beyond
        ),
        Assumption("the plant is linear", "f(t, y) acts, but the law is only for linear plants" if problem.plant.f else ""),
        Assumption("theta* is in the known set, and the estimates are projected onto it", outside),
        exact_plant(problem),
        undisturbed(problem),
        measured(problem),
        bounded_command(problem),
        START_AT_REST,
    )


def column(problem: OutputProblem, controller: MracOutput, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """The scheme's name in Table 1 and its cells."""
    found = laws.guarantee_of(controller.law, controller.bind(problem.known).estimate_set)
    theta = _theta_star(problem, controller)
    rest = (*rests_on(problem, controller), laws.bounds_the_parameters(found, theta))
    known, pulled = found.estimates is not Estimates.UNKNOWN, found.estimates is Estimates.PULLED
    settled = "V of the law never grows"
    if found.bounded:
        settled += "; if the regressor is persistently exciting, which is not checked here, the estimates converge"
    auxiliary = "the auxiliary input leaves 1 - 1/(tau s + 1)^n* of the error, of the order of tau; no numerical bound is known"

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
    """The parameters for which the loop equals the model; None if the plant is of higher order than the design plant."""
    plant, W_m, n = problem.plant.transfer_function, problem.reference_model.transfer_function, controller.order
    if len(plant.poles) > n:
        return None
    return matching_parameters(plant, W_m, filter_polynomial(n, W_m, controller.filter_poles))


def _robustness(problem: OutputProblem, controller: MracOutput, found: Guarantee) -> Entry:
    law = controller.law
    if isinstance(law, OutputErrorLaw):
        if not isinstance(law, FreezableLaw):
            return nothing("modelling_error", f"nothing is known about {type(law).__name__}")
        if law.drifts:
            return nothing("modelling_error", "not robust: the estimates may drift until the loop bursts (Rohrs)")
        why = "the estimates stay bounded; boundedness of all signals is known only for a limited set of initial states"
        return nothing("modelling_error", why)
    if controller.normalization.alpha_0 == 0:
        return nothing("modelling_error", "needs the dynamic normalisation, alpha_0 > 0 in (16); it is 0 here")
    if not found.bounded:
        return nothing("modelling_error", found.why)
    if controller.lower is None and not found.leaks:
        return nothing("modelling_error", "needs projection of all estimates or leakage, but the law has neither")
    present = ", ".join(found.broken for found in rests_on(problem, controller) if found.broken)
    ceiling = 1 / controller.normalization.delta_0
    above = controller.tau is not None and controller.tau >= ceiling
    below = Assumption(f"tau < 1/delta_0 = {ceiling:.4g} s", f"tau is not below 1/delta_0 = {ceiling:.4g} s" if above else "")
    enough = laws.bounds_the_parameters(found, _theta_star(problem, controller))
    return statement("modelling_error", MEAN_SQUARE, small_enough(present), below, enough)


LYAPUNOV = (
    "adaptation_frequency, gamma_max and step_max are estimates for the loop with theta_hat frozen at {where} "
    "and the regressor at its largest value there"
)
NORMALISED = "gamma_max and step_max are estimates for the plain law with a frozen regressor, without filters and plant"
GAIN_FRACTIONS = np.geomspace(1e-12, 1.0, 240)
"""Fractions of the largest g at which the loop is checked, in addition to g = 0."""


class Frozen(NamedTuple):
    """The loop with a frozen law: x' = A x + b q, e = c x, and the law's q' = -g e for g = Gamma |omega|^2."""

    A: Array
    b: Array
    c: Array
    omega_squared: float  # a bound on |omega|^2

    def modes(self, g: float) -> Array:
        root = math.sqrt(g)
        top = np.hstack([self.A, root * self.b[:, None]])
        return np.linalg.eigvals(np.vstack([top, np.append(-root * self.c, 0.0)]))


def add_limits(draft: Draft, problem: OutputProblem, controller: MracOutput, simulation: Simulation) -> None:
    """Add the limits under the keys of the JSON contract."""
    law = controller.law
    if not isinstance(law, OutputErrorLaw):
        draft.estimate(_of_parametric_model(problem, controller, law, simulation), NORMALISED)
        return
    theta = draft.get("theta_star")
    where = "theta_hat(0)" if theta is None else "theta*"
    if not isinstance(law, FreezableLaw):
        draft.all_missing(("gamma_max", "step_max"), f"the modification of {type(law).__name__} is not known")
        return
    found = _frozen(problem, controller, law, None if theta is None else np.array(theta), where)
    if isinstance(found, NotApplicable):
        draft.all_missing(("gamma_max", "step_max"), found.why)
    else:
        draft.estimate(_of_lyapunov_law(found, law, simulation), LYAPUNOV.format(where=where))


def _of_parametric_model(
    problem: OutputProblem, controller: MracOutput, law: AdaptiveLaw, simulation: Simulation
) -> dict[str, Any]:
    equations = controller.bind(problem.known)
    assert isinstance(equations, mrac_normalized.Equations)
    plant, W_m = problem.plant.transfer_function, problem.reference_model.transfer_function
    parts = [plant.poles, W_m.poles, np.roots(filter_polynomial(controller.order, W_m, controller.filter_poles))]
    parts += [np.array([-controller.normalization.delta_0]), input_poles(problem)]
    if equations.Q is not None:
        parts.append(np.linalg.eigvals(equations.Q.A))
    poles = np.concatenate(parts)
    return of_decay(law, simulation, largest_step(simulation, poles))


def _of_lyapunov_law(frozen: Frozen, law: FreezableLaw, simulation: Simulation) -> dict[str, Any]:
    """The g, from 0 up, and the step at which the solver amplifies a mode that is stable in the frozen loop."""
    solver, gamma = simulation.solver, Gain(law.gamma).largest
    g = gamma * frozen.omega_squared
    modes = np.concatenate([frozen.modes(part) for part in np.append(g * GAIN_FRACTIONS, 0.0)])
    step = largest_step(simulation, modes)
    values: dict[str, Any] = {"adaptation_frequency": math.sqrt(g * max(float(frozen.c @ frozen.b), 0.0)) or None}
    if law.leakage is not None:
        if math.isinf(law.leakage.largest):  # the decay rate of its estimates has no upper bound
            return values
        return values | {"step_max": min(step, solver.real_limit / (gamma * law.leakage.largest))}
    values["step_max"] = step
    if np.ndim(law.gamma) == 0 and frozen.omega_squared > 0:

        def tolerates(g: float) -> bool:
            return not amplifies(simulation, simulation.dt, frozen.modes(g))

        largest_g = largest_from(tolerates, 1e-12, factor=1.5) if tolerates(0.0) else 0.0
        values["gamma_max"] = largest_g / frozen.omega_squared if largest_g else STEP_TOO_LONG
    return values


def _frozen(
    problem: OutputProblem, controller: MracOutput, law: FreezableLaw, theta: Array | None, where: str
) -> Frozen | NotApplicable:
    """The loop with frozen estimates, from the exact Jacobian at equilibrium with r = 1."""
    plain = replace(controller, law=law.plain, lower=None, upper=None, c_0_min=None)
    loop = ClosedLoop.of(problem, plain)
    loop = replace(loop, paths=tuple(path and replace(path, rate_limit=None) for path in loop.paths))  # the law does not act
    if loop.delayed:
        return NotApplicable("the delay is not in the frozen loop")
    if not isinstance(problem.reference, BoundedSignal):
        return NotApplicable(f"the reference has no bound: {problem.reference!r}")
    equations = plain.bind(problem.known)
    assert isinstance(equations, mrac_unnormalized.Equations)
    state, rows = np.zeros(loop.size), np.arange(loop.size)[loop.theta_hat_rows]
    state[rows] = equations.theta_hat0 if theta is None else theta
    at_rest, commanded = np.zeros(loop.signal_count), np.zeros(loop.signal_count)
    commanded[0] = 1.0  # omega = (0, ..., 0, 1): the last row and column contain the law and its effect on the loop
    J = np.asarray(jacobian_function(loop)(state, commanded))
    places = loop.unpack(np.arange(loop.size))
    others = np.setdiff1d(np.arange(loop.size), rows)
    A, b = J[np.ix_(others, others)], J[others, rows[-1]]
    c = -J[rows[-1], others] / Gain(law.gamma).as_matrix(len(rows))[-1, -1]
    if np.linalg.eigvals(A).real.max() >= 0:
        return NotApplicable(f"with the estimates frozen at {where} the loop is unstable, so its regressor has no bound")
    into = (loop.derivative(state, commanded) - loop.derivative(state, at_rest))[others]
    outputs = [np.eye(loop.size)[k, others] for k in (*places.controller.omega_1, *places.controller.omega_2)]
    outputs.append(np.where(np.isin(others, places.x), equations.sign * c, 0.0))  # y
    sizes = [l1_norm(A, into[:, None], output[None], np.zeros((1, 1))).upper for output in outputs]
    return Frozen(A, b, c, problem.reference.bound**2 * float(1 + np.sum(np.square(sizes))))
