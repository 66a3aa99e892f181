"""The limits of the numerics for MRAC with output feedback: estimates, made before any simulation. Source: docs/numerics.md."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from barbalat.adaptation.law import AdaptiveLaw, FreezableLaw, OutputErrorLaw
from barbalat.certificates.certificate import Draft
from barbalat.certificates.entry import NotApplicable
from barbalat.certificates.step_limits.frozen_laws import STEP_TOO_LONG, input_poles, of_decay
from barbalat.certificates.step_limits.modes import amplifies, largest_step
from barbalat.controllers.output import mrac_normalized, mrac_unnormalized
from barbalat.controllers.output.matching import filter_polynomial
from barbalat.controllers.output.mrac import MracOutput
from barbalat.linear.l1_norms import l1_norm
from barbalat.linear.largest import largest_from
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import jacobian_function
from barbalat.problem.known_set import Gain
from barbalat.problem.output_feedback import OutputProblem
from barbalat.protocols import BoundedSignal
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

LYAPUNOV = (
    "adaptation_frequency, gamma_max and step_max: estimates, of the loop with the estimates frozen at {where} and the regressor "
    "at its largest there"
)
NORMALISED = "gamma_max and step_max: estimates, of the plain law on a frozen regressor, beside filters and plant"
GAIN_FRACTIONS = np.geomspace(1e-12, 1.0, 240)
"""Fractions of the largest g that are looked at beside g = 0."""


class Frozen(NamedTuple):
    """The loop around a law whose estimates rest: x' = A x + b q, e = c x, and the law's q' = -g e for g = Gamma |omega|^2."""

    A: Array
    b: Array
    c: Array
    omega_squared: float  # a bound of |omega|^2

    def modes(self, g: float) -> Array:
        root = math.sqrt(g)
        top = np.hstack([self.A, root * self.b[:, None]])
        return np.linalg.eigvals(np.vstack([top, np.append(-root * self.c, 0.0)]))


def add_limits(draft: Draft, problem: OutputProblem, controller: MracOutput, simulation: Simulation) -> None:
    """The limits under the contract's keys."""
    law = controller.law
    if not isinstance(law, OutputErrorLaw):
        draft.estimate(_of_parametric_model(problem, controller, law, simulation), NORMALISED)
        return
    theta = draft.get("theta_star")
    where = "theta_hat(0)" if theta is None else "theta*"
    if not isinstance(law, FreezableLaw):
        _without_limits(draft, f"how {type(law).__name__} is modified is not known")
        return
    found = _frozen(problem, controller, law, None if theta is None else np.array(theta), where)
    if isinstance(found, NotApplicable):
        _without_limits(draft, found.why)
    else:
        draft.estimate(_of_lyapunov_law(found, law, simulation), LYAPUNOV.format(where=where))


def _without_limits(draft: Draft, why: str) -> None:
    for key in ("gamma_max", "step_max"):
        draft.missing(key, why)


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
    """At which g, from 0 up, and at which step does the solver amplify a mode that the frozen loop does not."""
    solver, gamma = simulation.solver, Gain(law.gamma).largest
    g = gamma * frozen.omega_squared
    modes = np.concatenate([frozen.modes(part) for part in np.append(g * GAIN_FRACTIONS, 0.0)])
    step = largest_step(simulation, modes)
    values: dict[str, Any] = {"adaptation_frequency": math.sqrt(g * max(float(frozen.c @ frozen.b), 0.0)) or None}
    if law.leakage is not None:
        if math.isinf(law.leakage.largest):  # nothing bounds how fast it makes the estimates decay
            return values
        return values | {"step_max": min(step, solver.real_limit / (gamma * law.leakage.largest))}
    values["step_max"] = step
    if np.ndim(law.gamma) == 0 and frozen.omega_squared > 0:
        largest_g = _largest_g(frozen, simulation)
        values["gamma_max"] = largest_g / frozen.omega_squared if largest_g else STEP_TOO_LONG
    return values


def _largest_g(frozen: Frozen, simulation: Simulation) -> float:
    """The largest g up to which no mode is amplified by the solver alone."""

    def bears(g: float) -> bool:
        return not amplifies(simulation, simulation.dt, frozen.modes(g))

    return largest_from(bears, 1e-12, factor=1.5) if bears(0.0) else 0.0


def _frozen(
    problem: OutputProblem, controller: MracOutput, law: FreezableLaw, theta: Array | None, where: str
) -> Frozen | NotApplicable:
    """From the exact Jacobian at rest with r = 1."""
    plain = replace(controller, law=law.plain, lower=None, upper=None, c_0_min=None)
    loop = ClosedLoop.of(problem, plain)
    loop = replace(loop, paths=tuple(path and replace(path, rate_limit=None) for path in loop.paths))  # one that does not act
    if loop.delayed:
        return NotApplicable("the delay is not in the frozen loop")
    if not isinstance(problem.reference, BoundedSignal):
        return NotApplicable(f"the reference has no bound: {problem.reference!r}")
    equations = plain.bind(problem.known)
    assert isinstance(equations, mrac_unnormalized.Equations)
    state, rows = np.zeros(loop.size), np.arange(loop.size)[loop.theta_hat_rows]
    state[rows] = equations.theta_hat0 if theta is None else theta
    at_rest, commanded = np.zeros(loop.signal_count), np.zeros(loop.signal_count)
    commanded[0] = 1.0  # omega = (0, ..., 0, 1): the last estimate's row and column are the law's and its way into the loop
    J = np.asarray(jacobian_function(loop)(state, commanded))
    places = loop.unpack(np.arange(loop.size))
    others = np.setdiff1d(np.arange(loop.size), rows)
    A, b = J[np.ix_(others, others)], J[others, rows[-1]]
    c = -J[rows[-1], others] / Gain(law.gamma).as_matrix(len(rows))[-1, -1]
    if np.linalg.eigvals(A).real.max() >= 0:
        return NotApplicable(f"with the estimates frozen at {where} the loop is unstable, and nothing bounds its regressor")
    into = (loop.derivative(state, commanded) - loop.derivative(state, at_rest))[others]
    outputs = [np.eye(loop.size)[k, others] for k in (*places.controller.omega_1, *places.controller.omega_2)]
    outputs.append(np.where(np.isin(others, places.x), equations.sign * c, 0.0))  # y
    sizes = [l1_norm(A, into[:, None], output[None], np.zeros((1, 1))).upper for output in outputs]
    return Frozen(A, b, c, problem.reference.bound**2 * float(1 + np.sum(np.square(sizes))))
