"""A sweep that is ready to run. Any members can be simulated from their numbers alone, with results that do not depend on other
members."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from barbalat.budget import Progress, part_of
from barbalat.cases.build import Case
from barbalat.linear.driven_response import MOST_INSTANTS
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.open_numbers import truth_paths
from barbalat.open_numbers.members import RefusedError, Setting
from barbalat.open_numbers.probe import Kind, Tried, kinds_of
from barbalat.open_numbers.varied import Varied
from barbalat.problem.state_feedback import Problem
from barbalat.run.engine.engine import Batch, run
from barbalat.run.engine.judging import Terms, judged
from barbalat.run.engine.observed_group import ObservedBatch
from barbalat.run.engine.refining import FACTORS, NEGLIGIBLE, ORDER_EIGHT_FACTORS, finer_by, needed_by_modes
from barbalat.run.engine.side_by_side import expected_attempts, run_members
from barbalat.run.kernel import delay, template
from barbalat.run.kernel.breaks import can_be_split
from barbalat.run.kernel.costs import steps_like
from barbalat.run.kernel.members import Members
from barbalat.run.kernel.metrics import Metrics
from barbalat.solvers.simulation import Simulation
from barbalat.study.reference_motion import ReferenceMotion
from barbalat.study.ringing import known_width, rings
from barbalat.sweeps.chunks import Columns
from barbalat.sweeps.plan import Plan
from barbalat.validate import Array, InputError

REFERENCE_MODEL, OBSERVER = "the reference model", "the observer"
"""What uses the numbers of a member, besides the controllers, which are named."""
OF_THE_DESIGN = ("controller", "reference_model", "uncertainty", "reference", "simulation")
"""First keys of a designer's choices and knowledge: varying them means varying the design. All other keys belong to the plant."""
OF_NO_DESIGN = (("plant", "x0"),)
"""Parts that are not design choices: the state is measured, so a predictor begins at its initial value."""
DESIGN_ROUNDING = 1e-9
"""Relative difference, with respect to the largest number of an array, that is far above the rounding errors of a matrix that
does not depend on the varied numbers."""


def redesigned(varied: Varied, tried: Tried) -> dict[str, tuple[str, ...]]:
    """The designs that are repeated for each member, by the paths of the plant's numbers on which they depend.

    A gain or a reference model computed from the plant is no longer that of the case. Such a sweep tries many designs, each on
    its plant or on the simulated plant, and not one design on many plants.
    """
    found: dict[str, tuple[str, ...]] = {}
    base = varied.at(tried.middle)
    for column, path in enumerate(varied.paths):
        if path.keys[0] in OF_THE_DESIGN or path.keys[:2] in OF_NO_DESIGN:
            continue
        cases = [varied.at(row) for row in tried.rows(column, tried.middle)]
        makers = [REFERENCE_MODEL, OBSERVER, *(one.name for one in base.controllers)]
        differs = [any(not _alike(one, other) for other in others) for one, *others in _designs(base, cases)]
        if names := tuple(name for name, differing in zip(makers, differs, strict=True) if differing):
            found[str(path)] = names
    return found


def _designs(base: Case, cases: Sequence[Case]) -> list[list[tuple[Array, ...]]]:
    """The arrays of the reference model, the observer design and the equations of each controller, for the base and for the other
    members."""
    every = (base, *cases)
    designs = [[template.Columns(case.problem.model.matrices).leaves for case in every], [_observer(case) for case in every]]
    for i in range(len(base.controllers)):
        loops = [ClosedLoop.of(case.problem, case.controllers[i]) for case in (base, *cases)]
        designs.append([template.Columns(loop.equations).leaves for loop in loops])
    return designs


def _observer(case: Case) -> tuple[Array, ...]:
    """The numbers that determine the observer; empty without one."""
    found = case.problem.fixed_observer if isinstance(case.problem, Problem) else None
    if found is None:
        return ()
    settings = [np.array(list(_numbers_in(value))) for value in vars(found.design).values()]
    return found.A, found.b, found.C, np.array([found.delay]), *settings


def _numbers_in(value: Any) -> Iterator[complex]:
    """The numbers in nested sequences; poles are numbers or pairs."""
    if isinstance(value, (list, tuple, np.ndarray)):
        for one in value:
            yield from _numbers_in(one)
    elif isinstance(value, (int, float, complex)):
        yield complex(value)


def _alike(one: Sequence[Array], other: Sequence[Array]) -> bool:
    """Whether these arrays differ by no more than rounding."""
    if [leaf.shape for leaf in one] != [leaf.shape for leaf in other]:
        return False
    return all(
        np.allclose(a, b, rtol=0.0, atol=DESIGN_ROUNDING * np.abs(a[np.isfinite(a)]).max(initial=0.0), equal_nan=True)
        for a, b in zip(one, other, strict=True)
    )


OSCILLATED = "oscillated"
"""A column of each controller: whether its estimates oscillate; NaN without estimates or if their range is unknown."""
VERDICT, SETTLED, RINGS, FINER_BY = "verdict", "settled", "rings", "finer_by"
"""Four columns for each controller: the number of the judge's class, whether that class is settled (1 or 0, NaN if unchecked),
``oscillated`` with a finer step if one was needed, and the step that the member needs (see ``judging.finer_by``)."""
TRIED_SHARES = (0.03, 0.4, 0.97)
"""Quantiles of a distribution, without its far tails, which a constructor may reject."""
MOST_SETTINGS = 64
"""Number of kernels kept for later members."""


class Figured(NamedTuple):
    """The results of M runs of one controller: metrics, (M,) numbers of the judge's classes, and how much finer their steps must
    be. This is infinite for a run that no tried step resolves, or that stalls with variable steps."""

    metrics: Metrics
    kinds: Array
    finer_by: Array


@dataclass(frozen=True, eq=False)
class StudyPart:
    """Members with one set of signals: their indices among the requested members, and the arguments of each controller's
    kernel."""

    which: Array
    setting: Setting
    members: tuple[Members, ...]

    @property
    def work(self) -> int:
        """Evaluations of the equations, over all members and controllers."""
        simulation = self.setting.simulation
        return len(self.which) * len(self.members) * simulation.steps * len(simulation.solver.b)


@dataclass(eq=False)
class Study:
    """The members of a plan applied to a case.

    varied   the case, whose numbers at the plan's paths vary
    motions  motions of the models of settings, by the numbers of the settings and instants; studies of the same case with
             different steps may share them
    """

    varied: Varied
    plan: Plan
    tried: Tried = field(init=False)
    kinds: tuple[Kind, ...] = field(init=False)
    example: Case = field(init=False)
    settings: dict[bytes, Setting] = field(init=False, default_factory=dict)
    motions: dict[tuple[bytes, int], ReferenceMotion] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.tried = _tried(self.plan)
        self.kinds = kinds_of(self.varied, self.tried)
        self.example = self.varied.at(self.tried.middle)

    def __len__(self) -> int:
        return len(self.plan)

    @property
    def controllers(self) -> tuple[str, ...]:
        return tuple(controller.name for controller in self.example.controllers)

    @property
    def steps(self) -> int:
        """The number of solver steps of a member's run, summed over all controllers; the maximum over the ends of the varied
        numbers.

        With a tolerance, this is the number of fixed steps that take as long as the run of the first member.
        """
        if self.example.simulation.tolerance is not None:
            return round(sum(self.steps_like))
        found = [self.example]
        for column, kind in enumerate(self.kinds):
            if kind is Kind.STRUCTURE:
                found += [self.varied.at(row) for row in self.tried.rows(column, self.tried.middle)]
        return max(case.simulation.steps for case in found) * len(self.example.controllers)

    @cached_property
    def steps_like(self) -> tuple[float, ...]:
        """With a tolerance, the number of fixed steps, for each controller, that take as long as the run of the first member."""
        (part,) = self.parts(0, 1)
        return tuple(steps_like(expected_attempts(one)) for one in part.members)

    def values(self, first: int, count: int) -> Array:
        """(count, paths) the varied numbers of the members from number ``first`` on."""
        return self.plan.values(first, count)

    def run(self, first: int, count: int, *, threads: int | None = None, progress: Progress | None = None) -> Columns:
        """All columns of these members, run at the case's step; raises InputError, with the number of the member, if a
        member gives no valid case."""
        parts = list(self.parts(first, count))
        return self.columns(first, count, parts, run_here(parts, threads=threads, progress=progress))

    def parts(self, first: int, count: int) -> Iterator[StudyPart]:
        """Members that run together, ready for their kernels; raises InputError, with the number of the member, if a member gives
        no valid case."""
        return self.parts_for(np.arange(first, first + count))

    def parts_for(self, numbers: Array) -> Iterator[StudyPart]:
        """Members with these numbers, (K,), that run together (see ``parts``)."""
        rows, streams = self.plan.values_for(numbers), self.plan.streams_for(numbers)
        for which in self._groups(rows):
            setting = self.setting(rows[which[0]])
            try:
                yield StudyPart(which, setting, setting.members(rows[which], streams[which]))
            except RefusedError as error:
                raise InputError(f"member {int(numbers[which[error.place]])}: {error}") from None

    def columns(self, first: int, count: int, parts: Sequence[StudyPart], figures: Sequence[Sequence[Figured]]) -> Columns:
        """All columns of members whose parts have run, from the metrics of each part and controller."""
        return self.columns_for(np.arange(first, first + count), parts, figures)

    def columns_for(self, numbers: Array, parts: Sequence[StudyPart], figures: Sequence[Sequence[Figured]]) -> Columns:
        """All columns of the members with these numbers, (K,), whose parts have run at the case's step (see
        ``columns``)."""
        rows, count = self.plan.values_for(numbers), len(numbers)
        found: Columns = {"member": numbers}
        found |= {str(path): rows[:, i] for i, path in enumerate(self.plan.paths)}
        for part, figured in zip(parts, figures, strict=True):
            judged = self.oscillated(part.setting, [one.metrics for one in figured])
            for controller, one, oscillated, modes in zip(self.controllers, figured, judged, self._needed_by_modes, strict=True):
                columns, needed = one.metrics.columns() | {OSCILLATED: oscillated}, np.maximum(one.finer_by, modes)
                settled = np.where(np.isnan(needed), np.nan, needed == 0)
                columns |= {VERDICT: one.kinds.astype(float), RINGS: oscillated, FINER_BY: needed, SETTLED: settled}
                for name, values in columns.items():
                    column = found.setdefault(f"{controller}/{name}", np.full(count, np.nan))
                    column[part.which] = values
        return found

    def _groups(self, rows: Array) -> Iterator[Array]:
        """The rows that run together because they have one structure and one set of signals."""
        shared = [column for column, kind in enumerate(self.kinds) if not kind.is_number]
        if not shared:
            yield np.arange(len(rows))
            return
        _, group = np.unique(rows[:, shared], axis=0, return_inverse=True)
        order = np.argsort(group.reshape(-1), kind="stable")
        yield from np.split(order, np.flatnonzero(np.diff(group.reshape(-1)[order])) + 1)

    def setting(self, row: Array, *, windows: int = 1) -> Setting:
        """The setting to which a member belongs; for ``windows``, see ``Members``."""
        base = self.tried.middle.copy()
        structural = [column for column, kind in enumerate(self.kinds) if kind is Kind.STRUCTURE]
        driven = [column for column, kind in enumerate(self.kinds) if kind is Kind.SIGNAL]
        base[structural] = row[structural]
        key = base.tobytes()
        if driven:
            base[driven] = row[driven]
            case = self.varied.at(base)
            key += bytes([can_be_split(case.problem.signals, case.simulation)])
        key += windows.to_bytes(4)
        if key not in self.settings:
            if len(self.settings) >= MOST_SETTINGS:
                self.settings.clear()
            self.settings[key] = Setting.of(self.varied, self.kinds, self.tried, base, windows=windows, judged=True)
        found = self.settings[key]
        return found.driven_by(base, case) if driven else found

    def _motion(self, setting: Setting) -> ReferenceMotion:
        """The motion of a setting's model, computed once."""
        key = setting.base.tobytes(), min(setting.simulation.steps, MOST_INSTANTS)
        if key not in self.motions:
            if len(self.motions) >= MOST_SETTINGS:
                self.motions.clear()
            self.motions[key] = ReferenceMotion.of(setting.example.problem, setting.simulation)
        return self.motions[key]

    def oscillated(self, setting: Setting, metrics: Sequence[Metrics], first: int = 0) -> list[Array]:
        """For controllers from number ``first`` on (M,): 1 if estimates oscillate, NaN if the range of the estimates is
        unknown."""
        problem, motion = setting.example.problem, self._motion(setting)
        found = []
        controllers = setting.example.controllers[first : first + len(metrics)]
        for controller, one in zip(controllers, metrics, strict=True):
            width = known_width(problem, controller)
            swings = rings(one, width, motion.crossings).astype(float)
            unknown = len(width) == 0 or not np.isfinite(width).all()
            ended_early = np.isnan(one.rms_e).any(axis=1)  # the run diverged or stalled
            found.append(np.where(ended_early | unknown, np.nan, swings))
        return found

    @cached_property
    def _needed_by_modes(self) -> list[float]:
        """For each controller, the largest refinement needed by the middle member or by any member at an end of the range of a
        varied plant number or of the step."""
        rows = [self.tried.middle]
        for column, path in enumerate(self.plan.paths):
            if path.keys[0] in ("plant", "parameters", "simulation"):
                rows += list(self.tried.rows(column, self.tried.middle))
        cases = [self.varied.at(row) for row in rows]
        return [
            max(needed_by_modes(ClosedLoop.of(case.problem, case.controllers[i]), case.simulation) for case in cases)
            for i in range(len(self.controllers))
        ]

    @cached_property
    def redesigned(self) -> dict[str, tuple[str, ...]]:
        """The controllers that are redesigned for each member, by the paths that determine them (see the function
        ``redesigned``)."""
        return redesigned(self.varied, self.tried)

    @cached_property
    def of_the_design(self) -> tuple[str, ...]:
        """The varied numbers of the plant and the parameters that are not simulated, because [truth] has separate numbers."""
        problem = self.example.problem
        if not isinstance(problem, Problem):
            return ()
        return tuple(str(path) for path in self.varied.paths if truth_paths.is_of_the_design(problem, path))

    @cached_property
    def unexamined(self) -> dict[str, str]:
        """Why it cannot be decided whether the estimates of a controller oscillate, by controller name; other controllers are
        omitted."""
        widths = (known_width(self.example.problem, one) for one in self.example.controllers)
        found = {}
        for name, width in zip(self.controllers, widths, strict=True):
            if len(width) == 0:
                found[name] = "it has no estimates"
            elif not np.isfinite(width).all():
                found[name] = "the range of its estimates is not known"
        return found

    def equations(self) -> str:
        """SHA-256 of the operation lists, numbers and signals of the middle member: the version of the equations.

        The judge is not included, because no bit of a run depends on it: old stores, written before runs were judged, have the
        same version.
        """
        setting = Setting.of(self.varied, self.kinds, self.tried, self.tried.middle)
        digest = hashlib.sha256(_programs(setting))
        for numbers in setting.numbers(self.tried.middle[None]):
            digest.update(numbers.parameters.tobytes() + numbers.states.tobytes())
        simulation = setting.simulation
        t = simulation.time(np.linspace(0, simulation.steps, 1001).astype(int))
        for signal in setting.signals:
            digest.update(np.asarray(signal(t), dtype=float).tobytes())
        return digest.hexdigest()

    def judge(self) -> str:
        """SHA-256 of the operation lists including those of the judge: the version of the verdicts."""
        terms = repr((NEGLIGIBLE, FACTORS, ORDER_EIGHT_FACTORS)).encode()
        return hashlib.sha256(_programs(self.setting(self.tried.middle)) + terms).hexdigest()

    def identity(self) -> dict[str, object]:
        """The data that a store must agree with to be continued."""
        return {
            "case": self.varied.source,
            "plan": self.plan.as_json(),
            "equations": self.equations(),
            "judge": self.judge(),
        }


def _programs(setting: Setting) -> bytes:
    """The operation lists of all controllers' kernels."""
    members = [family.members for family in setting.families]
    attempts = "".join(repr(one.attempts.lists) for one in members if one.attempts is not None)
    programs = [one.program for one in members]
    return ("".join(repr((one.program, one.sample, one.shape)) for one in programs) + attempts).encode()


def _tried(plan: Plan) -> Tried:
    """Trial values of the varied numbers of a plan, with which the effect of each number is determined."""
    found, drawn = [axis.values for axis in plan.axes.values()], list[Array]()
    for one in plan.draws.values():
        found.append(one.at(np.array(TRIED_SHARES), drawn))
        drawn.append(np.full(len(TRIED_SHARES), found[-1][len(TRIED_SHARES) // 2]))
    middle = np.array([values[len(values) // 2] for values in found])
    ends = [values[[0, len(values) // 3, -1]] for values in found]
    return Tried(middle, tuple(np.unique(v[v != m]) for v, m in zip(ends, middle, strict=True)))


def batches_run(
    setting: Setting,
    members: Sequence[Members],
    *,
    threads: int | None = None,
    progress: Progress | None = None,
) -> list[Batch]:
    """Run the members of each controller without a record and return them."""
    simulation = setting.simulation
    if simulation.tolerance is not None:
        shares = [(i / len(members), 1 / len(members)) for i in range(len(members))]
        told = [part_of(progress, *share) for share in shares]
        return [run_members(one, slice(0, len(one)), threads=threads, progress=p) for one, p in zip(members, told, strict=True)]
    for one in members:
        delay.require_memory(one.longest_delay, one.loop.inputs, len(one) * len(members), simulation.dt)
    batches = [Batch.part(one, slice(0, len(one)), record=False) for one in members]
    run(batches, setting.signals, simulation, threads=threads, progress=progress)
    return batches


def run_here(parts: Sequence[StudyPart], *, threads: int | None = None, progress: Progress | None = None) -> list[list[Figured]]:
    """The results of the members of each part, by controller, in threads of this process."""
    found, done, whole = [], 0, sum(one.work for one in parts)
    for one in parts:
        told = part_of(progress, done / whole, one.work / whole)
        batches = batches_run(one.setting, one.members, threads=threads, progress=told)
        found.append(figures_of(one.setting, batches, threads))
        done += one.work
    return found


def figures_of(setting: Setting, batches: Sequence[Batch], threads: int | None = None) -> list[Figured]:
    """The results of the members of each controller, after their run."""
    return [figured(batch, setting.simulation, setting.terms, threads) for batch in batches]


def figured(batch: Batch, simulation: Simulation, terms: Terms, threads: int | None = None) -> Figured:
    """The results of the members of a batch, after their run. Limit cycles are searched for if the step resolves the run."""
    if simulation.tolerance is None:
        needed = finer_by(batch, simulation)
    else:  # with a tolerance, every oscillation is resolved
        simulation, needed = simulation.grid, np.zeros(batch.states.shape[1])
    resolved = ~(needed > 0)
    kinds = judged(batch, simulation, terms, among=resolved, frequencies=False, excused=True, threads=threads).kinds
    if isinstance(batch, ObservedBatch):
        needed = np.where(batch.stalled, np.inf, needed)
    return Figured(batch.metrics(simulation), kinds, needed)
