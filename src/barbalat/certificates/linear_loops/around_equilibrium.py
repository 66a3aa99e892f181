"""The adaptive loop linearised at rest under a constant command, with its adaptive law inside."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from barbalat.controllers import L1Adaptive, Mrac
from barbalat.linear.systems import StateSpace
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import signals_at_rest
from barbalat.loop.packing import column, symbols
from barbalat.problem.known_set import Gain
from barbalat.problem.state_feedback import Problem
from barbalat.validate import Array


def around_equilibrium(problem: Problem, controller: Mrac | L1Adaptive, r: float) -> StateSpace:
    """The adaptive loop linearised where e = 0, theta_hat = theta under the constant command r, the law included.

    From the plant's input to the controller's output: unmodelled dynamics between the two, and the sensor's lag, are left to the
    caller.

    Exact Jacobians; for laws of the form theta_hat' = Gamma x (scalar), which are the MRAC's and the L1-AC's.
    """
    import casadi as ca

    loop = replace(ClosedLoop.of(problem, controller), paths=(None,), delayed=False, lag=None)
    state_column, state = symbols("state", loop.size)
    input_column, v = symbols("v", 1)
    slope, u = loop.derivative_given_input(state, signals_at_rest(loop, r), v[0])
    slope = column(slope)
    jacobians = ca.Function(
        "jacobians",
        [state_column, input_column],
        [ca.jacobian(slope, state_column), ca.jacobian(slope, input_column), ca.jacobian(column(u.reshape(1)), state_column)],
    )
    rest, u_rest = equilibrium(problem, loop, r)
    A, B, C = (np.array(value) for value in jacobians(rest, u_rest))
    moving = _moving_directions(loop, Gain(controller.gamma), rest[: problem.plant.n])
    return StateSpace(moving.T @ A @ moving, moving.T @ B[:, 0], -C[0] @ moving, 0.0)


def _moving_directions(loop: ClosedLoop, gamma: Gain, x: Array) -> Array:
    """Orthonormal columns that span what v moves: not the model, and of the estimates only along Gamma x.

    At rest the law's rate is Gamma x times a scalar, so the other directions neither move nor show in theta_hat'x.
    """
    n, rows = len(x), loop.theta_hat_rows
    identity = np.eye(loop.size)
    kept = [i for i in range(loop.size) if not n <= i < 2 * n and not rows.start <= i < rows.stop]
    along = np.zeros(loop.size)
    direction = gamma.times(x)
    length = float(np.linalg.norm(direction))
    if length == 0:
        return identity[:, kept]
    along[rows] = direction / length
    return np.column_stack([identity[:, kept], along])


def equilibrium(problem: Problem, loop: ClosedLoop, r: float) -> tuple[Array, float]:
    """The flat state with e = 0 and theta_hat = theta under the constant command r, and the control there.

    Whatever else the controller integrates is solved for: a rest of its linear parts at the given x and u.
    """
    import casadi as ca

    plant = problem.plant
    x = -np.linalg.solve(plant.A_m, plant.b * (problem.model.k_0 * r))
    state_column, state = symbols("state", loop.size)
    slope = column(loop.derivative(state, signals_at_rest(loop, r)))
    function = ca.Function("slope", [state_column], [slope, ca.jacobian(slope, state_column)])
    rest = np.array(loop.initial())
    n = len(plant.b)
    rest[:n] = rest[n : 2 * n] = x
    rest[loop.theta_hat_rows] = plant.theta
    free = np.setdiff1d(np.arange(2 * n, loop.size), np.arange(loop.size)[loop.theta_hat_rows])
    for _ in range(3):  # linear in what is free: the first step is exact, the others remove rounding
        value, jacobian = (np.array(part) for part in function(rest))
        if len(free):
            rest[free] -= np.linalg.lstsq(jacobian[:, free], value[:, 0], rcond=None)[0]
    return rest, float(loop.outputs(rest, signals_at_rest(loop, r)).u[0])
