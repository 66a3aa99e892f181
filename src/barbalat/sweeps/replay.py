"""One member of a sweep again, alone, with its trajectory: the same bits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from barbalat import validate
from barbalat.budget import Progress
from barbalat.cases.build import Case
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.run.engine.engine import Batch, run
from barbalat.run.engine.simulate import result_of
from barbalat.run.engine.stability_label import MOST_WINDOWS
from barbalat.run.results.result import Result
from barbalat.sweeps.study import Columns, Study, columns_of


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
        return [name for name, value in own.items() if name in stored and not _same(stored[name], value)]


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
        part = None if progress is None else _part(progress, i, len(batches))
        run([batch], setting.signals, case.simulation, threads=threads, progress=part)
    results = tuple(
        replace(result_of(case.problem, controller, case.simulation, batch), metrics=metrics)
        for controller, batch, metrics in zip(case.controllers, batches, plain, strict=True)
    )
    found: Columns = {"member": np.array([member])} | {str(path): row[:, i] for i, path in enumerate(study.plan.paths)}
    for name_of, metrics in zip(study.controllers, plain, strict=True):
        found |= {f"{name_of}/{name}": values for name, values in columns_of(metrics).items()}
    return Replayed(number=member, case=case, results=results, columns=found)


def _part(progress: Progress, i: int, parts: int) -> Progress:
    return lambda fraction: progress((i + fraction) / parts)


def _same(one: float, other: float) -> bool:
    return one == other or (np.isnan(one) and np.isnan(other))
