"""From where oscillations are due, where phi is not x alone: the limits with the plant at the model's own motion.

There x = x_m, and u is what the parameters themselves would make it. A plant with an actuator, a limit or a disturbance does not
move so, and has no such side. Source: docs/numerics.md.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from barbalat.certificates.assumptions import departures
from barbalat.certificates.bounds.laws import is_modified
from barbalat.certificates.bounds.model import motion_along_the_command
from barbalat.certificates.needed import is_needed
from barbalat.certificates.step_limits.any_regressor import Excited
from barbalat.certificates.step_limits.frozen_laws import KEYS_AT_MODEL, FrozenLaw, input_poles
from barbalat.certificates.step_limits.oscillator import Oscillator
from barbalat.controllers import robust_mrac_several
from barbalat.controllers.robust_mrac import Equations
from barbalat.linear.driven_response import driven_response
from barbalat.loop.packing import column, symbols
from barbalat.problem.known_set import Gain
from barbalat.problem.state_feedback import Problem
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, signal_values


def of_lyapunov_law(
    excited: Excited, simulation: Simulation, filter_poles: Array | None = None, oscillator: FrozenLaw | None = None
) -> dict[str, Any]:
    """gamma_max_at_model and step_max_at_model of the plain law; none of a modified one, nor where phi is no number."""
    problem, gamma = excited.problem, excited.controller.gamma
    if is_modified(excited.controller) or departures(problem) or not is_needed(*KEYS_AT_MODEL.values()):
        return {}
    square = _largest_square(problem, simulation)
    if not 0 < square < math.inf:
        return {}
    if oscillator is None:
        beside = [input_poles(problem), np.zeros(0) if filter_poles is None else filter_poles]
        oscillator = Oscillator(problem.known, simulation.solver, np.concatenate(beside))
    values = {"step_max_at_model": oscillator.largest_step(Gain(gamma).largest * square)}
    largest_g = oscillator.largest_g(simulation.dt)
    return values if np.ndim(gamma) or largest_g == 0 else {"gamma_max_at_model": largest_g / square} | values


def _largest_square(problem: Problem, simulation: Simulation) -> float:
    """phi|_2^2, with the largest u_j^2 where the gains are unknown; infinite where the regressor has no number there.|Return the
    largest |phi|_2^2, with the largest u_j^2 where gains are unknown; infinite where phi is not finite.|phi|_2^2, with the
    largest u_j^2 where the gains are unknown; infinite where the regressor has no number there."""
    import casadi as ca

    known = problem.known
    t, x_m = motion_along_the_command(problem, simulation)
    state_column, x = symbols("x", known.n)
    phi, matched = known.uncertainty.regressor(x), known.uncertainty.phi(x).T @ problem.plant.theta
    parts = ca.Function("parts", [state_column], [column(phi), column(np.reshape(matched, -1))])
    phi_m, matched_m = (np.array(part) for part in parts(x_m.T))
    with np.errstate(over="ignore", invalid="ignore"):  # what is no number has no limit
        squares = np.sum(phi_m**2, axis=0)
    if known.gains is not None:
        commands = np.stack([signal_values(signal, t) for signal in problem.commands])
        gains = np.array([path.gain for path in problem.plant.paths])
        u = (np.reshape(known.k_0, (known.inputs, -1)) @ commands - matched_m) / gains[:, None]
        squares = squares + np.max(u**2, axis=0)
    largest = float(squares.max())
    return largest if math.isfinite(largest) else math.inf


def of_parametric_model(
    problem: Problem, equations: Equations | robust_mrac_several.Equations, simulation: Simulation, values: dict[str, Any]
) -> dict[str, Any]:
    """phi|^2 < m_s^2: phi is what the filters make of x_m.|Return the limits of a gradient law on (13) from its ``values`` at
    |phi|^2 < m_s^2; phi is x_m after the filters.|phi|^2 < m_s^2: phi is what the filters make of x_m.

    m_s^2 = 1 + |phi|^2: the dynamic part is not counted, which makes the law slower yet.
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
    B = np.concatenate([b * float(problem.known.k_0), np.zeros(n * n)])[:, None]
    C = np.hstack([np.zeros((n, n)), np.kron(identity, equations.c_0[None])])
    start = np.concatenate([problem.known.x0, np.zeros(n * n)])
    _, phi = driven_response(A, B, C, start, problem.commands, simulation.t_end, simulation.steps)
    square = float(np.max(np.sum(phi**2, axis=1)))
    return {"gamma_max_at_model": gamma * (1 + square) / square} if square > 0 else {}
