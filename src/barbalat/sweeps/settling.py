"""Separates plant and solver: members whose step may damp or excite unresolved oscillations are repeated
with a step that resolves them.

The member's metrics and verdict are then those with that step.
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
"""Processor time of an evaluation in runs with finer steps, as a multiple of one of the plain sweep: it includes the judge,
the search for limit cycles and the audit. Measured on studies in which most members are suspect; the search for limit cycles
takes more than half of this time."""
MOST_RERUN = 9.0 / RERUN_COST
"""Largest total number of evaluations of runs with finer steps, as a multiple of the plain sweep's: together they take ten
times its time."""
ALWAYS_RERUN = 3 * 10**8
"""Number of solver steps that these runs may always take, even in a small sweep: some ten seconds of one core."""

GOLDEN = (5**0.5 - 1) / 2
"""The multiples of this number modulo 1 are evenly distributed in [0, 1), so any sequence of them samples the members
evenly."""

Work = Generator[list[StudyPart], list[list[Figured]], Columns]
"""Yields parts to be run anywhere, receives their metrics, and returns columns."""


class Step(NamedTuple):
    """The factor by which a step is smaller, and whether it uses the method that resolves more, see ``Refining``, or the
    case's own."""

    factor: int
    refined: bool


class Afforded(NamedTuple):
    """The members that are repeated: all that need a factor of at most ``finest``, and a fraction of those that need up to
    ``beyond``."""

    finest: float
    beyond: float = 0.0
    share: float = 0.0

    def __str__(self) -> str:
        return str(self.finest) + (f" and {self.share:.17g} up to {self.beyond:g}" if self.share else "")

    def admits(self, numbers: Array, factor: float) -> Array:
        """(K,) whether members with these numbers are repeated with a step smaller by ``factor``; this depends only on
        the numbers."""
        if factor <= self.finest or factor > self.beyond:
            return np.full(len(numbers), factor <= self.finest)
        return np.asarray((numbers * GOLDEN) % 1.0 < self.share)


@dataclass(frozen=True, eq=False)
class Finer(Varied):
    """The cases of a study with a different step. A sampled controller keeps its sample time, and a sampled law its own steps.

    With a tolerance, the finer tolerance with which runs are measured is used, whatever the step.
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
    """Members with one controller and another step: ``places`` are their indices among those requested, and ``part`` contains the
    members to run."""

    controller: int
    places: Array
    part: StudyPart
    study: Study


@dataclass(eq=False)
class Settling:
    """A study whose members are repeated if their own step does not settle their result, if it ``settles``.

    kernels  approximate numbers of kernels of the members that ran last: with their own step, and with finer ones
    """

    study: Study
    settles: bool = True
    _finer: dict[Step, Study] = field(init=False, default_factory=dict)
    _expected: float | None = field(init=False, default=None)
    kernels: int = field(init=False, default=1)

    def finer(self, step: Step) -> Study:
        """The same study with a different step."""
        if step not in self._finer:
            self._finer[step] = Study(Finer(self.study.varied, step), self.study.plan, motions=self.study.motions)
        return self._finer[step]

    def work(self, numbers: Array) -> Work:
        """All columns of the members with these numbers, (K,); raises InputError, with its number, for one that gives no valid
        case."""
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
        """These members with a different step, without those that this step rejects or whose cost is too high.

        A varied delay may be a whole number of the finer steps at every tried value: its weights then look constant. Such members
        stay unsettled, whichever other members run with them.
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
        """Use the results of the finer step, but keep the information whether estimates oscillate with the case's own step."""
        name, resolved = self.study.controllers[rerun.controller], fine.finer_by == 0
        (rings,) = rerun.study.oscillated(rerun.part.setting, [fine.metrics], rerun.controller)
        columns = fine.metrics.columns() | {VERDICT: fine.kinds, RINGS: rings, SETTLED: np.ones(len(resolved))}
        for column, values in columns.items():
            found[f"{name}/{column}"][rerun.places[resolved]] = values[resolved]

    @cached_property
    def afforded(self) -> Afforded:
        """The limits for repeated members, so all repetitions together cost less than MOST_RERUN plain sweeps.

        They are determined from the plan's first members, so they do not depend on the members that run together.
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
        """The cost of the repetitions compared with the plain sweep, as a sentence; None if there are none."""
        case, found = self.study.example, 0.0
        refining = Refining.of(case.simulation.solver, delayed=case.problem.delay > 0)
        for controller in self.study.controllers:
            factor = np.nan_to_num(settled_by(columns, controller), posinf=0.0)
            found += float(refining.work(factor, case.simulation.solver).mean()) / len(self.study.controllers)
        if not found:
            return None
        return (
            f"runs with finer steps took {found:.2g} times the evaluations of the sweep'"
            f"s own step, and up to {RERUN_COST * found:.2g} times its processor time"
            "; the limit is nine times, or some ten seconds of a core if that is more"
        )

    def expected(self, finest: float) -> float:
        """Evaluations of all repetitions with factors up to ``finest``, as a multiple of the plain sweep's."""
        each = len(self.study.controllers) * self._pilots
        return sum(work for factor, work in self._needed if factor <= finest) / each

    @property
    def reruns(self) -> float:
        """Expected evaluations of the repetitions, as a multiple of the plain sweep's."""
        finest, beyond, share = self.afforded
        return (1 - share) * self.expected(finest) + share * self.expected(beyond)

    @property
    def settled(self) -> float:
        """The fraction of the plan's first members, over all controllers, that are settled by their own step, or by one that is
        afforded."""
        finest, beyond, share = self.afforded
        each = len(self.study.controllers) * self._pilots
        left = sum(1.0 if factor > max(finest, beyond) else (1.0 - share) * (factor > finest) for factor, _ in self._needed)
        return 1 - (self._unknown + left) / each

    @property
    def _pilots(self) -> int:
        return min(len(self.study), PILOTS)

    @property
    def _needed(self) -> list[tuple[float, float]]:
        """The factors, and the evaluations that they take, for those of the plan's first members and controllers that need
        one."""
        return [one for one in self._looked_at if 0 < one[0] < np.inf]

    @property
    def _unknown(self) -> int:
        """The number of the plan's first members for which no factor is sufficient, or none is known."""
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
    """(K,) the factor by which each member was settled: 0 for its own step, NaN if it is not settled or was not examined."""
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
