"""Compares solvers for stiff problems with RK4 and the converged solution, by the ringing of the estimates at any gain."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
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
"""A run agrees with the converged solution if the ratio of their ringing is within this factor."""
RINGING_START, RINGING_END = 0.5, 6.4
"""Interval [s] over which the ringing is compared. The equations ring from the start until an estimate reaches its bound at
6.5 s. With projection they only drift later."""
CASES = ("L1, no projection", "L1")


class StiffRow(NamedTuple):
    """One solver: its paths with and without projection, and the time over which its ringing is measured."""

    name: str
    setting: str
    free: SolverPath
    boxed: SolverPath
    span: tuple[float, float]


@dataclass(frozen=True)
class StiffSetting:
    """L1-AC of Section V at one gain: its horizon, and the step at which RK4 has converged.

    converged_step  a step [s] with h |lambda| of at most 0.14; |lambda| is near 700 sqrt(Gamma) at the crest of |x|
    """

    gamma: float
    t_end: float
    converged_step: float

    @property
    def span(self) -> tuple[float, float]:
        """The time over which the ringing is measured [s]."""
        return _span(self.t_end)

    @property
    def right(self) -> tuple[SolverPath, SolverPath]:
        """The behaviour of the equations, without and with projection."""
        return rk4(self.gamma, self.converged_step, self.t_end)

    def explicit(self, h: float) -> StiffRow:
        """Run RK4 with the step h."""
        return StiffRow("RK4", self._setting(h), *rk4(self.gamma, h, self.t_end), self.span)

    def implicit(self, h: float, *, midpoint: bool) -> StiffRow:
        """Run the implicit midpoint rule, or Euler's implicit method, with the step h."""
        given = section_v.problem()
        assert isinstance(given.uncertainty, ParameterBox)
        loop = ClosedLoop.of(given, _controllers(self.gamma)[0])
        paths = implicit(loop, given, h, self.t_end, 0.5 if midpoint else 1.0, given.uncertainty)
        return StiffRow("implicit midpoint" if midpoint else "implicit Euler", self._setting(h), *paths, self.span)

    def automatic(self, budgets: dict[SciPyMethod, int], *, tolerance: float, t_end: float) -> list[StiffRow]:
        """Run the variable-step codes, with projection. SciPy's codes stop when their evaluations are used up."""
        given = section_v.problem()
        loop = ClosedLoop.of(given, _controllers(self.gamma)[1])
        paths = {"CVODES (BDF)": cvodes(loop, given, tolerance=tolerance, t_end=t_end)}
        for method, budget in budgets.items():
            found = scipy_path(loop, given, method, tolerance=tolerance, t_end=t_end, evaluations=budget)
            paths[f"{method} (SciPy)"] = found
        return [StiffRow(name, f"tolerance {tolerance:g}", path, path, _span(t_end)) for name, path in paths.items()]

    def _setting(self, h: float) -> str:
        return f"h = {h:g} s"


def _span(t_end: float) -> tuple[float, float]:
    return RINGING_START, min(t_end, RINGING_END)


def _controllers(gamma: float) -> list[Controller]:
    return [section_v.l1(name, gamma, projection=name == "L1") for name in CASES]


@cache
def rk4(gamma: float, h: float, t_end: float) -> tuple[SolverPath, SolverPath]:
    """Run L1-AC with RK4, without and with projection."""
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
    """Return the number of equal parts into which a window of this many steps is divided, so no part is longer than a run's
    blocks."""
    return next(parts for parts in range(1, steps + 1) if steps % parts == 0 and steps // parts <= CHUNK_STEPS)


def ratios(path: SolverPath, right: SolverPath, span: tuple[float, float]) -> tuple[float, float]:
    """Return the smallest and the largest ratio of a path's ringing to the ringing of the converged path, over all seconds of the
    span and all estimates."""
    seconds = np.append(np.arange(span[0], span[1] - 0.5, 1.0), span[1])  # the last part includes the remainder
    found = [path.ringing(*ends) / right.ringing(*ends) for ends in pairwise(seconds)]
    return float(np.nanmin(found)), float(np.nanmax(found))


def arrived(path: SolverPath, span: tuple[float, float]) -> bool:
    """Whether the path reached the end of the span."""
    return not path.lost and path.reached >= span[1] * (1 - 1e-9)


def agrees(path: SolverPath, right: SolverPath, span: tuple[float, float]) -> bool:
    """Whether the path reached the end and rings like the converged solution in every second."""
    if not arrived(path, span):
        return False
    least, largest = ratios(path, right, span)
    return least > 1 / AGREEMENT_FACTOR and largest < AGREEMENT_FACTOR


def rings_too_much(path: SolverPath, right: SolverPath, span: tuple[float, float]) -> bool:
    """Whether the path reached the end and rings more than the converged solution in some second."""
    return arrived(path, span) and ratios(path, right, span)[1] >= AGREEMENT_FACTOR


def cell(row: StiffRow, which: int, right: tuple[SolverPath, SolverPath]) -> str:
    """Return the ratios and their meaning, or the reason why there are none."""
    path = (row.free, row.boxed)[which]
    if path.lost:
        return f"lost at {path.reached:.2g} s"
    if not arrived(path, row.span):
        return f"not decided (budget spent at {path.reached:.2g} s)"
    least, largest = ratios(path, right[which], row.span)
    word = "too much" if largest >= AGREEMENT_FACTOR else "right" if agrees(path, right[which], row.span) else "damped"
    return f"{least:.2g} to {largest:.3g} ({word})"


def listing(rows: list[StiffRow], right: tuple[SolverPath, SolverPath], gamma: float) -> Listing:
    """Return the table of all solvers with their cost."""
    return Listing(
        f"Solvers on L1-AC of Section V, Gamma = {gamma:g}. Columns 4 and 5: ringing of the estimates relative to the converged "
        f"solution, smallest and largest in any second. Evaluations of the right-hand side (Newton steps of implicit solvers) "
        f"are per simulated second without projection. Core s: seconds of one core of this computer",
        ("solver", "step or tolerance", "until [s]", "without projection", "with projection", "evaluations per s", "core s"),
        tuple(
            (
                row.name, row.setting, f"{row.free.reached:.3g}", cell(row, 0, right), cell(row, 1, right),
                f"{row.free.evaluations / row.free.reached:.2g}", f"{row.free.seconds:.2g}",
            )
            for row in rows
        ),
    )  # fmt: skip
