"""Solvers for stiff problems on one closed loop: implicit steps compiled as a kernel, SciPy's codes, and SUNDIALS' CVODES.

The projection makes the right-hand side jump. An implicit step is made without the projection, and the estimate is then replaced
by the nearest point of the known set. This is Lie splitting of first order, as in the catching-up method for sweeping processes.
The variable-step codes get the limited right-hand side itself, as every stage of our own solvers does. They locate the jumps by
their step control, with limited success. Their Jacobian is evaluated on the side of the jump on which the
state lies.
"""

from __future__ import annotations

import contextlib
import io
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import column, symbols
from barbalat.lowering.compiled import Compiled
from barbalat.lowering.llvm.machine import Kernel
from barbalat.lowering.operations import read
from barbalat.lowering.optimize import optimize
from barbalat.lowering.shape import LoopShape
from barbalat.problem.known_set import ParameterBox
from barbalat.problem.state_feedback import Problem
from barbalat.processes import undisturbed
from barbalat.signals import Sine
from barbalat.validate import Array

if TYPE_CHECKING:
    import casadi as ca

SciPyMethod = Literal["Radau", "BDF", "LSODA"]
"""SciPy's solvers for stiff problems."""
NEWTON_STEPS = 3
"""Number of Newton steps, which start from the state of the last step. The residual after them is checked."""
LARGEST_RESIDUAL = 1e-6
"""Largest residual of the method's equation. After a window that exceeds it, a run's values are NaN."""
DIVERGED_ESTIMATE = 1e3
"""An estimate of this size has diverged. The converged estimates stay below 9, and their bounds are 5."""
RINGING_WINDOW = 0.01
"""Window [s] with dozens of periods of the adaptation, during which the command changes little."""
STEPS_UNDISTURBED = 200
"""Number of steps between two checks for Ctrl-C. A check takes as long as a step, and this number of steps of the slowest code
takes 0.1 s."""
REPORT_STEP = 5e-5
"""Time [s] between the output points of CVODES, of which there are 15 or more per period of the adaptation."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SolverPath:
    """The estimates that a solver computed, and the cost.

    least, greatest  (windows, n) extrema over each window from t = 0 on, NaN if the solver had no point in it
    final            (n,) the estimates at the end
    reached          the time at which the path ends [s]: the horizon, a loss, or the limit on evaluations
    lost             whether the run diverged, or the solver could not solve its own equation
    evaluations      number of evaluations of the right-hand side, or of an implicit method's Newton steps
    seconds          time of one core of this computer, including compilation
    """

    least: Array
    greatest: Array
    final: Array
    reached: float
    lost: bool
    evaluations: int
    seconds: float

    def ringing(self, start: float, end: float) -> Array:
        """Return half the largest swing (n,) of each estimate within one window of [start, end] s, without its drift.

        The drift is the motion of the swing's middle from one window to the next. NaN marks an unknown swing.
        """
        chosen = slice(round(start / RINGING_WINDOW), round(end / RINGING_WINDOW))
        drift = np.abs(np.gradient((self.least + self.greatest) / 2, axis=0))
        swings = np.maximum(self.greatest - self.least - drift, 0.0)[chosen]
        return np.asarray(np.where(np.isfinite(swings).any(axis=0), np.nanmax(swings, axis=0, initial=0.0) / 2, np.nan))


def implicit(
    loop: ClosedLoop, problem: Problem, h: float, t_end: float, weight: float, box: ParameterBox
) -> tuple[SolverPath, SolverPath]:
    """Take implicit steps with and without projection, in two lanes. ``loop`` is the loop without projection.

    The slope is evaluated at (1 - weight) old + weight new. A weight of 1/2 gives the midpoint rule, and 1 gives Euler's implicit
    method. If the method's equation is not solved to LARGEST_RESIDUAL, all later windows are NaN.
    """
    started = time.process_time()
    rows, size = loop.theta_hat_rows, loop.size
    n, blocks, steps = rows.stop - rows.start, round(t_end / RINGING_WINDOW), round(RINGING_WINDOW / h)
    shape = LoopShape(size, 2 * n + 1, 2 * n, 1)
    resets = (np.inf,) * n + (-np.inf,) * n + (0.0,)
    kernel = Kernel(optimize(read(_implicit_step(loop, h, weight))), shape, resets, lanes=2)
    free = np.full(n, np.inf)
    bounds = np.array([np.concatenate([-free, free]), np.concatenate([box.lower, box.upper])]).T.copy()
    state, out = np.repeat(loop.initial()[:, None], 2, axis=1), np.empty((blocks, size + shape.accumulators, 2))
    command = problem.commands[0]((np.arange(blocks * steps) + weight) * h)
    kernel(blocks, steps, state, bounds, command, out)
    seconds = time.process_time() - started
    paths = []
    for lane in range(2):
        least, greatest, residual = np.split(out[:, size:, lane], [n, 2 * n], axis=1)
        lost = np.logical_or.accumulate(~(residual < LARGEST_RESIDUAL))
        known = (np.where(lost, np.nan, extremum) for extremum in (least, greatest))
        reached = float(t_end if not lost.any() else lost.argmax() * RINGING_WINDOW)
        paths.append(
            SolverPath(
                least=next(known),
                greatest=next(known),
                final=state[rows, lane],
                reached=reached,
                lost=bool(lost.any()),
                evaluations=NEWTON_STEPS * blocks * steps,
                seconds=seconds / 2,
            )
        )
    return paths[0], paths[1]


def _implicit_step(loop: ClosedLoop, h: float, weight: float) -> ca.Function:
    """Return the step in the kernel's form. Its accumulators are the extrema of the estimates and the largest residual."""
    import casadi as ca

    rows = loop.theta_hat_rows
    n = rows.stop - rows.start
    old, y = symbols("old", loop.size)
    new, z = symbols("new", loop.size)
    command, r = symbols("r", 1)
    lower, upper, least, greatest = (ca.SX.sym(name, n) for name in ("lower", "upper", "least", "greatest"))
    largest, nothing = ca.SX.sym("largest"), ca.SX(0, 1)
    defect = new - old - h * column(loop.derivative((1 - weight) * y + weight * z, r))
    newton = ca.Function("newton", [old, new, command], [new - ca.solve(ca.jacobian(defect, new), defect)], {"cse": True})
    guess = old
    for _ in range(NEWTON_STEPS):
        guess = newton(old, guess, command)
    residual = ca.norm_inf(ca.substitute(defect, new, guess)) / (1 + ca.norm_inf(old))
    theta_hat = ca.fmin(ca.fmax(guess[rows.start : rows.stop], lower), upper)
    following = ca.vertcat(guess[: rows.start], theta_hat, guess[rows.stop :])
    figures = ca.vertcat(ca.fmin(theta_hat, least), ca.fmax(theta_hat, greatest), ca.fmax(residual, largest))
    inputs = [old, ca.vertcat(least, greatest, largest), ca.vertcat(lower, upper), command, nothing, nothing]
    return ca.Function("step", inputs, [following, figures, nothing], {"cse": True})


def scipy_path(
    loop: ClosedLoop, problem: Problem, method: SciPyMethod, *, tolerance: float, t_end: float, evaluations: int
) -> SolverPath:
    """Run one of SciPy's solvers until t_end or the limit on evaluations. The absolute tolerance is a hundredth of the relative
    one."""
    import casadi as ca
    from scipy.integrate import BDF, LSODA, Radau

    started = time.process_time()
    state, t, slope = _right_hand_side(loop, problem)
    rates, jacobian = (
        Compiled(ca.Function("f", [state, t], [ca.densify(value)], {"cse": True})) for value in (slope, ca.jacobian(slope, state))
    )
    solver = {"BDF": BDF, "LSODA": LSODA, "Radau": Radau}[method](
        lambda t, y: rates(y, t),
        0.0,
        loop.initial(),
        t_end,
        jac=lambda t, y: jacobian(y, t),
        rtol=tolerance,
        atol=tolerance / 100,
    )
    instants, states = [0.0], [loop.initial()]
    while solver.status == "running" and solver.nfev < evaluations:
        with undisturbed():  # SciPy's Fortran would report an interrupt of the slope on the terminal
            for _ in range(STEPS_UNDISTURBED):
                if solver.status == "running" and solver.nfev < evaluations:
                    solver.step()
                    instants.append(solver.t)
                    states.append(solver.y)
    seconds = time.process_time() - started
    theta_hat = np.array(states)[:, loop.theta_hat_rows]
    return _path(np.array(instants), theta_hat, t_end, int(solver.nfev), seconds, lost=solver.status == "failed")


def cvodes(loop: ClosedLoop, problem: Problem, *, tolerance: float, t_end: float) -> SolverPath:
    """Run SUNDIALS' code for stiff problems, which uses backward differentiation formulas, with the exact Jacobian."""
    import casadi as ca

    started = time.process_time()
    state, t, slope = _right_hand_side(loop, problem)
    options = {"reltol": tolerance, "abstol": tolerance / 100, "max_num_steps": 10**9}
    instants = np.linspace(0, t_end, round(t_end / REPORT_STEP) + 1)
    solver = ca.integrator("solver", "cvodes", {"x": state, "t": t, "ode": slope}, 0.0, instants, options)
    with contextlib.redirect_stderr(io.StringIO()):  # failures are raised; this hides CVODES' own message
        states = np.array(solver(x0=loop.initial())["xf"])
    seconds = time.process_time() - started
    return _path(instants, states[loop.theta_hat_rows].T, t_end, int(solver.stats()["nfevals"]), seconds)


def _right_hand_side(loop: ClosedLoop, problem: Problem) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return the symbols of the state and of time, and the slope at the limited state."""
    import casadi as ca

    state_column, state = symbols("state", loop.size)
    command, r = symbols("r", 1)
    t = ca.SX.sym("t")
    assert isinstance(problem.reference, Sine)
    given = problem.reference
    reference = given.constant + given.amplitude * ca.sin(given.frequency * t + given.phase)
    return state_column, t, ca.substitute(column(loop.derivative(loop.limit(state), r)), command, reference)


def _path(t: Array, theta_hat: Array, t_end: float, evaluations: int, seconds: float, *, lost: bool = False) -> SolverPath:
    """Return the extrema over the windows from the points (K,), (K, n) of a solver."""
    windows = round(t_end / RINGING_WINDOW)
    place = np.minimum((t / RINGING_WINDOW * (1 + 1e-12)).astype(int), windows - 1)  # t_end is assigned to the last window
    filled, first = np.unique(place, return_index=True)
    least, greatest = np.full((2, windows, theta_hat.shape[1]), np.nan)
    least[filled], greatest[filled] = (extremum.reduceat(theta_hat, first) for extremum in (np.minimum, np.maximum))
    return SolverPath(
        least=least, greatest=greatest, final=theta_hat[-1], reached=float(t[-1]), lost=lost or not bool(np.abs(theta_hat).max() < DIVERGED_ESTIMATE),
        evaluations=evaluations, seconds=seconds,
    )  # fmt: skip
