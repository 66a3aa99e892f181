"""The claim that a solver for stiff problems does not help: an implicit method at the paper's step, and adaptive ones."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Literal, get_args

import numpy as np

from barbalat.claims import section_v
from barbalat.claims.claim import Claim, verdict
from barbalat.claims.section_v import Runs
from barbalat.claims.variants import numbers
from barbalat.closed_loop import ClosedLoop
from barbalat.grid import Simulation
from barbalat.packing import column, symbols
from barbalat.problem import Problem
from barbalat.protocols import Controller
from barbalat.signals import Sine
from barbalat.simulation import simulate
from barbalat.validate import Array

AdaptiveMethod = Literal["Radau", "BDF", "LSODA"]
"""SciPy's solvers for stiff problems."""
NEWTON_STEPS = 3
"""From the last step's state as the guess; the residual after them is checked."""
EVALUATIONS = 20_000
"""Of the right-hand side, for each of SciPy's solvers, which call back into Python; CVODES goes on to CVODES_END."""
T_END, CVODES_END = 20.0, 10.0
CONVERGED = (1e-6, 5e-7)
"""Steps [s] at which h |lambda| is 0.07 and less: two that agree show what the equations do."""
WINDOW = 0.01
"""[s]: dozens of periods of the adaptation, and little of the command's motion."""
NO_PROJECTION = section_v.l1("L1, no projection", 1e4, projection=False)


@cache
def _ringing_of_runs(h: float) -> dict[str, Array]:
    """How the estimates of L1-AC ring with RK4, by name: (n,)."""
    controllers: list[Controller] = [section_v.l1("L1", 1e4), NO_PROJECTION]
    record_points = round(T_END / WINDOW)
    runs = simulate(section_v.problem(), controllers, Simulation(t_end=T_END, dt=h, record_points=record_points))
    return {name: _ringing(run.envelope.theta_hat_min, run.envelope.theta_hat_max) for name, run in runs.items()}


def _ringing(least: Array, greatest: Array) -> Array:
    """Half the largest swing within one WINDOW of the tail, from the extrema over each window, (windows, n)."""
    return np.asarray((greatest - least)[3 * len(least) // 4 :].max(axis=0) / 2)


def own_oscillation() -> Claim:
    """What is left of the oscillation when the step goes to zero."""
    shown, first, second = (_ringing_of_runs(h) for h in (section_v.FINE, *CONVERGED))
    free = "L1, no projection"
    agree = bool(np.allclose(first[free], second[free], rtol=0.1))
    return Claim(
        "own-oscillation", "Section V, Figure 4", "With the step reduced to 1e-5 s the oscillation is gone, because it was numerical",
        verdict(holds=bool((second["L1"] < 0.01).all()), conditional=agree and bool((second[free] > 3 * shown[free]).all())),
        f"the estimates' ringing at h = 1e-5, 1e-6, 5e-7 s: with projection {', '.join(numbers(r['L1']) for r in (shown, first, second))}: gone. "
        f"Without projection {', '.join(numbers(r[free]) for r in (shown, first, second))}: there the equations themselves ring, and at h = 1e-5 s "
        "RK4's own damping hides it",
        f"L1-AC, kappa = 0.02 s, Gamma = 1e4, RK4, {T_END:g} s; ringing: half the largest swing within {WINDOW:g} s, over every step of the last quarter",
    )  # fmt: skip


def stiff_solvers(runs: Runs) -> Claim:
    """Section V without projection at the step where RK4 diverges."""
    h, given = section_v.COARSE, section_v.problem()
    loop = ClosedLoop.of(given, NO_PROJECTION)
    rk4 = runs.coarse["L1, no projection"].diverged_at
    smooth, converged = (_ringing_of_runs(step)["L1, no projection"] for step in (section_v.FINE, CONVERGED[1]))
    midpoint, euler = (_fixed_step(loop, given, h, weight) for weight in (1 / 2, 1.0))
    reached = ", ".join(f"{name} {adaptive(loop, given, name):.2g} s" for name in get_args(AdaptiveMethod))
    bdf, evaluations = cvodes(loop, given)
    bounded = bool(np.isfinite(bdf).all() and np.abs(bdf).max() < 1e3)
    return Claim(
        "stiff-solvers", "Section V", "Even with a solver for stiff problems the phenomenon cannot be avoided",
        verdict(holds=not (midpoint.bounded and euler.bounded and bounded and (euler.ringing < 2 * smooth).all())),
        f"without projection: RK4 at h = 1e-4 s diverges at t = {rk4:.3g} s. At the same step the implicit midpoint {midpoint}, implicit Euler {euler}; "
        f"the converged solution rings by {numbers(converged)}: the midpoint damps its own ringing too little, Euler "
        f"all of it. Cost: {round(NEWTON_STEPS / h)} Newton steps per simulated s, against {round(4 / section_v.FINE)} evaluations for RK4 at h = 1e-5 s. "
        f"Automatic steps follow the ringing: BDF (CVODES) {'stays bounded' if bounded else 'does not stay bounded'} to t = {CVODES_END:g} s with "
        f"{evaluations / CVODES_END:.2g} evaluations per s; {EVALUATIONS} evaluations take SciPy's {reached}",
        f"{NEWTON_STEPS} Newton steps of the exact Jacobian (largest residual {max(midpoint.residual, euler.residual):.0e}), {T_END:g} s; converged: RK4 "
        f"at h = {CONVERGED[1]:g} s; automatic steps: relative tolerance 1e-6, exact Jacobian",
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class FixedStepRun:
    """How an implicit run ended: the ringing of the estimates, and the method's own residual."""

    bounded: bool
    ringing: Array
    residual: float

    def __str__(self) -> str:
        return f"stays bounded and rings by {numbers(self.ringing)}" if self.bounded else "does not stay bounded"


def _fixed_step(loop: ClosedLoop, given: Problem, h: float, weight: float) -> FixedStepRun:
    states, residual = implicit(loop, given, h, T_END, weight)
    windows = states[loop.theta_hat_rows].T.reshape(round(T_END / WINDOW), round(WINDOW / h), -1)
    ringing = _ringing(windows.min(axis=1), windows.max(axis=1))
    return FixedStepRun(bool(np.isfinite(states).all() and residual < 1e-6), ringing, residual)


def cvodes(loop: ClosedLoop, problem: Problem) -> tuple[Array, int]:
    """States (size, N) of SUNDIALS' BDF code on [0, CVODES_END], and its evaluations of the right-hand side."""
    import casadi as ca

    state_column, state = symbols("state", loop.size)
    command, r = symbols("r", 1)
    t = ca.SX.sym("t")
    assert isinstance(problem.reference, Sine)
    reference = problem.reference.amplitude * ca.sin(problem.reference.frequency * t + problem.reference.phase)
    slope = ca.substitute(column(loop.derivative(state, r)), command, reference)
    options = {"reltol": 1e-6, "abstol": 1e-8, "max_num_steps": 10**9}
    equations = {"x": state_column, "t": t, "ode": slope}
    solver = ca.integrator("solver", "cvodes", equations, 0.0, np.linspace(0, CVODES_END, 1001), options)
    states = np.array(solver(x0=loop.initial())["xf"])
    return states, int(solver.stats()["nfevals"])


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
        path, errors = (np.array(part) for part in many(state, problem.commands[0](middle)))
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
        return np.array(function(y, problem.commands[0](np.array([t]))))[:, 0]

    def exact_jacobian(t: float, y: Array) -> Array:
        return np.array(jacobian(y, problem.commands[0](np.array([t]))))

    try:
        solve_ivp(right_hand_side, (0, T_END), loop.initial(), method=method, jac=exact_jacobian, rtol=1e-6, atol=1e-8)
    except _BudgetSpentError:
        return reached
    return T_END
