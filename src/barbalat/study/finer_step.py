"""Repeats the reported runs of a study with a quarter of the step or 1/32 of the tolerance, to check whether they depend on it.

The reported loops are also simulated without any delay.

A study judges thousands of runs by their metrics only. The few reported runs are examined here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from barbalat.judge.settings import Judge
from barbalat.judge.verdict import Verdict
from barbalat.problem.modelling_error import GainError
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.engine.by_tolerance import FINER
from barbalat.run.engine.simulate import simulate
from barbalat.run.results.step_comparison import EQUAL_FIGURES_SHARE, NOT_REPEATED
from barbalat.solvers.simulation import LEAST_TOLERANCE, Simulation
from barbalat.study.delay_margin import LARGEST_GAIN_ERROR, DelayMargins, gains_scanned, longest_delay
from barbalat.study.ideal_benchmark import SHORTEST_DELAY_STEPS, SIZES_TRIED, Ideals, JudgedRuns, Judging, Undelayed, quiet
from barbalat.study.verdicts import Member, verdict_of
from barbalat.validate import Array

FINER_BY = 4
"""The factor by which the step is reduced: the error of RK4 falls to 1/256, that of Euler's method to a quarter."""
BESIDE_SHARE = 0.1
"""The finer step is checked at this relative distance to either side of the delay that was found; the search stops within 2 %."""


def refined(simulation: Simulation) -> Simulation:
    """A simulation with a step that is FINER_BY times smaller, or with the tolerance used to measure errors; sample times are
    kept."""
    if simulation.tolerance is not None:
        return replace(simulation, tolerance=max(FINER * simulation.tolerance, LEAST_TOLERANCE))
    return replace(simulation, dt=simulation.dt / FINER_BY)


def finer(simulation: Simulation) -> str:
    """A short phrase for the effect of ``refined``."""
    return f"a step {FINER_BY} times smaller" if simulation.tolerance is None else f"1/{1 / FINER:.0f} of the tolerance"


@dataclass(frozen=True, kw_only=True)
class PlainRun:
    """A reported loop on the case's plant, without noise and without a modelling error.

    h_lambda_max  the largest step times |eigenvalue| along the run; ``limits`` are the solver's limits on the imaginary and the
                  real axis. None with a tolerance
    radius_max    for a law sampled by Euler steps, the largest spectral radius of its map from sample to sample; otherwise None
    label         *outside the region of stability from ...*, or None
    damping       a sentence if numerical damping may hide an oscillation, or None
    verdict       the judge's
    settles       whether a step that is FINER_BY times smaller stays inside the solver's region of stability; if it does not, it
                  settles nothing
    """

    h_lambda_max: float | None
    limits: tuple[float, float] | None
    label: str | None
    damping: str | None
    verdict: Verdict
    settles: bool
    radius_max: float | None = None

    @classmethod
    def of(cls, problem: TrackingProblem, controller: Controller, simulation: Simulation, judge: Judge | None = None) -> PlainRun:
        """Simulate the loop and examine the run."""
        if simulation.tolerance is not None:
            verdict = verdict_of(quiet(problem), controller, simulation, judge or Judge())
            return cls(h_lambda_max=None, limits=None, label=None, damping=None, verdict=verdict, settles=True)
        (run,) = simulate(quiet(problem), [controller], simulation, judge=judge).values()
        solver, settles = simulation.solver, True
        if run.label is not None:
            (fine,) = simulate(quiet(problem), [controller], refined(simulation)).values()
            settles = fine.label is None
        assert run.verdict is not None
        return cls(
            settles=settles,
            h_lambda_max=run.stiffness.h_lambda_max,
            radius_max=run.stiffness.radius_max,
            limits=(solver.imaginary_limit, solver.real_limit),
            label=run.label,
            damping=None if run.damping is None else run.damping.sentence,
            verdict=run.verdict,
        )

    @property
    def sentences(self) -> list[str]:
        """The findings about the run, as sentences."""
        said = []
        is_ = "" if self.label is None or self.label.startswith("diverges") else "is "
        if self.label is not None and self._of_the_law:
            said.append(
                f"the run without a delay {is_}{self.label.removesuffix(NOT_REPEATED)}: the law takes one Euler step in each "
                f"sample time, which amplifies modes that its equations do not (spectral radius from sample to sample up to "
                f"{self.radius_max:.4g}). An oscillation may be due to the sample time, which a smaller simulation.dt does not "
                f"change"
            )
        elif self.label is not None and self.limits is not None:
            imaginary, real = self.limits
            said.append(
                f"the run without a delay {is_}{self.label}: h |lambda| reaches {self.h_lambda_max:.3g}, and the solver's limit "
                f"is {imaginary:.3g} on the imaginary axis and {real:.3g} on the real one, so an oscillation may be due to the "
                f"solver"
                f"{'' if self.settles else f'. A step {FINER_BY} times smaller leaves the region too and settles nothing'}"
            )
        return [*said, *filter(None, (self.damping,))]

    @property
    def _of_the_law(self) -> bool:
        """Whether the law's own Euler steps, and not the solver's, leave the region: the solver's are within both its limits."""
        if self.radius_max is None or self.limits is None or self.h_lambda_max is None:
            return False
        return self.radius_max > 1 and self.h_lambda_max < min(self.limits)

    def as_json(self) -> dict[str, Any]:
        return {
            "h_lambda_max": self.h_lambda_max,
            "limits": None if self.limits is None else list(self.limits),
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
"""The text for a finer step that disagrees, by criterion and by the side of the delay that was found."""


@dataclass(frozen=True)
class Confirmed:
    """How many checks with a finer step were made for the size (``what``) that a member tolerates, and which disagreed."""

    what: str
    simulation: Simulation
    asked: int
    changes: tuple[str, ...]

    @property
    def sentence(self) -> str | None:
        """The finding as a sentence; None if nothing was checked."""
        if self.changes:
            decides = "step" if self.simulation.tolerance is None else "tolerance"
            said = "; ".join(self.changes)
            return f"the {decides} decides the simulated {self.what}: {said}. Make {self.simulation.refined_by} smaller"
        if not self.asked:
            return None
        simulation = self.simulation
        again = f"a step of {simulation.dt:g} s" if simulation.tolerance is None else simulation.step
        return f"{again} gives the same verdicts 10 % above and below the simulated {self.what}"


def delays_confirmed(
    members: Sequence[Member],
    simulation: Simulation,
    found: DelayMargins,
    *,
    numbers: Array,
    longest: float | None = None,
    by: Judging | None = None,
) -> list[Confirmed]:
    """Whether a finer step confirms the delays ``found`` for each of M members.

    A slightly smaller delay must be tolerated with the finer step too, and a slightly larger one must not; a loop that oscillates
    without a delay must also oscillate with the finer step. Delays that are too short to be simulated, or longer than the longest
    delay of the search, are not checked.
    """
    longest = longest_delay(simulation) if longest is None else longest
    asking = _Asking("delays", SHORTEST_DELAY_STEPS * simulation.resolution, longest, lambda size: f"{size:.3g} s")
    beside = _either_side(found)
    fine = refined(simulation)
    ideals = Ideals(fine, beside) if 0 < len(beside) <= SIZES_TRIED else Ideals.over(fine, longest)
    return _confirmed(members, found, ideals, asking, numbers, by or Judging())


def gains_confirmed(
    members: Sequence[Member], simulation: Simulation, found: DelayMargins, error: GainError, *, numbers: Array, by: Judging
) -> list[Confirmed]:
    """Whether a finer step confirms the tolerated factors on the input's effectiveness, upwards or downwards, up to the largest
    tried factor."""
    asking = _Asking("gains", 0.0, LARGEST_GAIN_ERROR, lambda size: f"a gain of {error.factor(size):.3g}")
    beside = _either_side(found)
    ideals = Ideals(refined(simulation), beside if len(beside) else gains_scanned(), error)
    return _confirmed(members, found, ideals, asking, numbers, by)


@dataclass(frozen=True)
class _Asking:
    """What is checked: the modelling errors whose sizes can be simulated, and the text for a size."""

    what: str
    least: float
    most: float
    said: Callable[[float], str]


def _either_side(found: DelayMargins) -> Array:
    """The sizes on either side of the sizes that were found."""
    both = np.concatenate([found.onset.tolerates, found.loss.tolerates])
    return np.unique(np.outer([1 - BESIDE_SHARE, 1 + BESIDE_SHARE], both[both > 0]))


def _confirmed(
    members: Sequence[Member],
    found: DelayMargins,
    ideals: Ideals,
    asking: _Asking,
    numbers: Array,
    by: Judging,
) -> list[Confirmed]:
    fine, changes = ideals.simulation, [list[str]() for _ in members]
    undelayed = Undelayed.run(members, fine, by.judge, numbers)
    judged = JudgedRuns(members, fine, undelayed, numbers, ideals, by)
    count = found.oscillates.astype(int)
    for i in np.flatnonzero(found.oscillates & ~judged.oscillates):
        changes[i].append(f"at {fine.step} it does not oscillate without a delay")
    for c, tolerates in enumerate((found.onset.tolerates, found.loss.tolerates)):
        for sign in (-1, 1):
            size = (1 + sign * BESIDE_SHARE) * tolerates
            which = np.flatnonzero((size > 0) & (size >= asking.least) & (size <= asking.most))
            count[which] += 1
            lost = judged.lost(which, size[which])[c]
            for i in which[lost if sign < 0 else ~lost]:
                changes[i].append(f"at {fine.step} it {VERDICTS[c, sign]} with {asking.said(size[i])}")
    return [Confirmed(asking.what, fine, int(n), tuple(said)) for n, said in zip(count, changes, strict=True)]


def different(coarse: float, fine: float) -> bool:
    """Whether a metric differs at the finer step; an infinite value, from a lost run, differs from all others."""
    if coarse == fine:
        return False
    return not np.isfinite(fine - coarse) or abs(fine - coarse) > EQUAL_FIGURES_SHARE * max(abs(fine), abs(coarse))
