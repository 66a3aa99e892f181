"""The cost of a sweep before it is run: a few members are processed here like all others to measure the time and memory of each
stage."""

from __future__ import annotations

import math
import pickle
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from barbalat import budget, validate
from barbalat.budget import Estimate, of_kernel
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.open_numbers.probe import Kind
from barbalat.run.kernel.costs import MEMBER, of_judging, of_members, of_steps
from barbalat.run.kernel.metrics import Metrics
from barbalat.run.kernel.time_signals import TimeSignals
from barbalat.sweeps.chunks import MOST_MEMBERS, chunk_size
from barbalat.sweeps.cluster import Tabulated, WorkerTask, figures
from barbalat.sweeps.settling import MOST_RERUN, RERUN_COST, Settling
from barbalat.sweeps.store import opened
from barbalat.sweeps.stored import name_of, require_parquet
from barbalat.sweeps.study import Figured, Study

MEASURING_SECONDS = 3.0
"""Duration of the client's work over which its speed is measured [s]."""


GROUP_SECONDS = 0.02
"""Seconds per controller for members that share a kernel and signals, in addition to their steps: 20 ms for a case and its
tables."""


def require_members(settling: Settling, members: int, certificates: int = 0) -> None:
    """Raise InputError if this number of members (or the number missing from a store) exceeds the budget, before the first of
    them is built.

    If the runs with finer steps could be too many, the plan's first members are run to estimate their cost.

    certificates  largest number of certificates, for the bounds with which the members' errors are compared
    """
    study = settling.study
    loops = [ClosedLoop.of(study.example.problem, one) for one in study.example.controllers]
    by_tolerance = study.example.simulation.tolerance is not None
    stored = Estimate(memory=MEMBER.memory * (len(study) - members))  # the evaluation reads all members

    groups, structures = _apart(study, Kind.SIGNAL, Kind.STRUCTURE), _apart(study, Kind.STRUCTURE)
    alone = Estimate(seconds=GROUP_SECONDS * len(loops))
    certified = budget.of_certificate(len(study.example.problem.dynamics.x0)).seconds
    traced = sum(of_kernel(loop.size).seconds for loop in loops)
    if not by_tolerance:
        alone += of_steps(study.example.problem, loops, study.steps / len(loops))
    elif any(TimeSignals.of(study.example.problem.signals).formulas):  # signals are part of the code of attempts
        alone += Estimate(seconds=traced)

    def cost(count: float) -> Estimate:
        apart = Estimate(seconds=alone.seconds * min(count, groups) + traced * min(count, structures))
        apart += Estimate(seconds=certified * min(count * len(loops), certificates))
        if by_tolerance:
            each = zip(loops, study.steps_like, strict=True)
            steps = sum((of_members([loop], own, count) for loop, own in each), Estimate())
        else:
            steps = of_members(loops, study.steps / len(loops), count)
        again = Estimate(seconds=RERUN_COST * reruns * (steps.seconds + alone.seconds * min(count, groups)))
        return stored + steps + of_judging(loops, min(count, MOST_MEMBERS)) + apart + again

    reruns = 0.0
    plain, budgeted = cost(members), budget.in_force()
    if (
        settling.settles
        and not by_tolerance
        and budgeted.allows(plain)
        and plain.seconds * (1 + RERUN_COST * MOST_RERUN) > budgeted.seconds
    ):
        reruns = settling.reruns
    grid = f" at {study.plan.points} points of a grid" if study.plan.points > 1 else ""
    budget.require(
        "the sweep", members, cost, given=f"of {validate.counted(members, 'member')}{grid}",
        fits=lambda most: f"at most {validate.counted(most, 'member')}", what=f"the sweep of "
        f"{validate.counted(members, 'member')}",
    )  # fmt: skip


def _apart(study: Study, *kinds: Kind) -> int:
    """Largest number of members that can't run together because of numbers of these kinds; 0 if no such number varies."""
    if not any(kind in kinds for kind in study.kinds):
        return 0
    axes, draws = study.plan.axes.values(), study.kinds[len(study.plan.axes) :]
    points = math.prod(axis.count for axis, kind in zip(axes, study.kinds, strict=False) if kind in kinds)
    return points * (study.plan.draws_each if any(kind in kinds for kind in draws) else 1)


@dataclass(frozen=True, kw_only=True)
class Costs:
    """The cost of one member of a sweep, measured here: processor time rather than elapsed time, so other programs have little
    effect.

    steps     solver steps, summed over all controllers
    worker    processor time of the worker that simulates the member, including its part of the compilation for a chunk of a
              second or two [s]
    client    processor time for sending the member and for receiving and storing its metrics [s]; one process does this for all
              workers
    sent, returned, stored  bytes sent to a worker, returned from it, and stored on the disk
    tables    bytes of the signals' samples, which are sent to each worker once
    reruns    number of evaluations with finer steps, relative to the plain runs; each costs RERUN_COST times as much as a plain
              one
    settled   fraction of the plan's first members that are settled by the step of the sweep or by an affordable finer step
    """

    steps: int
    worker: float
    client: float
    sent: float
    returned: float
    stored: float
    tables: int
    reruns: float
    settled: float

    @classmethod
    def of(cls, study: Study) -> Costs:
        """Measure a second's work on members of a study; Raises InputError as in a sweep, and if ``barbalat[study]`` is
        missing."""
        require_parquet()
        study.example.simulation.require_steps("a measurement of a sweep's costs")
        settling = Settling(study)
        whole = min(chunk_size(len(study), study.steps), MOST_MEMBERS, len(study))
        count = min(chunk_size(1, study.steps), whole)
        next(study.parts(0, count))  # traces the equations, once
        parts = list(study.parts(0, count))
        tables, given = [Tabulated.of(part) for part in parts], [pickle.dumps(WorkerTask.of(part)) for part in parts]
        begun = time.process_time()
        found = [figures(pickle.loads(sent), tabled) for sent, tabled in zip(given, tables, strict=True)]
        simulated = time.process_time() - begun
        for _ in range(2):  # the first run imports the modules that draw members and write files
            client, size = _handled(study, count, found)
        if client * whole < MEASURING_SECONDS and whole > count:  # fixed costs of a chunk are spread over all its members
            client, _ = _handled(study, whole, found)  # repeated metrics compress better than others
        return cls(
            steps=study.steps,
            worker=simulated / count,
            client=client,
            sent=sum(map(len, given)) / count,
            returned=sum(len(pickle.dumps(one)) for one in found) / count,
            stored=size,
            tables=sum(len(pickle.dumps(one)) for one in tables),
            reruns=settling.reruns,
            settled=settling.settled,
        )

    @property
    def most_workers(self) -> float:
        """The number of cores that one client can keep busy."""
        return self.worker * (1 + RERUN_COST * self.reruns) / self.client

    def chunk(self, members: int) -> int:
        """Number of members in a chunk for a sweep with this number of members."""
        return chunk_size(members, self.steps)


def _handled(study: Study, count: int, found: Sequence[Sequence[Figured]]) -> tuple[float, float]:
    """The client's seconds and the bytes on the disk per member, with metrics repeated from those ``found``."""
    begun = time.process_time()
    parts = list(study.parts(0, count))
    for part in parts:
        pickle.dumps(WorkerTask.of(part))
    seconds = time.process_time() - begun
    many = [[_repeated(one, len(part.which)) for one in found[i % len(found)]] for i, part in enumerate(parts)]
    back, begun = pickle.dumps(many), time.process_time()
    columns = study.columns_for(np.arange(count), parts, pickle.loads(back))
    seconds += time.process_time() - begun
    with tempfile.TemporaryDirectory() as folder, opened(Path(folder) / "store", {}, count, count) as store:
        (chunk,) = store.chunks
        begun = time.process_time()
        store.add(chunk, columns)
        seconds += time.process_time() - begun
        return seconds / count, (store.folder / name_of(chunk)).stat().st_size / count


def _repeated(found: Figured, count: int) -> Figured:
    times, which = -(-count // len(found.kinds)), slice(0, count)
    metrics = Metrics.together([found.metrics] * times).of(which)
    return Figured(metrics, np.tile(found.kinds, times)[which], np.tile(found.finer_by, times)[which])
