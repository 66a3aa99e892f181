"""Separates plant and solver: members are repeated with a finer step if their step may damp or excite oscillations that it does
not resolve.

The metrics and verdict of such a member are those with the finer step.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from barbalat.budget import Progress, part_of
from barbalat.cases.build import Case
from barbalat.open_numbers.path import FieldPath
from barbalat.open_numbers.varied import Varied
from barbalat.run.engine.by_tolerance import FINER
from barbalat.run.engine.refining import Refining
from barbalat.run.kernel import delay
from barbalat.solvers.simulation import LEAST_TOLERANCE
from barbalat.sweeps.chunks import Columns
from barbalat.sweeps.study import FINER_BY, RINGS, SETTLED, VERDICT, Figured, Study, StudyPart, run_here
from barbalat.validate import Array, InputError

PILOTS = 32
"""Number of a plan's members from which the affordable steps are determined."""
RERUN_COST = 4.6
"""Processor time of an evaluation in runs with finer steps, relative to one of the plain sweep. It includes the judge, the search
for limit cycles and the audit. Measured on studies in which most members are suspect; the search for limit cycles takes more than
half of this time."""
MOST_RERUN = 9.0 / RERUN_COST
"""Largest total number of evaluations of runs with finer steps, as a multiple of those of the plain sweep; together they take ten
times as long as the plain sweep."""
ALWAYS_RERUN = 3 * 10**8
"""Number of solver steps that these runs may always take, even in a small sweep: about ten seconds of one core."""

GOLDEN = (5**0.5 - 1) / 2
"""The multiples of this number modulo 1 are evenly distributed in [0, 1), so any sequence of member numbers is sampled evenly."""

Work = Generator[list[StudyPart], list[list[Figured]], Columns]
"""Yields parts to be run anywhere, receives their metrics, and returns columns."""


class Step(NamedTuple):
    """The factor by which a step is smaller, and whether it uses the method that resolves more (see ``Refining``) or the method
    of the case."""

    factor: int
    refined: bool


class Afforded(NamedTuple):
    """Which members are repeated: all that need a factor of at most ``finest``, and a fraction of those that need a factor of up
    to ``beyond``."""

    finest: float
    beyond: float = 0.0
    share: float = 0.0

    def __str__(self) -> str:
        return str(self.finest) + (f" and {self.share:.17g} up to {self.beyond:g}" if self.share else "")

    def admits(self, numbers: Array, factor: float) -> Array:
        """(K,) whether the members with these numbers are repeated with a step smaller by ``factor``. This depends only on the
        numbers."""
        if factor <= self.finest or factor > self.beyond:
            return np.full(len(numbers), factor <= self.finest)
        return np.asarray((numbers * GOLDEN) % 1.0 < self.share)


@dataclass(frozen=True, eq=False)
class Finer(Varied):
    """The cases of a study with a different step. A sampled controller keeps its sample time, and a sampled law keeps its steps.

    With a tolerance, the finer tolerance is the one that measures the error of runs, whatever the step.
    """

    varied: Varied
    step: Step

    @property
    def paths(self) -> tuple[FieldPath, ...]:  # type: ignore[override]
        """The paths of the refined settings."""
        return self.varied.paths

    @property
    def source(self) -> str:
        return self.varied.source

    def at(self, values: Sequence[float] | Array) -> Case:
        case = self.varied.at(values)
        own = case.simulation
        if own.tolerance is not None:
            return replace(case, simulation=replace(own, tolerance=max(FINER * own.tolerance, LEAST_TOLERANCE)))
        solver = Refining.of(own.solver, delayed=case.problem.delay > 0).solver if self.step.refined else own.solver
        return replace(case, simulation=replace(own, dt=own.dt / self.step.factor, solver=solver))


@dataclass(frozen=True, eq=False)
class Rerun:
    """Members with one controller and a different step: ``places`` are their indices among those requested, and ``part`` contains
    the members to run."""

    controller: int
    places: Array
    part: StudyPart
    study: Study


@dataclass(eq=False)
class Settling:
    """A study that, if it ``settles``, repeats members whose result is not settled by their step.

    kernels  approximate numbers of kernels of the members that ran last, with the original step and with finer steps
    """

    study: Study
    settles: bool = True
    _finer: dict[Step, Study] = field(init=False, default_factory=dict)
    _expected: float | None = field(init=False, default=None)
    kernels: int = field(init=False, default=1)

    def finer(self, step: Step) -> Study:
        """This study with a different step."""
        if step not in self._finer:
            self._finer[step] = Study(Finer(self.study.varied, step), self.study.plan, motions=self.study.motions)
        return self._finer[step]

    def work(self, numbers: Array) -> Work:
        """All columns of the members with these numbers, (K,); raises InputError, with the number of the member, if a member
        gives no valid case."""
        parts = list(self.study.parts_for(numbers))
        found = self.study.columns_for(numbers, parts, (yield parts))
        reruns = list(self._reruns(found)) if self.settles else []
        self._expected = sum(one.part.work for one in reruns) / max(sum(one.work for one in parts), 1)
        self.kernels = 1 + len({one.study for one in reruns})
        if reruns:
            figures = yield [one.part for one in reruns]
            for one, (fine,) in zip(reruns, figures, strict=True):
                self._settle(found, one, fine)
        return found

    def run(self, numbers: Array, *, threads: int | None = None, progress: Progress | None = None) -> Columns:
        """Do the work of these members in threads of this process. ``progress`` expects as many repetitions as for earlier
        members."""
        own = 1 / (1 + (1.0 if self._expected is None else self._expected))
        shares = part_of(progress, 0.0, own), part_of(progress, own, 1 - own)
        return done_here(self.work(numbers), threads=threads, progress=shares)

    def _reruns(self, found: Columns) -> Iterator[Rerun]:
        for i, controller in enumerate(self.study.controllers):
            needed = found[f"{controller}/{FINER_BY}"]
            for factor in np.unique(needed[np.isfinite(needed) & (needed > 0)]):
                places = np.flatnonzero((needed == factor) & self.afforded.admits(found["member"], factor))
                if len(places):
                    yield from self.again(found["member"], places, i, Step(int(factor), refined=True))

    def again(self, numbers: Array, places: Array, controller: int, step: Step) -> Iterator[Rerun]:
        """These members with a different step, except those for which this step is rejected or costs too much.

        A varied delay may be a whole number of the finer steps at every tried value: its weights then appear to be constant. Such
        members stay unsettled, whichever other members run with them.
        """
        study = self.finer(step)
        try:
            parts = [replace(one, members=one.members[controller : controller + 1]) for one in study.parts_for(numbers[places])]
            for part in parts:
                (one,) = part.members
                if one.attempts is not None:
                    continue
                delay.require_memory(one.longest_delay, one.loop.inputs, len(one), part.setting.simulation.dt)
        except InputError:
            if len(places) > 1:
                for place in places:
                    yield from self.again(numbers, np.array([place]), controller, step)
            return
        for part in parts:
            yield Rerun(controller, places[part.which], part, study)

    def _settle(self, found: Columns, rerun: Rerun, fine: Figured) -> None:
        """Use the results of the finer step, but keep the record of whether the estimates oscillate at the case's step."""
        name, resolved = self.study.controllers[rerun.controller], fine.finer_by == 0
        (rings,) = rerun.study.oscillated(rerun.part.setting, [fine.metrics], rerun.controller)
        columns = fine.metrics.columns() | {VERDICT: fine.kinds, RINGS: rings, SETTLED: np.ones(len(resolved))}
        for column, values in columns.items():
            found[f"{name}/{column}"][rerun.places[resolved]] = values[resolved]

    @cached_property
    def afforded(self) -> Afforded:
        """The limits for repeated members, chosen so that all repetitions together cost less than MOST_RERUN plain sweeps.

        These limits are determined from the first members of the plan, so they do not depend on which members run together.
        """
        within = max(MOST_RERUN, ALWAYS_RERUN / (len(self.study) * self.study.steps))
        tried = sorted({factor for factor, _ in self._needed})
        whole = [factor for factor in tried if self.expected(factor) <= within]
        if len(whole) == len(tried):
            return Afforded(np.inf)
        finest, beyond = max(whole, default=0.0), tried[len(whole)]
        taken = self.expected(finest)
        return Afforded(finest, beyond, (within - taken) / (self.expected(beyond) - taken))

    def cost(self, columns: Callable[[str], Array]) -> str | None:
        """A sentence on the cost of the repetitions compared with the plain sweep; None without repetitions."""
        case, found = self.study.example, 0.0
        refining = Refining.of(case.simulation.solver, delayed=case.problem.delay > 0)
        for controller in self.study.controllers:
            factor = np.nan_to_num(settled_by(columns, controller), posinf=0.0)
            found += float(refining.work(factor, case.simulation.solver).mean()) / len(self.study.controllers)
        if not found:
            return None
        return (
            f"runs with finer steps took {found:.2g} times the evaluations of the sweep's own step, and up to "
            f"{RERUN_COST * found:.2g} times its processor time. The limit is nine times, or some ten seconds of a core if that "
            "is more"
        )

    def expected(self, finest: float) -> float:
        """Number of evaluations of all repetitions with factors up to ``finest``, relative to the plain sweep."""
        each = len(self.study.controllers) * self._pilots
        return sum(work for factor, work in self._needed if factor <= finest) / each

    @property
    def reruns(self) -> float:
        """Expected number of evaluations of the repetitions, relative to the plain sweep."""
        finest, beyond, share = self.afforded
        return (1 - share) * self.expected(finest) + share * self.expected(beyond)

    @property
    def settled(self) -> float:
        """The fraction of the plan's first members, over all controllers, that are settled by the original step, or by an
        affordable finer step."""
        finest, beyond, share = self.afforded
        each = len(self.study.controllers) * self._pilots
        left = sum(1.0 if factor > max(finest, beyond) else (1.0 - share) * (factor > finest) for factor, _ in self._needed)
        return 1 - (self._unknown + left) / each

    @property
    def _pilots(self) -> int:
        return min(len(self.study), PILOTS)

    @property
    def _needed(self) -> list[tuple[float, float]]:
        """The factors, and the evaluations that they cost, for the plan's first members and those controllers that need a finer
        step."""
        return [one for one in self._looked_at if 0 < one[0] < np.inf]

    @property
    def _unknown(self) -> int:
        """The number of the plan's first members for which no factor is sufficient, or no factor is known."""
        return sum(not np.isfinite(factor) for factor, _ in self._looked_at)

    @cached_property
    def _looked_at(self) -> list[tuple[float, float]]:
        numbers = np.arange(self._pilots)
        parts = list(self.study.parts_for(numbers))
        columns = self.study.columns_for(numbers, parts, run_here(parts))
        found = []
        for part in parts:
            case = part.setting.example
            refining = Refining.of(case.simulation.solver, delayed=case.problem.delay > 0)
            for controller in self.study.controllers:
                needed = columns[f"{controller}/{FINER_BY}"][part.which]
                found += list(zip(needed.tolist(), refining.work(needed, case.simulation.solver).tolist(), strict=True))
        return found


def settled_by(columns: Callable[[str], Array], controller: str) -> Array:
    """(K,) the factor by which each member was settled: 0 for the original step, NaN if the member is not settled or was not
    examined."""
    return np.where(columns(f"{controller}/{SETTLED}") == 1, columns(f"{controller}/{FINER_BY}"), np.nan)


def done_here(work: Work, *, threads: int | None = None, progress: Sequence[Progress | None] = ()) -> Columns:
    """Do the work in threads of this process; ``progress`` has one entry for each request for parts."""
    told = iter(progress)
    try:
        parts = next(work)
        while True:
            parts = work.send(run_here(parts, threads=threads, progress=next(told, None)))
    except StopIteration as done:
        found: Columns = done.value
        return found
