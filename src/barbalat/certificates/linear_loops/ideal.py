"""The linear loops to which the schemes reduce, broken at the plant input: L is from the plant's input v to -u.

With known parameters and with infinitely fast adaptation the loops are linear and exact; at a constant command the adaptive loop
is linearised together with its law.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from barbalat.controllers import L1Adaptive, Mrac
from barbalat.linear.systems import StateSpace, series
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import signals_at_rest
from barbalat.loop.packing import column, symbols
from barbalat.problem.known_set import Gain
from barbalat.problem.plant import Plant
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Value
from barbalat.validate import Array


def known_parameters(plant: Plant, theta_hat: Array, C: StateSpace | None = None) -> StateSpace:
    """u = C(s)[-theta_hat'x] on the plant with its true theta: the loop of MRAC (C = 1) or L1-AC with constant estimates."""
    A = plant.A_m + np.outer(plant.b, plant.theta)
    feedback = StateSpace(A, plant.b, np.array(theta_hat, dtype=float), 0.0)
    return feedback if C is None else series(feedback, C)


def fast_adaptation(plant: Plant, C: StateSpace) -> StateSpace:
    """L1-AC for Gamma -> infinity inside the projection bounds, which is an LTI controller.

    The predictor error vanishes, so theta_hat'x becomes theta'x + v - u, the deviation from the desired dynamics. Then u = -C
    [theta'x + v - u], that is L = C/(1 - C) (1 + theta'G), G = (sI - A_m - b theta')^-1 b.
    """
    A = plant.A_m + np.outer(plant.b, plant.theta)
    disturbance = StateSpace(A, plant.b, plant.theta, 1.0)  # 1 + theta'G
    # C/(1 - C): the filter with positive feedback of its output
    integrator = StateSpace(C.A + np.outer(C.B, C.C), C.B, C.C, 0.0)
    return series(disturbance, integrator)


def fast_adaptation_on(A: Array, b: Array, C: StateSpace, A_m: Array, b_m: Array, P: Array) -> StateSpace:
    """The limit of fast adaptation around x' = A x + b v, where A need not have the form A_m + b theta'.

    The error b_m'P (x_hat - x) that drives the law vanishes, so w = theta_hat'x + u in x_hat' = A_m x_hat + b_m w follows from x:
    b_m'P b_m w = b_m'P (A x + b v - A_m x_hat), and u = -C/(1 - C) w. With A = A_m + b_m theta' and b = b_m, w = theta'x + v.
    """
    n, c = len(A), b_m @ P
    size = float(c @ b_m)
    row = (
        np.concatenate([c @ (A + np.eye(n)), -c @ (A_m + np.eye(n))]) / size
    )  # + c (x - x_hat): the error decays without an input
    direct = float(c @ b) / size
    predictor = np.block([[A, np.zeros((n, n))], [np.outer(b_m, row[:n]), A_m + np.outer(b_m, row[n:])]])
    w = StateSpace(predictor, np.concatenate([b, direct * b_m]), row, direct)
    return series(w, StateSpace(C.A + np.outer(C.B, C.C), C.B, C.C, 0.0))


def open_jacobians(loop: ClosedLoop, given_input: Callable[[Value, Value], tuple[Value, Value]]) -> Any:
    """A, B and C of a loop opened at one input v, as a function of its flat state and v.

    given_input  maps the state and v to the state derivative and the scalar output
    """
    import casadi as ca

    state_column, state = symbols("state", loop.size)
    input_column, v = symbols("v", 1)
    slope, out = given_input(state, v[0])
    slope, out = column(slope), column(out.reshape(1))
    rates = [ca.jacobian(slope, state_column), ca.jacobian(slope, input_column), ca.jacobian(out, state_column)]
    return ca.Function("jacobians", [state_column, input_column], rates)


def around_equilibrium(problem: Problem, controller: Mrac | L1Adaptive, r: float) -> StateSpace:
    """The adaptive loop linearised at e = 0, theta_hat = theta under the constant command r, including the law.

    The loop is from the plant's input to the controller's output; the caller adds unmodelled dynamics in between and the sensor
    lag.

    The Jacobians are exact; the law must have the form theta_hat' = Gamma x (scalar), as in MRAC and L1-AC.
    """
    loop = replace(ClosedLoop.of(problem, controller), paths=(None,), delayed=False, lag=None)
    jacobians = open_jacobians(loop, lambda state, v: loop.derivative_given_input(state, signals_at_rest(loop, r), v))
    rest, u_rest = equilibrium(problem, loop, r)
    A, B, C = (np.array(value) for value in jacobians(rest, u_rest))
    moving = _moving_directions(loop, Gain(controller.gamma), loop.unpack(rest).x_m)
    return StateSpace(moving.T @ A @ moving, moving.T @ B[:, 0], -C[0] @ moving, 0.0)


def _moving_directions(loop: ClosedLoop, gamma: Gain, x: Array) -> Array:
    """Orthonormal columns that span the states affected by v: not the model, and the estimates only along Gamma x. At the
    equilibrium the law's rate is Gamma x times a scalar, so the other directions neither change nor affect theta_hat'x."""
    rows, model = loop.theta_hat_rows, loop.unpack(np.arange(loop.size)).x_m
    identity = np.eye(loop.size)
    kept = [i for i in range(loop.size) if i not in model and not rows.start <= i < rows.stop]
    along = np.zeros(loop.size)
    direction = gamma.times(x)
    length = float(np.linalg.norm(direction))
    if length == 0:
        return identity[:, kept]
    along[rows] = direction / length
    return np.column_stack([identity[:, kept], along])


def equilibrium(problem: Problem, loop: ClosedLoop, r: float) -> tuple[Array, float]:
    """The flat state with e = 0 and theta_hat = theta under the constant command r, and the control there.

    The rest of the controller's state is computed as the equilibrium of its linear parts for the given x and u.
    """
    import casadi as ca

    plant = problem.plant
    A_m, B, _ = problem.model.matrices
    x = -np.linalg.solve(A_m, B[:, 0] * r)
    state_column, state = symbols("state", loop.size)
    slope = column(loop.derivative(state, signals_at_rest(loop, r)))
    function = ca.Function("slope", [state_column], [slope, ca.jacobian(slope, state_column)])
    rest = np.array(loop.initial())
    places = loop.unpack(np.arange(loop.size))
    rest[places.x], rest[places.x_m], rest[places.baseline] = x[: len(places.x)], x, x[len(x) - len(places.baseline) :]
    rest[loop.theta_hat_rows] = plant.theta
    settled = np.concatenate([places.x, places.x_m, places.baseline, np.arange(loop.size)[loop.theta_hat_rows]])
    free = np.setdiff1d(np.arange(loop.size), settled)
    for _ in range(3):  # linear in the free part, so the first step is exact and the others remove rounding errors
        value, jacobian = (np.array(part) for part in function(rest))
        if len(free):
            rest[free] -= np.linalg.lstsq(jacobian[:, free], value[:, 0], rcond=None)[0]
    return rest, float(loop.outputs(rest, signals_at_rest(loop, r)).u[0])
