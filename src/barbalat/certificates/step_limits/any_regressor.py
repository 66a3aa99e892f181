"""The numerical limits for any regressor, several inputs and an unknown input gain, from a bound on |phi(x)| over a box.

|x_i| <= |x_m,i| + |e|, and |e| <= nu_0/sqrt(Gamma) by (9), which holds for MRAC with every regressor; for L1-AC it is an
assumption. Over that box, ball arithmetic bounds |phi(x)|_2, and omega_a^2 <= Gamma |phi|_2^2 ||b'P b||.

Oscillations are expected beyond the limits for the motion of the model, where x = x_m and u has its ideal value. A plant with an
actuator, a limit or a disturbance does not follow that motion and has no such limits. Source: docs/numerics.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from barbalat.certificates.assumptions import departures
from barbalat.certificates.bounds import laws
from barbalat.certificates.bounds.formulas import largest_square
from barbalat.certificates.bounds.model import command_bounds, motion_along_the_command, state_bounds
from barbalat.certificates.entry import NotApplicable
from barbalat.certificates.requested_keys import is_needed
from barbalat.certificates.step_limits.frozen_laws import (
    KEYS_AT_MODEL,
    STEP_TOO_LONG,
    FrozenLaw,
    under_the_solver,
    with_modifications,
)
from barbalat.controllers import robust_mrac_several
from barbalat.controllers.robust_mrac import Equations
from barbalat.linear.driven_response import driven_response
from barbalat.linear.largest import largest_from
from barbalat.loop.packing import column, symbols
from barbalat.problem.known_set import Gain
from barbalat.problem.state_feedback import Problem
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, signal_values

MOST_HALVINGS = 60
"""Number of gains tried below the largest possible one, each half of the previous one."""


def of_lyapunov_law(
    excited: Excited, simulation: Simulation, nu_0: float, filter_poles: Array | None = None, oscillator: FrozenLaw | None = None
) -> dict[str, Any]:
    """adaptation_frequency, gamma_max, step_max under the keys of the JSON contract; ``None`` where there is no limit."""
    problem, controller, gamma = excited.problem, excited.controller, excited.controller.gamma
    oscillator = oscillator or under_the_solver(problem, simulation, filter_poles)
    g = Gain(gamma).largest * excited.largest_square(laws.error_level(problem, controller, nu_0))
    if not math.isfinite(g):
        return {}
    values: dict[str, Any] = {
        "adaptation_frequency": math.sqrt(oscillator.bPb * g),
        "gamma_max": None if np.ndim(gamma) else _largest_gain(excited, oscillator.largest_g(simulation.dt), nu_0),
        "step_max": oscillator.largest_step(g),
    }
    return with_modifications(values, controller, simulation)


@dataclass(frozen=True, eq=False)
class Excited:
    """Bounds on the regressor of the law.

    divides_by_gain  whether u is divided by the estimate of an unknown input gain, as in MRAC, without a filter or predictor that
                     compensates for this; the coupling is then multiplied by omega/omega_hat
    """

    problem: Problem
    controller: laws.ModifiedScheme
    divides_by_gain: bool

    def largest_square(self, error: float) -> float:
        """The largest |phi|_2^2, with u appended to phi if its gain is unknown, while no component of e exceeds ``error``."""
        problem = self.problem
        bounds = self._model + error
        phi = largest_square(problem.plant.regressor, -bounds, bounds)
        gains = problem.known.gains
        if gains is None:
            return phi
        command = command_bounds(problem)
        u = (self._largest_theta() * math.sqrt(phi) + command) / gains.lower
        ratio = float(np.max(gains.upper / gains.lower)) if self.divides_by_gain else 1.0
        return ratio * (phi + float(np.max(u**2)))

    @cached_property
    def _model(self) -> Array:
        """(n,) bounds on the state of the model, cached because a search for a gain uses them repeatedly."""
        return np.array(state_bounds(self.problem))

    def _largest_theta(self) -> float:
        """A bound on |theta_hat|_2 without the gains: |theta|_2 plus the bound on its error from V, or the bound from the known
        set."""
        problem = self.problem
        equations, theta = self.controller.bind(problem.known), problem.plant.theta
        error = equations.theta_hat0 - problem.parameters
        largest = float(np.linalg.norm(theta) + np.linalg.norm(error))
        known_set = problem.uncertainty
        if known_set is None or equations.estimate_set is None or not equations.estimate_set.bounds_theta:
            return largest
        return min(largest, known_set.farthest(np.zeros(known_set.size)))


def _largest_gain(excited: Excited, largest_g: float, nu_0: float) -> float | NotApplicable | None:
    """The largest Gamma with Gamma |phi|^2 <= largest_g; ``None`` for phi = 0, where the gain is unlimited.

    |phi|^2 decreases with Gamma, as the error does, so its limit for Gamma -> infinity yields a gain that is too large.
    """

    def tolerates(gamma: float) -> bool:
        return gamma * excited.largest_square(nu_0 / math.sqrt(gamma)) <= largest_g

    if largest_g == 0:
        return STEP_TOO_LONG
    at_rest = excited.largest_square(0.0)
    if at_rest == 0:
        return None
    beyond = largest_g / at_rest * (1 + 1e-9)
    found = largest_from(tolerates, beyond, within=1e-3, least=beyond / 2**MOST_HALVINGS)
    return found or NotApplicable(
        f"no gain is shown to be tolerated: the bound on |phi| grows as the gain falls, so Gamma |phi|^2 stays above the "
        f"{largest_g:.4g} that the step tolerates"
    )


def of_lyapunov_law_at_model(
    excited: Excited, simulation: Simulation, filter_poles: Array | None = None, oscillator: FrozenLaw | None = None
) -> dict[str, Any]:
    """gamma_max_at_model and step_max_at_model of the plain law; none for a modified law, or if phi is not a number."""
    problem, gamma = excited.problem, excited.controller.gamma
    if laws.is_modified(excited.controller) or departures(problem) or not is_needed(*KEYS_AT_MODEL.values()):
        return {}
    square = _largest_square_at_model(problem, simulation)
    if not 0 < square < math.inf:
        return {}
    oscillator = oscillator or under_the_solver(problem, simulation, filter_poles)
    values = {"step_max_at_model": oscillator.largest_step(Gain(gamma).largest * square)}
    largest_g = oscillator.largest_g(simulation.dt)
    return values if np.ndim(gamma) or largest_g == 0 else {"gamma_max_at_model": largest_g / square} | values


def _largest_square_at_model(problem: Problem, simulation: Simulation) -> float:
    """The largest |phi|_2^2, with the largest u_j^2 if gains are unknown; infinite if phi is not finite."""
    import casadi as ca

    known = problem.known
    t, x_m = motion_along_the_command(problem, simulation)
    state_column, x = symbols("x", known.n)
    phi, matched = known.matched.regressor(x), known.matched.phi(x).T @ problem.plant.theta
    parts = ca.Function("parts", [state_column], [column(phi), column(np.reshape(matched, -1))])
    phi_m, matched_m = (np.array(part) for part in parts(x_m.T))
    with np.errstate(over="ignore", invalid="ignore"):  # there is no limit for NaN
        squares = np.sum(phi_m**2, axis=0)
    if known.gains is not None:
        commands = np.stack([signal_values(signal, t) for signal in problem.commands])
        gains = np.array([path.gain for path in problem.plant.paths])
        u = (np.reshape(known.k_0, (known.inputs, -1)) @ commands - matched_m) / gains[:, None]
        squares = squares + np.max(u**2, axis=0)
    largest = float(squares.max())
    return largest if math.isfinite(largest) else math.inf


def of_parametric_model_at_model(
    problem: Problem, equations: Equations | robust_mrac_several.Equations, simulation: Simulation, values: dict[str, Any]
) -> dict[str, Any]:
    """The gain limit of a law on (13) at the model's motion, from ``values``, which hold for |phi|^2 < m_s^2.

    phi is x_m after the filters, m_s^2 = 1 + |phi|^2: the dynamic part, which would make the law even slower, is ignored.
    """
    gamma = values.get("gamma_max")
    if not isinstance(equations, Equations) or not isinstance(gamma, float) or departures(problem):
        return {}
    if not is_needed(KEYS_AT_MODEL["gamma_max"]):
        return {}
    n, A_m = problem.known.n, problem.known.A_m
    b = problem.known.b.reshape(n)
    identity, zero = np.eye(n), np.zeros((n * n, n))
    A = np.block([[A_m, zero.T], [np.kron(identity, b[:, None]), np.kron(identity, A_m)]])
    B = np.concatenate([problem.model.matrices[1], np.zeros((n * n, 1))])
    C = np.hstack([np.zeros((n, n)), np.kron(identity, equations.c_0[None])])
    start = np.concatenate([problem.known.x0, np.zeros(n * n)])
    _, phi = driven_response(A, B, C, start, problem.commands, simulation.t_end, simulation.steps)
    square = float(np.max(np.sum(phi**2, axis=1)))
    return {"gamma_max_at_model": gamma * (1 + square) / square} if square > 0 else {}
