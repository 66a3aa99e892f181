"""Runs and evaluates a sweep, or repeats one of its members with a record."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import numpy as np

from barbalat import validate
from barbalat.budget import Progress, part_of
from barbalat.cases.build import Case
from barbalat.cases.load import CaseText
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.open_numbers.path import FieldPath, by_index
from barbalat.open_numbers.varied import Varied, VariedCase, VariedObjects
from barbalat.protocols import Controller
from barbalat.run.engine.by_tolerance import Observation
from barbalat.run.engine.engine import Batch, run
from barbalat.run.engine.judging import tail_is_short
from barbalat.run.engine.motion import StalledError
from barbalat.run.engine.simulate import result_of
from barbalat.run.engine.stability_label import MOST_WINDOWS
from barbalat.run.kernel.members import Members
from barbalat.run.results.result import Result
from barbalat.sweeps.audit import audit as audited
from barbalat.sweeps.bounds import ERROR_BOUND, Bounds
from barbalat.sweeps.chunks import (
    FEWEST_MEMBERS,
    Chunk,
    Columns,
    Made,
    Pace,
    Rows,
    UnstoredChunks,
    chunk_size,
    chunks_of,
    in_order,
)
from barbalat.sweeps.cluster import CHUNKS_AHEAD, Scheduler, Workers, connected
from barbalat.sweeps.costs import require_members
from barbalat.sweeps.evidence import evidence
from barbalat.sweeps.known_set_draws import sampled
from barbalat.sweeps.plan import Design, Plan, design_of, members_of
from barbalat.sweeps.requirement import Requirement
from barbalat.sweeps.result import SweepResult
from barbalat.sweeps.settling import Settling, Step, Work, done_here, settled_by
from barbalat.sweeps.spread import Axis, Distribution
from barbalat.sweeps.store import Store, Waiting, opened, require_place
from barbalat.sweeps.study import SETTLED, VERDICT, Study, batches_run
from barbalat.validate import Array

Told = Callable[[str], None]
"""A callback that receives a sentence for the waiting user."""


def sweep(
    case: str | Path | Case,
    *,
    vary: Mapping[str, str | Axis] | None = None,
    sample: Mapping[str, str | Distribution] | None = None,
    members: int | None = None,
    design: str | Design = Design.LATIN,
    seed: int = 0,
    require: Sequence[str] = (),
    store: str | Path | None = None,
    scheduler: str | Scheduler | None = None,
    bounds: bool = True,
    audit: int | None = None,
    redesign: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> SweepResult:
    """Run a case many times: over a grid, over random draws, or with every draw at every point of a grid.

    case     a case file or the name of a bundled case, to whose keys ``vary`` and ``sample`` refer; or a ``Case`` with a problem,
             controllers and a simulation, to whose fields they refer: ``plant.theta[0]``, ``controller[0].gamma``,
             ``simulation.dt``
    vary     by path, "START:STOP:COUNT" or "START:STOP:COUNT:log"
    sample   by path, "uniform:A:B", "normal:MEAN:DEVIATION", "loguniform:A:B"; "known-set" for a vector of a case file; "between"
             for "parameters.NAME" over its range, or for all "parameters"
    members  draws at each point of the grid, by default 1000 if anything is drawn
    design   how numbers are drawn: "latin", "sobol", "random" (exact intervals), "saltelli" (Sobol indices)
    require  requirements such as "max_abs_e[0] < 2", whose violations are counted
    store    a folder that keeps every row, and from which a repeated call continues
    scheduler  "tcp://HOST:PORT" of a Dask scheduler, or "local:N" for N processes here; the results are bit-identical to those of
               threads, which are the default
    bounds   certify the members where possible and compare their errors with the bounds
    audit    number of members that are repeated with half the step that gave their verdict, 0 for none; by default 2 % of the
             members and at least 30
    redesign  design reference model and controllers again for each member's plant.A, plant.b and parameters, instead of varying
              only the simulated plant
    Raises InputError.
    """
    folder = None if store is None else validate.local_path("store", store)
    source = case if isinstance(case, Case) else CaseText.read(case)
    labels = (source if isinstance(source, Case) else source.case()).problem.labels
    requirements = [Requirement.parse(by_index(text, labels)) for text in require]
    paths = {place: FieldPath.parse(by_index(place, labels)) for place in vary or {}}
    axes = {paths[place]: one if isinstance(one, Axis) else Axis.parse(one) for place, one in (vary or {}).items()}
    draws = sampled(source, list((sample or {}).items()))
    known = design_of(design)
    plan = Plan(axes, draws, members_of(members, known, drawn=bool(draws)), known, seed)
    if isinstance(source, Case):
        varied: Varied = VariedObjects(source, plan.paths, redesign)
    else:
        varied = VariedCase(source, plan.paths, redesign=redesign)
    return run_study(
        Study(varied, plan),
        requirements=requirements,
        store=folder,
        scheduler=Scheduler.parse(scheduler) if isinstance(scheduler, str) else scheduler,
        bounds=bounds,
        audit=audit,
        threads=threads,
        progress=progress,
    )


def run_study(
    study: Study,
    *,
    requirements: Sequence[Requirement] = (),
    store: Path | None = None,
    chunk: int | None = None,
    scheduler: Scheduler | None = None,
    bounds: bool = True,
    audit: int | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    told: Told | None = None,
) -> SweepResult:
    """Run all members; with a store, only the missing ones.

    chunk   largest number of members in a file of a new store; by default, as many as take about a second. Results do not depend
            on it
    scheduler  scheduler of the workers that run the members; by default threads of this process
    bounds  certify the members where possible, which takes about a second for each controller, and compare their errors with the
            bounds
    audit   number of members that are repeated with half of their step; see ``audit.audit``
    told    receives sentences on the store and on the current wait

    Raises InputError for members beyond the budget and, with its number, for a member that gives no valid case. Stored rows are
    kept.
    """
    if audit is not None:
        validate.whole("audit", audit, least=0)
    if scheduler is not None:
        study.example.simulation.require_steps("a sweep on other computers")
    judged = Bounds(study) if bounds else None
    if store is not None:
        require_place(store)
    settling = Settling(study)
    if store is None or not store.exists():
        require_members(settling, len(study), judged.certificates if judged else 0)
    first = _judged(study.run(0, 1, threads=threads), study, judged, Chunk(0, 1))
    for requirement in requirements:
        requirement.require_known(list(first), study.controllers)
    started = time.perf_counter()
    with _sink(settling, store, chunk, list(first)) as sink:
        if told is not None and sink.damaged:
            told(f"damaged in the store and repeated: {', '.join(sink.damaged)}")
        resumed = done = sink.stored
        names = sink.names or list(first)
        settling.settles = f"{study.controllers[0]}/{SETTLED}" in names
        pace = Pace(ahead=1 if scheduler is None else CHUNKS_AHEAD)
        require_members(settling, sum(one.size for one in sink.missing), judged.certificates if judged else 0)
        units = iter(sink.missing) if sink.in_order else pace.units(sink.missing)
        made = (
            _here(settling, units, done, threads, progress) if scheduler is None else _elsewhere(settling, units, scheduler, told)
        )
        with _kept(sink) as keep:
            for one, figures in in_order(made) if sink.in_order else _paced(made, pace, settling):
                columns = _judged(figures, study, judged, one)
                keep(one, {name: columns[name] for name in names})
                done += one.size
                if progress is not None:
                    progress(done / len(study))
        rows = sink.rows()
    seconds = time.perf_counter() - started
    notes = [*(judged.notes if judged is not None else ()), *_of_the_judge(settling, rows)]
    by_tolerance = study.example.simulation.tolerance is not None
    return SweepResult(
        case=study.example.name,
        controllers=study.controllers,
        plan=study.plan,
        rows=rows,
        evidence=evidence(rows, study.controllers, requirements, study.plan, notes, study.unexamined),
        redesigned=study.redesigned,
        of_the_design=study.of_the_design,
        redesign=bool(study.varied.redesign),
        audit=audited(settling, rows, requirements, members=audit, run=_runner(scheduler, threads)),
        resumed=resumed,
        seconds=seconds,
        member_steps=0.0 if by_tolerance else float(study.steps) * (len(study) - resumed),
    )


def _of_the_judge(settling: Settling, rows: Rows) -> Iterator[str]:
    case = settling.study.example
    if not settling.settles:
        yield UNJUDGED
        return
    if (cost := settling.cost(rows.column)) is not None:
        yield cost
    if case.problem.faults and not any(path.keys[0] == "faults" for path in settling.study.varied.paths):
        yield SAME_FAULTS
    if not case.judge.closely and tail_is_short(case.problem, case.simulation):
        yield SHORT_TAIL


SAME_FAULTS = (
    "all members have the same faults at the same instants, so fractions and intervals hold only for this pattern; "
    "--vary faults[0].seed=0:99:100 runs other patterns"
)
SHORT_TAIL = (
    "the tail, the last quarter of the run, has less than three periods of the model's slowest mode, so not all limit cycles of "
    "this period are counted. Use a longer run, or judge.closely = true, which takes up to three and a half times as long"
)
UNJUDGED = (
    "this store was written before runs had verdicts: its members have neither verdicts nor finer steps; use a different "
    "--store, or none, to obtain them"
)
"""A store without the judge's columns. Its rows are read, and new rows get the same columns."""


@contextlib.contextmanager
def _sink(settling: Settling, store: Path | None, chunk: int | None, columns: Sequence[str]) -> Iterator[Store | UnstoredChunks]:
    study = settling.study
    size = chunk or chunk_size(len(study), study.steps)
    if store is None:
        yield UnstoredChunks.room_for(list(chunks_of(len(study), size)), len(columns))
        return
    bounded = any(name.endswith(f"/{ERROR_BOUND}") for name in columns)
    # the number of members determines which bounds are computed
    grows = study.plan.keeps_its_first and not bounded
    identity = study.identity() | {"bounds": bounded}
    if study.plan.keeps_its_first:  # the number of members determines the affordable finer steps
        identity["finest"] = str(settling.afforded)
    with opened(store, identity, len(study), size, grows=grows) as found:
        yield found


@contextlib.contextmanager
def _kept(sink: Store | UnstoredChunks) -> Iterator[Callable[[Chunk, Columns], None]]:
    """Accepts complete chunks and, when it ends for whatever reason, writes the chunks that are not stored yet."""
    if isinstance(sink, UnstoredChunks):
        yield sink.add
        return
    waiting = Waiting(sink)
    try:
        yield waiting.add
    finally:
        waiting.put()


def _paced(made: Made, pace: Pace, settling: Settling) -> Made:
    """Yield the pieces. Their duration determines the size of the next pieces."""
    for one, columns in made:
        yield one, columns
        pace.fewest = FEWEST_MEMBERS * settling.kernels
        pace.done(one)


def _here(settling: Settling, units: Iterator[Chunk], done: int, threads: int | None, progress: Progress | None) -> Made:
    """Run the chunks in threads, one after another; ``done`` members are already stored."""
    members = len(settling.study)
    for one in units:
        told = part_of(progress, done / members, one.size / members)
        yield one, settling.run(_numbers(one), threads=threads, progress=told)
        done += one.size


def _elsewhere(settling: Settling, units: Iterator[Chunk], scheduler: Scheduler, told: Told | None) -> Made:
    """Run the chunks on a cluster, in any order."""
    first = next(units, None)
    if first is not None:
        with connected(scheduler) as client:
            if told is not None and not client.nthreads():
                told(f"no worker at {scheduler.address} yet: the sweep starts when one joins, 'dask worker {scheduler.address}'")
            yield from Workers(lambda chunk: settling.work(_numbers(chunk)), client).run(chain([first], units))


def _numbers(chunk: Chunk) -> Array:
    return np.arange(chunk.first, chunk.first + chunk.size)


def _runner(scheduler: Scheduler | None, threads: int | None) -> Callable[[Work], Columns]:
    """The function that does a piece of work alone, in the process that runs the members."""
    if scheduler is None:
        return lambda work: done_here(work, threads=threads)

    def on_workers(work: Work) -> Columns:
        with connected(scheduler) as client:
            ((_, columns),) = Workers(lambda _: work, client).run([Chunk(0, 1)])
        return columns

    return on_workers


def _judged(found: Columns, study: Study, bounds: Bounds | None, chunk: Chunk) -> Columns:
    """A chunk's columns with the guarantees for each member."""
    if bounds is not None:
        found |= {f"{name}/{ERROR_BOUND}": values for name, values in bounds.of(study.values(*chunk)).items()}
    return found


@dataclass(frozen=True, eq=False, kw_only=True)
class Replayed:
    """The case of a member and the runs of its controllers, with the varied numbers and all metrics under the column names of a
    store."""

    number: int
    case: Case
    results: tuple[Result, ...]
    columns: Columns

    def differing(self, stored: Mapping[str, float]) -> list[str]:
        """The columns of a stored row whose bits differ from those of this run."""
        own = {name: float(values[0]) for name, values in self.columns.items()}
        return [name for name, value in own.items() if name in stored and not np.array_equal(stored[name], value, equal_nan=True)]


def replay(study: Study, member: int, *, progress: Progress | None = None) -> Replayed:
    """Run the member with this number on the kernel of its sweep, because a kernel made for it alone would round differently.

    A recorded run accumulates its sums in different blocks, so the metrics are taken from the unrecorded run.
    """
    validate.whole("member", member, least=0, most=len(study) - 1)
    settling, row = Settling(study), study.values(member, 1)
    case, columns = study.varied.at(row[0]), settling.run(np.array([member]))
    results = []
    for i, (controller, name) in enumerate(zip(case.controllers, study.controllers, strict=True)):
        (factor,) = settled_by(columns.__getitem__, name)
        own = settling.finer(Step(int(factor), refined=True)) if factor > 0 else study
        part = part_of(progress, i / len(case.controllers), 1 / len(case.controllers))
        results.append(_recorded(own, member, i, controller, part))
    return Replayed(number=member, case=case, results=tuple(results), columns=columns)


def worst_runs(study: Study, found: SweepResult) -> dict[str, tuple[int, Result]]:
    """The worst member of each controller and its recorded run, with the step that settled it.

    Among the members of the worst class, this is the one that was lost first, or else the one with the largest error in the tail.
    With a tolerance, members that stall have no run and are excluded. A controller is omitted if all its members stall, or if its
    worst member stalls when it is recorded.
    """
    settling, runs = Settling(study), {}
    for i, name in enumerate(study.controllers):
        kinds = found.column(f"{name}/{VERDICT}")
        tail = np.max([found.column(one) for one in found.rows.names if one.startswith(f"{name}/tail_max_abs_e[")], axis=0)
        diverged = found.column(f"{name}/diverged_at")
        stalled = np.isnan(tail) & np.isnan(diverged)
        if stalled.all():
            continue
        badness = np.where(np.isfinite(diverged), np.inf, np.nan_to_num(tail, nan=np.inf))
        (worst, *_) = np.lexsort((np.nan_to_num(diverged, nan=np.inf), -badness, kinds, stalled))
        (factor,) = settled_by(found.column, name)[[worst]]
        own = settling.finer(Step(int(factor), refined=True)) if factor > 0 else study
        try:
            runs[name] = int(worst), _recorded(own, int(worst), i, study.example.controllers[i], None)
        except StalledError:  # a single run has different rounding errors, which may decide whether it slides
            continue
    return runs


def _recorded(study: Study, member: int, number: int, controller: Controller, progress: Progress | None) -> Result:
    """A member's run with one controller; its metrics are those of the unrecorded run."""
    row = study.values(member, 1)
    case, setting = study.varied.at(row[0]), study.setting(row[0], windows=MOST_WINDOWS)
    members = setting.members(row, study.plan.streams(member, 1))[number]
    (plain,) = batches_run(study.setting(row[0]), [study_members(study, member)[number]])
    if members.attempts is not None:
        seen = Observation.of(case.problem, controller, case.simulation, None, number=int(members.numbers[0]))
        seen.run(progress)
        return replace(seen.result(None, measured=False), metrics=plain.metrics(case.simulation.grid))
    batch = Batch.part(replace(members, loop=ClosedLoop.of(case.problem, controller)), slice(0, 1), record=True)
    run([batch], setting.signals, case.simulation, progress=progress)
    found = result_of(case.problem, controller, case.simulation, batch)
    return replace(found, metrics=plain.metrics(case.simulation))


def study_members(study: Study, member: int) -> tuple[Members, ...]:
    """The arguments of each controller's kernel for one member."""
    (part,) = study.parts(member, 1)
    return part.members
