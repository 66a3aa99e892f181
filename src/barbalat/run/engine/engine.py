"""The time loop: kernels advance groups of members segment by segment, in threads, while the next table is prepared."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol

from barbalat import validate
from barbalat.budget import Progress
from barbalat.protocols import Signal
from barbalat.run.engine.batch import Batch, Group
from barbalat.run.kernel.grid import Segment, final_row, segments_of, signal_table
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array


class Tables(Protocol):
    """The signals of a run, by the rows of ``grid.signal_table``."""

    def rows(self, segment: Segment) -> Array:
        """Those of a segment's steps."""
        ...

    def last(self) -> Array:
        """The values at t_end."""
        ...


@dataclass(frozen=True)
class Evaluated:
    """Made while the run goes on, so that memory does not grow with t_end."""

    signals: tuple[Signal, ...]
    simulation: Simulation
    in_pieces: bool

    def rows(self, segment: Segment) -> Array:
        return signal_table(self.signals, self.simulation, segment.start, segment.steps, in_pieces=self.in_pieces)

    def last(self) -> Array:
        return final_row(self.signals, self.simulation, in_pieces=self.in_pieces)


def run(
    batches: list[Batch],
    signals: tuple[Signal, ...],
    simulation: Simulation,
    *,
    threads: int | None = None,
    progress: Progress | None = None,
) -> None:
    """Advance all batches from 0 to t_end. Memory does not grow with t_end, except for what a batch records."""
    (in_pieces,) = {batch.program.shape.in_pieces for batch in batches}
    advance(batches, Evaluated(signals, simulation, in_pieces), simulation, threads=threads, progress=progress)


def advance(
    batches: list[Batch], tables: Tables, simulation: Simulation, *, threads: int | None = None, progress: Progress | None = None
) -> None:
    """The same with signals by their tables."""
    if threads is not None:
        validate.whole("threads", threads, least=1)
    segments = list(segments_of(simulation, recorded=any(batch.record for batch in batches)))
    groups = [group for batch in batches for group in batch.groups]
    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        following = pool.submit(tables.rows, segments[0])
        for i, segment in enumerate(segments):
            current = following.result()
            if i + 1 < len(segments):
                following = pool.submit(tables.rows, segments[i + 1])
            if len(groups) == 1:
                groups[0].advance(segment, current)
            else:
                _finish([pool.submit(_advance, some, segment, current) for some in _tasks(groups, segment)])
            if progress is not None:
                progress((segment.start + segment.steps) / simulation.steps)
    last = tables.last()
    for group in groups:
        group.finish(simulation.steps, last)


TASK_STEPS = 2**14
"""Kernel steps that one task of a pool takes at least where there are groups enough, a millisecond or so: handing it out costs
some 50 us, which members of a tenth of a second would else pay for each group."""


def _tasks(groups: Sequence[Group], segment: Segment) -> Iterator[Sequence[Group]]:
    """All groups, some together where the segment is short."""
    count = max(TASK_STEPS // segment.steps, 1)
    for first in range(0, len(groups), count):
        yield groups[first : first + count]


def _advance(groups: Sequence[Group], segment: Segment, table: Array) -> None:
    for group in groups:
        group.advance(segment, table)


def _finish(pending: list[Future[None]]) -> None:
    """Wait for all of them; what interrupts that, an error or Ctrl-C, does not wait for those that have not begun."""
    try:
        for one in pending:
            one.result()
    except BaseException:
        for one in pending:
            one.cancel()
        raise
