"""Run a sweep from its first member to its last, and say what it is evidence of; or one of its members again, recorded."""

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
from barbalat.open_numbers.varied import VariedCase, VariedObjects
from barbalat.run.engine.engine import Batch, run
from barbalat.run.engine.simulate import result_of
from barbalat.run.engine.stability_label import MOST_WINDOWS
from barbalat.run.results.result import Result
from barbalat.sweeps.audit import audit as audited
from barbalat.sweeps.bounds import ERROR_BOUND, Bounds
from barbalat.sweeps.chunks import Chunk, Columns, Made, Pace, UnstoredChunks, chunk_size, chunks_of, in_order
from barbalat.sweeps.cluster import CHUNKS_AHEAD, Scheduler, Workers, connected
from barbalat.sweeps.costs import require_members
from barbalat.sweeps.evidence import evidence
from barbalat.sweeps.known_set_draws import sampled
from barbalat.sweeps.plan import Design, Plan, design_of, members_of
from barbalat.sweeps.requirement import Requirement
from barbalat.sweeps.result import SweepResult
from barbalat.sweeps.spread import Axis, Distribution
from barbalat.sweeps.store import Store, Waiting, opened, require_place
from barbalat.sweeps.study import Study, columns_of

Told = Callable[[str], None]
"""Takes a sentence for the person who waits."""


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
    threads: int | None = None,
    progress: Progress | None = None,
) -> SweepResult:
    """Run a case many times, over a grid, over draws, or with every draw at every point of a grid.

    case     a case file or a bundled case's name, whose keys ``vary`` and ``sample`` name; or a ``Case`` with a problem,
             controllers and a simulation, whose fields they name: ``plant.theta[0]``, ``controller[0].gamma``, ``simulation.dt``
    vary     by paths "START:STOP:COUNT" or "START:STOP:COUNT:log"
    sample   by paths "uniform:A:B", "normal:MEAN:DEVIATION", "loguniform:A:B"; "known-set" for a vector of a case file
    members  draws at each point of the grid, by default 1000 where something is drawn
    design   of the draws: "latin", "sobol", "random" (exact intervals), "saltelli" (Sobol indices)
    require  such as "max_abs_e[0] < 2"; counted where broken
    store    a folder that keeps every row and from which the same call goes on
    scheduler  "tcp://HOST:PORT" of a Dask scheduler, or "local:N" for N processes here; the same bits as in threads, the default
    bounds   certify what can be certified and hold the errors against it
    audit    members that are run again with a step 4 times smaller, 0 for none; by default 32, or as many as an eighth of the
             sweep's solver steps affords
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
    varied = VariedObjects(source, plan.paths) if isinstance(source, Case) else VariedCase(source, plan.paths)
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
    """All members; with a store those that it lacks.

    chunk   members of a new store's files at most, by default as many as take about a second; no bit depends on it
    scheduler  of the workers that run them; by default threads here
    bounds  certify what can be certified, a second for each controller, and hold the errors against it
    audit   members that are run again with a finer step; see ``audit.audit``
    told    what happened to the store, what is waited for
    Raises InputError for members beyond the budget, and for one that makes no case, with its number; what was stored stays.
    """
    if audit is not None:
        validate.whole("audit", audit, least=0)
    judged = Bounds(study) if bounds else None
    if store is not None:
        require_place(store)
    if store is None or not store.exists():
        require_members(study, len(study), judged.certificates if judged else 0)
    first = _judged(study.run(0, 1, threads=threads), study, judged, Chunk(0, 1))
    for requirement in requirements:
        requirement.require_known(list(first), study.controllers)
    started = time.perf_counter()
    with _sink(study, store, chunk, list(first)) as sink:
        if told is not None and sink.damaged:
            told(f"damaged in the store and made again: {', '.join(sink.damaged)}")
        resumed = done = sink.stored
        pace = Pace(ahead=1 if scheduler is None else CHUNKS_AHEAD)
        require_members(study, sum(one.size for one in sink.missing), judged.certificates if judged else 0)
        units = iter(sink.missing) if sink.in_order else pace.units(sink.missing)
        made = _here(study, units, done, threads, progress) if scheduler is None else _elsewhere(study, units, scheduler, told)
        with _kept(sink) as keep:
            for one, figures in in_order(made) if sink.in_order else _paced(made, pace):
                keep(one, _judged(figures, study, judged, one))
                done += one.size
                if progress is not None:
                    progress(done / len(study))
        rows = sink.rows()
    seconds = time.perf_counter() - started
    notes = judged.notes if judged is not None else ()
    found = evidence(rows, study.controllers, requirements, study.plan, notes, study.unexamined)
    return SweepResult(
        case=study.example.name,
        controllers=study.controllers,
        plan=study.plan,
        rows=rows,
        evidence=found,
        redesigned=study.redesigned,
        audit=audited(study, found, requirements, judged, members=audit, threads=threads),
        resumed=resumed,
        seconds=seconds,
        member_steps=float(study.steps) * (len(study) - resumed),
    )


@contextlib.contextmanager
def _sink(study: Study, store: Path | None, chunk: int | None, columns: Sequence[str]) -> Iterator[Store | UnstoredChunks]:
    size = chunk or chunk_size(len(study), study.steps)
    if store is None:
        yield UnstoredChunks.room_for(list(chunks_of(len(study), size)), len(columns))
        return
    bounded = any(name.endswith(f"/{ERROR_BOUND}") for name in columns)
    # which bounds are computed depends on how many members there are
    grows = study.plan.keeps_its_first and not bounded
    with opened(store, study.identity() | {"bounds": bounded}, len(study), size, grows=grows) as found:
        yield found


@contextlib.contextmanager
def _kept(sink: Store | UnstoredChunks) -> Iterator[Callable[[Chunk, Columns], None]]:
    """Takes what is complete; what a store has not written yet when it ends, in whatever way, is written then."""
    if isinstance(sink, UnstoredChunks):
        yield sink.add
        return
    waiting = Waiting(sink)
    try:
        yield waiting.add
    finally:
        waiting.put()


def _paced(made: Made, pace: Pace) -> Made:
    """The same, where the next pieces are as large as these show to be right."""
    for one, columns in made:
        yield one, columns
        pace.done(one)


def _here(study: Study, units: Iterator[Chunk], done: int, threads: int | None, progress: Progress | None) -> Made:
    """In threads, one after the other; ``done`` members are there already."""
    for one in units:
        yield one, study.run(*one, threads=threads, progress=part_of(progress, done / len(study), one.size / len(study)))
        done += one.size


def _elsewhere(study: Study, units: Iterator[Chunk], scheduler: Scheduler, told: Told | None) -> Made:
    """On a cluster, in any order."""
    first = next(units, None)
    if first is not None:
        with connected(scheduler) as client:
            if told is not None and not client.nthreads():
                told(f"no worker at {scheduler.address} yet: the sweep begins when one joins, 'dask worker {scheduler.address}'")
            yield from Workers(study, client).run(chain([first], units))


def _judged(found: Columns, study: Study, bounds: Bounds | None, chunk: Chunk) -> Columns:
    """A chunk's columns with what is guaranteed of each member."""
    if bounds is not None:
        found |= {f"{name}/{ERROR_BOUND}": values for name, values in bounds.of(study.values(*chunk)).items()}
    return found


@dataclass(frozen=True, eq=False, kw_only=True)
class Replayed:
    """A member's case and the runs of its controllers, with what varies and all figures by the names of a store's columns."""

    number: int
    case: Case
    results: tuple[Result, ...]
    columns: Columns

    def differing(self, stored: Mapping[str, float]) -> list[str]:
        """The columns of a stored row that are other bits than this run's."""
        own = {name: float(values[0]) for name, values in self.columns.items()}
        return [name for name, value in own.items() if name in stored and not np.array_equal(stored[name], value, equal_nan=True)]


def replay(study: Study, member: int, *, threads: int | None = None, progress: Progress | None = None) -> Replayed:
    """The member by its number, on the kernel of its sweep: one that is made for it alone would round differently.

    A recorded run adds its sums up in other blocks. So its figures are those of the run that is not recorded.
    """
    validate.whole("member", member, least=0, most=len(study) - 1)
    row = study.values(member, 1)
    case, setting = study.varied.at(row[0]), study.setting(row[0], windows=MOST_WINDOWS)
    plain = study.simulated(member)
    batches = []
    for controller, members in zip(case.controllers, setting.members(row, study.plan.streams(member, 1)), strict=True):
        own = replace(members, loop=ClosedLoop.of(case.problem, controller))
        batches.append(Batch.part(own, slice(0, 1), record=True))
    for i, batch in enumerate(batches):  # one after the other: a loop too large to be watched has no windows
        part = part_of(progress, i / len(batches), 1 / len(batches))
        run([batch], setting.signals, case.simulation, threads=threads, progress=part)
    results = tuple(
        replace(result_of(case.problem, controller, case.simulation, batch), metrics=metrics)
        for controller, batch, metrics in zip(case.controllers, batches, plain, strict=True)
    )
    found: Columns = {"member": np.array([member])} | {str(path): row[:, i] for i, path in enumerate(study.plan.paths)}
    for name_of, metrics in zip(study.controllers, plain, strict=True):
        found |= {f"{name_of}/{name}": values for name, values in columns_of(metrics).items()}
    return Replayed(number=member, case=case, results=results, columns=found)
