"""Is it the solver's? What a study reports, once more at a quarter of its step; and what the reported loops do without any delay.

A study judges thousands of runs by their figures alone. Those few that it reports are looked at closely here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from barbalat.judge.settings import Judge
from barbalat.judge.verdict import Verdict
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.engine.simulate import simulate
from barbalat.run.results.step_comparison import EQUAL_FIGURES_SHARE
from barbalat.solvers.simulation import Simulation
from barbalat.study.delay_margin import LONGEST_DELAY, DelayMargins
from barbalat.study.ideal_benchmark import SHORTEST_DELAY_STEPS, SIZES_TRIED, Ideals, JudgedRuns, Judging, Undelayed, quiet
from barbalat.study.verdicts import Member
from barbalat.validate import Array

FINER_BY = 4
"""The step is this many times smaller: the error of RK4 falls to 1/256, that of Euler's method to a quarter."""
BESIDE_SHARE = 0.1
"""To either side of a delay that was found, where the finer step is asked: the search itself stops within 2 %."""


def refined(simulation: Simulation) -> Simulation:
    """A simulation with a step that is FINER_BY times smaller; what is sampled keeps its sample time."""
    return replace(simulation, dt=simulation.dt / FINER_BY)


@dataclass(frozen=True, kw_only=True)
class PlainRun:
    """One reported loop on the case's own plant, without noise and without a modelling error.

    h_lambda_max  the largest step times |eigenvalue| along it, and ``limits`` the solver's on the imaginary and the real axis
    label         *outside the region of stability from ...*, or None
    damping       what the solver's own damping may hide, as a sentence, or None
    verdict       the judge's
    settles       whether a step that is FINER_BY times smaller stays inside the solver's region of stability; only then does what
                  it says count
    """

    h_lambda_max: float
    limits: tuple[float, float]
    label: str | None
    damping: str | None
    verdict: Verdict
    settles: bool

    @classmethod
    def of(cls, problem: TrackingProblem, controller: Controller, simulation: Simulation, judge: Judge | None = None) -> PlainRun:
        """Simulate it and look."""
        (run,) = simulate(quiet(problem), [controller], simulation, judge=judge).values()
        solver, settles = simulation.solver, True
        if run.label is not None:
            (fine,) = simulate(quiet(problem), [controller], refined(simulation)).values()
            settles = fine.label is None
        assert run.verdict is not None
        return cls(
            settles=settles,
            h_lambda_max=run.stiffness.h_lambda_max,
            limits=(solver.imaginary_limit, solver.real_limit),
            label=run.label,
            damping=None if run.damping is None else run.damping.sentence,
            verdict=run.verdict,
        )

    @property
    def sentences(self) -> list[str]:
        """What of it deserves a second look."""
        said = []
        if self.label is not None:
            imaginary, real = self.limits
            said.append(
                f"the run without a delay is {self.label}: h |lambda| reaches {self.h_lambda_max:.3g}, and the solver's limit is "
                f"{imaginary:.3g} on the imaginary axis and {real:.3g} on the real one; what oscillates may be the solver"
                f"{'' if self.settles else f'. A step {FINER_BY} times smaller leaves the region too and settles nothing'}"
            )
        return [*said, *filter(None, (self.damping,))]

    def as_json(self) -> dict[str, Any]:
        return {
            "h_lambda_max": self.h_lambda_max,
            "limits": list(self.limits),
            "label": self.label,
            "settles": self.settles,
            "verdict": self.verdict.as_json(),
        }


VERDICTS = {
    (0, -1): "oscillates already",
    (0, 1): "does not oscillate yet",
    (1, -1): "is lost already",
    (1, 1): "is not lost yet",
}
"""By the criterion and the side of the delay that was found, what the finer step says where it disagrees."""


@dataclass(frozen=True)
class Confirmed:
    """What a finer step says of the delays that one member tolerates: how much was asked, and what came out otherwise."""

    dt: float
    asked: int
    changes: tuple[str, ...]

    @property
    def sentence(self) -> str | None:
        """The finding as a sentence; None where nothing was asked."""
        if self.changes:
            return f"the step decides the simulated delays: {'; '.join(self.changes)}. Make simulation.dt smaller"
        if not self.asked:
            return None
        return f"a step of {self.dt:g} s gives the same verdicts a tenth to either side of the simulated delays"


def delays_confirmed(
    members: Sequence[Member],
    simulation: Simulation,
    found: DelayMargins,
    *,
    numbers: Array,
    longest: float = LONGEST_DELAY,
    by: Judging | None = None,
    threads: int | None = None,
) -> list[Confirmed]:
    """Whether a finer step confirms the delays ``found`` for each of M members.

    Where a little less is tolerated at the finer step too, and a little more is not; where it oscillates without a
    delay, whether it does there too. Nothing is asked of delays that are too short to be simulated or longer than the longest.
    """
    fine, changes = refined(simulation), [list[str]() for _ in members]
    both = found.onset.bears, found.loss.bears
    asked = [(c, sign, (1 + sign * BESIDE_SHARE) * both[c]) for c in (0, 1) for sign in (-1, 1)]
    sizes = np.unique(np.concatenate([size[size > 0] for _, _, size in asked]))
    ideals = Ideals(fine, sizes) if 0 < len(sizes) <= SIZES_TRIED else Ideals.over(fine, longest)
    by = by or Judging()
    undelayed = Undelayed.run(members, fine, by.judge, numbers, threads)
    judged = JudgedRuns(members, fine, undelayed, numbers, ideals, by, threads)
    count = found.oscillates.astype(int)
    for i in np.flatnonzero(found.oscillates & ~judged.oscillates):
        changes[i].append(f"at h = {fine.dt:g} s it does not oscillate without a delay")
    shortest = SHORTEST_DELAY_STEPS * simulation.dt
    for c, sign, size in asked:
        which = np.flatnonzero((size >= shortest) & (size <= longest))
        count[which] += 1
        lost = judged.lost(which, size[which])[c]
        for i in which[lost if sign < 0 else ~lost]:
            changes[i].append(f"at h = {fine.dt:g} s it {VERDICTS[c, sign]} with {size[i]:.3g} s")
    return [Confirmed(fine.dt, int(n), tuple(said)) for n, said in zip(count, changes, strict=True)]


def different(coarse: float, fine: float) -> bool:
    """Whether a figure is another one at the finer step."""
    return not abs(fine - coarse) <= EQUAL_FIGURES_SHARE * max(abs(fine), abs(coarse))
