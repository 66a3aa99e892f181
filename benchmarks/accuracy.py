"""Work and precision: the cost of a run of two seconds on one core against its measured error.

The runs are the ones of Section V under its command. The error is the largest difference of theta_hat from the kernel's at a
tolerance of 1e-12, at four instants, relative to the largest estimate. Times are the processor time of a run, the best of
several, without compilation and without metrics. With fixed steps they include the table of the command.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from barbalat import L1Adaptive, Mrac, RobustMrac, Simulation, input_filter
from barbalat.laws import LeastSquares
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.protocols import Controller
from barbalat.run.engine.motion import Motion
from barbalat.run.kernel.grid import signal_table
from barbalat.run.kernel.step import step_program
from barbalat.solvers import RK4, Tableau
from barbalat.solvers.order_eight import order_eight
from benchmarks.loops import PROBLEM
from benchmarks.table import Row

T_END, INSTANTS = 2.0, 4
REFERENCE = 1e-12
"""Tolerance of the run from which the errors are measured."""
ASKED = (1e-3, 1e-5, 1e-7, 1e-9)
"""Errors for which the table lists the cost, interpolated between two runs."""
OURS, DENSE = "tolerance", "with dense output, as for figures"
FEWEST = {"l1": 1250, "mrac": 50, "robust_mrac": 50}
"""Steps in a quarter of the coarsest RK4 run that follows the motion, by the scheme's file."""


@dataclass(frozen=True)
class Point:
    """The relative error of a run and its processor time [s]."""

    error: float
    seconds: float


Run = Callable[[], np.ndarray]
"""A function that makes a run and returns the states (INSTANTS, S) at the ends of its quarters."""


def controllers() -> list[Controller]:
    """The paper's three schemes on Section V."""
    return [
        L1Adaptive(gamma=1e4, filter=input_filter(0.02), name="L1, gamma = 1e4"),
        Mrac(gamma=1.0, name="MRAC"),
        RobustMrac(c_0=[1.0, 1.0], tau=0.5, law=LeastSquares(covariance0=500.0), name="Robust MRAC"),
    ]


def fixed(loop: ClosedLoop, solver: Tableau, steps: int) -> Run:
    """A run of the package's optimised kernel with fixed steps."""
    simulation = Simulation(T_END, T_END / steps, solver=solver)
    program = step_program(loop, solver, simulation.dt, figures=False)
    kernel = program.compile(1)
    quarter, out = steps // INSTANTS, np.empty((1, program.shape.states + program.shape.accumulators))

    def run() -> np.ndarray:
        state, found = loop.initial().copy(), []
        for i in range(INSTANTS):
            done = 0
            while done < quarter:
                count = min(quarter - done, 32_768)
                table = signal_table(PROBLEM.signals, simulation, i * quarter + done, count)
                kernel(1, count, state, np.empty(0), table, out, start=i * quarter + done)
                done += count
            found.append(state.copy())
        return np.array(found)

    return run


def by_tolerance(loop: ClosedLoop, tolerance: float, *, dense: bool = False) -> Run:
    """A run with steps that the package's kernel chooses. With ``dense`` it has dense output, as a run with metrics has."""
    simulation = Simulation(T_END, tolerance=tolerance)
    made = Motion.of(loop, PROBLEM.signals, simulation, tolerance)
    if not dense:
        made = made.sparse()
    made.code.for_steps(1e9)  # optimised code
    instants = np.linspace(0.0, T_END, INSTANTS + 1)
    quarters = [made.pieces.rows(instants[i : i + 2]) for i in range(INSTANTS)]

    def run() -> np.ndarray:
        motion, found = made.again(tolerance, T_END), []
        for rows in quarters:
            motion = motion.along(rows)
            while not motion.over:
                motion.further()
            found.append(motion.x.copy())
        return np.array(found)

    return run


def points(
    run_of: Callable[[float], Run], settings: tuple[float, ...], exact: np.ndarray, rows: slice, repeats: int
) -> list[Point]:
    """A point for each setting, which is a tolerance or a number of steps. Runs that diverge are left out."""
    found = []
    scale = np.abs(exact[:, rows]).max()
    for setting in settings:
        run = run_of(setting)
        error = float(np.abs(run()[:, rows] - exact[:, rows]).max() / scale)
        if np.isfinite(error):
            found.append(Point(error, min(_seconds(run) for _ in range(repeats))))
    return found


def _seconds(run: Run) -> float:
    start = time.process_time()
    run()
    return time.process_time() - start


def cost_at(found: list[Point], error: float) -> float | None:
    """Seconds at an error, interpolated on a logarithmic scale between the two nearest runs. None if no run is so accurate."""
    better = [point for point in found if point.error <= error]
    if not better:
        return None
    last = min(better, key=lambda point: point.seconds)
    before = [point for point in found if point.error > error and point.seconds < last.seconds]
    if not before:
        return last.seconds
    first = min(before, key=lambda point: point.error)
    share = np.log(first.error / error) / np.log(first.error / max(last.error, 1e-300))
    return float(first.seconds * (last.seconds / first.seconds) ** share)


def contestants(loop: ClosedLoop, *, quick: bool, peers: bool) -> Iterator[tuple[str, Callable[[float], Run], tuple[float, ...]]]:
    """The name of each contestant, its function for a run with one setting, and the settings."""
    fewest = FEWEST[loop.equations.__class__.__module__.rsplit(".", 1)[-1]]
    counts = tuple(4.0 * round(fewest * 2 ** (i / (1 if quick else 2))) for i in range(7 if quick else 13))
    tolerances = tuple(10.0 ** -(i / (1 if quick else 2)) for i in range(3 if quick else 6, 12 if quick else 23))
    yield "RK4, fixed", lambda steps: fixed(loop, RK4, int(steps)), counts
    yield "DOP853, fixed", lambda steps: fixed(loop, order_eight(), int(steps)), tuple(c / 4 // 4 * 4 for c in counts)
    yield OURS, lambda tolerance: by_tolerance(loop, tolerance), tolerances
    yield DENSE, lambda tolerance: by_tolerance(loop, tolerance, dense=True), tolerances
    if peers:
        from benchmarks.peers import heyoka_taylor

        yield "heyoka", lambda tolerance: heyoka_taylor.run_of(loop, tolerance), tolerances


def section(controller: Controller, *, quick: bool, peers: bool) -> tuple[str, list[Row], list[str]]:
    """The table of a scheme with the milliseconds at each error. "Ours" are runs with a tolerance."""
    loop = ClosedLoop.of(PROBLEM, controller)
    exact = by_tolerance(loop, REFERENCE)()
    found = {
        name: points(run_of, settings, exact, loop.theta_hat_rows, 2 if quick else 7)
        for name, run_of, settings in contestants(loop, quick=quick, peers=peers)
    }
    ours = found.pop(OURS)
    rows = [row for name, theirs in found.items() for error in ASKED if (row := _row(name, error, ours, theirs)) is not None]
    return f"{controller.name}: milliseconds for {T_END:g} s at a measured error of the estimates", rows, []


def _row(name: str, error: float, ours: list[Point], theirs: list[Point]) -> Row | None:
    """A row of the table, or None if either contestant never reaches the accuracy."""
    mine, other = cost_at(ours, error), cost_at(theirs, error)
    if mine is None or other is None:
        return None
    target = None if name == DENSE else 1.0
    return Row(f"{name}, error {error:.0e}", f"{1e3 * mine:.3g} ms", f"{1e3 * other:.3g} ms", other / mine, at_least=target)
