"""Solvers for stiff problems beside RK4 and the converged solution: what each makes of the estimates' ringing, at any gain."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.papers.claim import Listing
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.numerics.stiff_methods import (
    RINGING_WINDOW,
    SciPyMethod,
    SolverPath,
    cvodes,
    implicit,
    scipy_path,
)
from barbalat.problem.known_set import ParameterBox
from barbalat.protocols import Controller
from barbalat.run.engine.simulate import simulate
from barbalat.run.kernel.grid import CHUNK_STEPS
from barbalat.solvers.simulation import Simulation

AGREEMENT_FACTOR = 1.25
"""Factor between the ringing of a run and the converged one; what is called wrong here is off by 2 to 2000."""
CASES = ("L1, no projection", "L1")


class StiffRow(NamedTuple):
    """One solver: its paths without projection and with it, and the time over which its ringing is taken."""

    name: str
    setting: str
    free: SolverPath
    boxed: SolverPath
    span: tuple[float, float]


@dataclass(frozen=True)
class StiffSetting:
    """L1-AC of Section V at one gain: how far it is run, and the step at which RK4 has converged.

    converged_step  [s]: h |lambda| is 0.14 and less, |lambda| near 700 sqrt(Gamma) at the crest of |x|
    span            [s]: the end of the run, over which the ringing is taken
    """

    gamma: float
    t_end: float
    converged_step: float
    span: tuple[float, float]

    @property
    def right(self) -> tuple[SolverPath, SolverPath]:
        """What the equations do, without projection and with it."""
        return rk4(self.gamma, self.converged_step, self.t_end)

    def explicit(self, h: float) -> StiffRow:
        """RK4 with the step h."""
        return StiffRow("RK4", self._setting(h), *rk4(self.gamma, h, self.t_end), self.span)

    def implicit(self, h: float, *, midpoint: bool) -> StiffRow:
        """The implicit midpoint rule, or Euler's implicit method, with the step h."""
        given = section_v.problem()
        assert isinstance(given.uncertainty, ParameterBox)
        loop = ClosedLoop.of(given, _controllers(self.gamma)[0])
        paths = implicit(loop, given, h, self.t_end, 0.5 if midpoint else 1.0, given.uncertainty)
        return StiffRow("implicit midpoint" if midpoint else "implicit Euler", self._setting(h), *paths, self.span)

    def automatic(self, budgets: dict[SciPyMethod, int], *, tolerance: float, t_end: float) -> list[StiffRow]:
        """The codes with automatic steps, with projection, judged by the last 0.1 s; SciPy's until their evaluations are spent."""
        given = section_v.problem()
        loop = ClosedLoop.of(given, _controllers(self.gamma)[1])
        paths = {"CVODES (BDF)": cvodes(loop, given, tolerance=tolerance, t_end=t_end)}
        for method, budget in budgets.items():
            found = scipy_path(loop, given, method, tolerance=tolerance, t_end=t_end, evaluations=budget)
            paths[f"{method} (SciPy)"] = found
        return [StiffRow(name, f"tolerance {tolerance:g}", path, path, (t_end - 0.1, t_end)) for name, path in paths.items()]

    def _setting(self, h: float) -> str:
        return f"h = {h:g} s"


def _controllers(gamma: float) -> list[Controller]:
    return [section_v.l1(name, gamma, projection=name == "L1") for name in CASES]


@cache
def rk4(gamma: float, h: float, t_end: float) -> tuple[SolverPath, SolverPath]:
    """L1-AC with RK4, without projection and with it."""
    started = time.process_time()
    windows, parts = round(t_end / RINGING_WINDOW), _parts(round(RINGING_WINDOW / h))
    simulation = Simulation(t_end=t_end, dt=h, record_points=windows * parts)
    runs = simulate(section_v.problem(), _controllers(gamma), simulation)
    seconds = (time.process_time() - started) / 2
    paths = []
    for run in (runs[name] for name in CASES):
        least, greatest = np.full((2, windows * parts, 2), np.nan)
        kept = len(run.envelope.theta_hat_min)
        least[:kept], greatest[:kept] = run.envelope.theta_hat_min, run.envelope.theta_hat_max
        reached = t_end if run.diverged_at is None else run.diverged_at
        paths.append(
            SolverPath(
                least=least.reshape(windows, parts, 2).min(axis=1),
                greatest=greatest.reshape(windows, parts, 2).max(axis=1),
                final=run.theta_hat[-1],
                reached=reached,
                lost=run.diverged_at is not None,
                evaluations=round(4 * reached / h),
                seconds=seconds,
            )
        )
    return paths[0], paths[1]


def _parts(steps: int) -> int:
    """Into how many equal parts a window of so many steps is cut, so that one part is no longer than a run's blocks."""
    return next(parts for parts in range(1, steps + 1) if steps % parts == 0 and steps // parts <= CHUNK_STEPS)


def ratio(path: SolverPath, right: SolverPath, span: tuple[float, float]) -> float:
    """Its ringing over the converged one's: of the estimate for which it is farther from one."""
    ratios = path.ringing(*span) / right.ringing(*span)
    return float(ratios[np.abs(np.log(np.maximum(ratios, 1e-9))).argmax()])


def agrees(path: SolverPath, right: SolverPath, span: tuple[float, float]) -> bool:
    """Whether it got there and rings as the converged solution does."""
    return (
        not path.lost
        and path.reached >= span[1] * (1 - 1e-9)
        and 1 / AGREEMENT_FACTOR < ratio(path, right, span) < AGREEMENT_FACTOR
    )


def rings_too_much(path: SolverPath, right: SolverPath, span: tuple[float, float]) -> bool:
    """Whether it got there and swings more than the converged solution does."""
    return not path.lost and path.reached >= span[1] * (1 - 1e-9) and ratio(path, right, span) >= AGREEMENT_FACTOR


def cell(row: StiffRow, which: int, right: tuple[SolverPath, SolverPath]) -> str:
    """The ratio and what it means, or why there is none."""
    path = (row.free, row.boxed)[which]
    if path.lost:
        return f"lost at {path.reached:.2g} s"
    if path.reached < row.span[1] * (1 - 1e-9):
        return f"not decided (spent at {path.reached:.2g} s)"
    value = ratio(path, right[which], row.span)
    word = "right" if agrees(path, right[which], row.span) else "too much" if value > 1 else "damped"
    return f"{value:.3g} ({word})"


def listing(rows: list[StiffRow], right: tuple[SolverPath, SolverPath], gamma: float) -> Listing:
    """All of them, with their cost."""
    return Listing(
        f"Solvers on L1-AC of Section V, Gamma = {gamma:g}: ringing of the estimates over the converged solution's, evaluations of the right-hand side (Newton "
        "steps of the implicit ones) per simulated second without projection, and the seconds of one core of this computer",
        ("solver", "step or tolerance", "until [s]", "without projection", "with projection", "evaluations per s", "core s"),
        tuple(
            (
                row.name, row.setting, f"{row.free.reached:.3g}", cell(row, 0, right), cell(row, 1, right),
                f"{row.free.evaluations / row.free.reached:.2g}", f"{row.free.seconds:.2g}",
            )
            for row in rows
        ),
    )  # fmt: skip
