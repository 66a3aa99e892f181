"""The certificate of the MIT rule: no proof is known, and its known limitation is evaluated for the case.

At a constant command r with e = 0 the law is linear: with q = omega (k_x_tilde'phi - k_r_tilde r), e = -(sI - A_m)^-1 b [q] and
q' = kappa c'e, kappa = omega G(0) (phi'Gamma phi + gamma_r r^2), which is the loop kappa G(s)/s with G = c'(sI - A_m)^-1 b; for
the feedforward alone, kappa = omega G(0) gamma_r r^2. Its gain grows with Gamma and with the square of the command: if G's phase
falls below -90 degrees, the loop is unstable above some value of either. Source: Astrom and Wittenmark, Adaptive Control, section
5.3, for a feedforward gain alone.
"""

from __future__ import annotations

import math

import numpy as np

from barbalat.certificates import theorems
from barbalat.certificates.assumptions import exact_plant, undisturbed
from barbalat.certificates.bounds.model import model_bounds
from barbalat.certificates.cells import estimate, limits_text, margins_cell, nothing
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Entry
from barbalat.certificates.linear_loops.margin_values import finite
from barbalat.certificates.quantities import Quantity
from barbalat.certificates.schemes.unregistered import add_linearised
from barbalat.controllers.mit_rule import Equations, MitRule
from barbalat.linear.margins import margins
from barbalat.linear.systems import StateSpace
from barbalat.problem.state_feedback import Known, Problem
from barbalat.solvers.simulation import Simulation
from barbalat.validate import InputError

ITS_BASIS = "it follows a gradient that is correct only for constant gains"
NONE_KNOWN = f"no proof is known for the MIT rule: {ITS_BASIS}"
MARGIN = "adaptation_gain_margin"
OWN_QUANTITIES = {
    MARGIN: Quantity("factor on Gamma and gamma_r, or on the squared command, at which the ideal gains become unstable")
}
SLOW_ADAPTATION_RATIO = 1e-4
"""Fraction of the slowest mode of the model. A loop with an integrator this slow is stable with any dynamics behind it."""


def certificate(problem: Problem, controller: MitRule, simulation: Simulation) -> Certificate:
    """The findings of the rule's linearisations: nothing is guaranteed."""
    draft = Draft(own=OWN_QUANTITIES)
    draft.missing("error_bound", NONE_KNOWN, theorem=theorems.MIT_RULE)
    _add_gain_margin(draft, problem, controller)
    add_linearised(draft, problem, controller, simulation)
    return draft.finish()


def _add_gain_margin(draft: Draft, problem: Problem, controller: MitRule) -> None:
    departs = [found.broken for found in (exact_plant(problem, gain_adapted=True), undisturbed(problem)) if found.broken]
    level = model_bounds(problem).r
    if departs or level == 0:
        draft.missing(MARGIN, "; ".join(departs) or "the command is zero")
        return
    known, equations = problem.known, controller.bind(problem.known)
    omega = float(problem.plant.paths[0].gain)
    if equations.feedforward_only and not np.allclose(equations.gains.theta_hat0, problem.parameters / omega, rtol=1e-9, atol=0):
        draft.missing(MARGIN, "the feedback gains, fixed at theta_hat0, are not ideal, so e = 0 is not an equilibrium")
        return
    kappa, steady = _loop_gain(known, equations, level, omega)
    if kappa == 0:
        draft.missing(MARGIN, "G(0) = 0, so the rule is inactive at a constant command")
        return
    slow = SLOW_ADAPTATION_RATIO * float(np.abs(np.linalg.eigvals(known.A_m).real).min()) / steady
    try:
        largest = margins(_loop(known, equations, slow)).gain_up * slow / kappa
    except InputError as error:
        draft.missing(MARGIN, str(error))
        return
    draft.exact({MARGIN: finite(largest)}, f"kappa G(s)/s, the law linearised at the constant command {level:g}")
    if largest < 1:
        draft.note(
            f"linearised at the constant command {level:g}, the ideal gains are unstable: Gamma is {1 / largest:.3g} times too "
            f"high, or the command {math.sqrt(1 / largest):.3g} times too large, and the gains diverge"
        )


def _loop_gain(known: Known, equations: Equations, level: float, omega: float) -> tuple[float, float]:
    """kappa and G(0)."""
    gains, at_rest = equations.gains, np.linalg.solve(known.A_m, -known.b)
    phi = np.asarray(gains.matched.phi(at_rest * float(known.k_0) * level)) * (not equations.feedforward_only)
    steady = float(equations.c @ at_rest)
    g = float(phi @ gains.gamma.times(phi)) + gains.gamma_r * level**2
    if equations.normalization is not None:
        g /= equations.normalization + steady**2 * (float(phi @ phi) + level**2)
    return omega * steady * g, steady


def _loop(known: Known, equations: Equations, kappa: float) -> StateSpace:
    """kappa G(s)/s."""
    n = known.n
    A = np.block([[known.A_m, np.zeros((n, 1))], [kappa * equations.c[None], np.zeros((1, 1))]])
    return StateSpace(A, np.append(known.b, 0.0), np.append(np.zeros(n), 1.0), 0.0)


def column(_problem: Problem, _controller: MitRule, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """The scheme's name in Table 1, and cells that state only computed values."""
    unknown = {key: nothing(key, NONE_KNOWN) for key in ("stability", "tracking", "transient", "estimates", "modelling_error")}
    margin, text = certificate.entry(MARGIN), limits_text(certificate)
    if margin is not None and margin.applies:
        limit = "no gain of the law" if margin.value is None else f"{margin.value:.3g} times the law's gain"
        text = f"linearised at the largest command, {limit} is too high; {text}"
    return "MIT rule", {**unknown, "tuning": estimate("tuning", text), "margins": margins_cell(certificate)}
