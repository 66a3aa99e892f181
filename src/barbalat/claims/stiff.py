"""The claim that a solver for stiff problems does not help: an implicit method at the paper's step, and adaptive ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from barbalat.claims import section_v
from barbalat.claims.claim import Claim, verdict
from barbalat.claims.section_v import Runs
from barbalat.claims.variants import numbers
from barbalat.closed_loop import ClosedLoop, column, symbols
from barbalat.problem import Problem
from barbalat.validate import Array

AdaptiveMethod = Literal["Radau", "BDF", "LSODA"]
"""SciPy's solvers for stiff problems."""
NEWTON_STEPS = 3
"""From the last step's state as the guess; the residual after them is checked."""
EVALUATIONS = 30_000
"""Of the right-hand side, for each adaptive solver: about what the implicit method spends on two seconds of the run."""


def claims(runs: Runs) -> list[Claim]:
    """All of this group; ``runs`` are those of the figures."""
    return [stiff_solvers(runs)]


def stiff_solvers(runs: Runs) -> Claim:
    """Section V without projection at the step where RK4 diverges."""
    h, given = 1e-4, section_v.problem()
    loop = ClosedLoop.of(given, section_v.l1("L1", 1e4, projection=False))
    fine = np.array(runs.fine["L1, gamma 1e4, no projection"].figures["theta_hat_variation_rate"])
    rk4 = runs.coarse["L1, no projection"].diverged_at
    midpoint, euler = (_fixed_step(loop, given, h, weight) for weight in (1 / 2, 1.0))
    outcomes = {
        name: f"{run}{', as the fine run' if run.bounded and (run.rate < 10 * fine).all() else ''}"
        for name, run in (("implicit midpoint", midpoint), ("implicit Euler", euler))
    }
    avoided = any(run.bounded and bool((run.rate < 10 * fine).all()) for run in (midpoint, euler))
    reached = ", ".join(f"{name} {adaptive(loop, given, name):.2g} s" for name in get_args(AdaptiveMethod))
    return Claim(
        "stiff-solvers", "Section V", "Even with a solver for stiff problems the phenomenon cannot be avoided",
        verdict(holds=not avoided),
        f"without projection, h = 1e-4 s: RK4 diverges at t = {rk4:.3g} s; "
        + "; ".join(f"{name} {outcome}" for name, outcome in outcomes.items())
        + f"; the fine run, RK4 at h = 1e-5 s: {numbers(fine)} per s. Adaptive solvers follow the oscillation: within {EVALUATIONS} "
        f"evaluations they reach t = {reached}",
        f"{NEWTON_STEPS} Newton steps of the exact Jacobian (largest residual {max(midpoint.residual, euler.residual):.0e}), 60 s; SciPy's "
        "solvers, relative tolerance 1e-6",
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class FixedStepRun:
    """How an implicit run ended: the variation of the estimates in the tail [1/s], and the method's own residual."""

    bounded: bool
    rate: Array
    residual: float

    def __str__(self) -> str:
        return f"stays bounded, variation {numbers(self.rate)} per s" if self.bounded else "does not stay bounded"


def _fixed_step(loop: ClosedLoop, given: Problem, h: float, weight: float) -> FixedStepRun:
    states, residual = implicit(loop, given, h, section_v.T_END, weight)
    theta_hat = states[loop.theta_hat_rows]
    tail = theta_hat[:, 3 * theta_hat.shape[1] // 4 :]
    rate = np.abs(np.diff(tail, axis=1)).sum(axis=1) / (section_v.T_END / 4)
    return FixedStepRun(bool(np.isfinite(states).all() and residual < 1e-6), rate, residual)


def implicit(loop: ClosedLoop, problem: Problem, h: float, t_end: float, weight: float) -> tuple[Array, float]:
    """States (size, N) after each step, and the largest residual of the method's equation, relative to the state.

    The slope is taken at (1 - weight) old + weight new: 1/2 is the midpoint rule, 1 is Euler's implicit method.
    """
    import casadi as ca

    old, y = symbols("old", loop.size)
    new, z = symbols("new", loop.size)
    command, r = symbols("r", 1)
    defect = new - old - h * column(loop.derivative((1 - weight) * y + weight * z, r))
    newton = ca.Function("newton", [old, new, command], [new - ca.solve(ca.jacobian(defect, new), defect)], {"cse": True})
    guess = old
    for _ in range(NEWTON_STEPS):
        guess = newton(old, guess, command)
    residual = ca.norm_inf(ca.substitute(defect, new, guess)) / (1 + ca.norm_inf(old))
    step = ca.Function("step", [old, command], [guess, residual], {"cse": True})
    count, chunk = round(t_end / h), 10_000
    many = step.mapaccum("many", chunk)
    state, states, largest = loop.initial(), [], 0.0
    for first in range(0, count, chunk):
        middle = (np.arange(first, first + chunk) + weight) * h
        path, errors = (np.array(part) for part in many(state, problem.reference(middle)))
        state = path[:, -1]
        states.append(path)
        largest = max(largest, float(np.nan_to_num(errors, nan=np.inf).max()))
    return np.concatenate(states, axis=1), largest


class _BudgetSpentError(Exception):
    """The solver has used its evaluations."""


def adaptive(loop: ClosedLoop, problem: Problem, method: AdaptiveMethod) -> float:
    """The time that SciPy's solver reaches within the evaluations."""
    import casadi as ca
    from scipy.integrate import solve_ivp

    state_column, state = symbols("state", loop.size)
    command, r = symbols("r", 1)
    slope = column(loop.derivative(state, r))
    function = ca.Function("slope", [state_column, command], [slope])
    jacobian = ca.Function("jacobian", [state_column, command], [ca.densify(ca.jacobian(slope, state_column))])
    spent, reached = 0, 0.0

    def right_hand_side(t: float, y: Array) -> Array:
        nonlocal spent, reached
        spent, reached = spent + 1, max(reached, t)
        if spent > EVALUATIONS:
            raise _BudgetSpentError
        return np.array(function(y, problem.reference(np.array([t]))))[:, 0]

    def exact_jacobian(t: float, y: Array) -> Array:
        return np.array(jacobian(y, problem.reference(np.array([t]))))

    try:
        solve_ivp(right_hand_side, (0, section_v.T_END), loop.initial(), method=method, jac=exact_jacobian, rtol=1e-6, atol=1e-8)
    except _BudgetSpentError:
        return reached
    return section_v.T_END
