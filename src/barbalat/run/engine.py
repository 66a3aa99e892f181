"""The time loop: kernels advance groups of members segment by segment, in threads, while the next table is prepared."""

from __future__ import annotations

import os
from concurrent.futures import Future, ThreadPoolExecutor

from barbalat import validate
from barbalat.protocols import Signal
from barbalat.run.batch import Batch
from barbalat.run.grid import Segment, final_row, segments_of, signal_table
from barbalat.run.progress import Progress
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array


def run(
    batches: list[Batch],
    signals: tuple[Signal, ...],
    simulation: Simulation,
    *,
    threads: int | None = None,
    progress: Progress | None = None,
) -> None:
    """Advance all batches from 0 to t_end. Memory does not grow with t_end, except for what a batch records."""
    if threads is not None:
        validate.whole("threads", threads, least=1)
    segments = list(segments_of(simulation, recorded=any(batch.record for batch in batches)))
    groups = [group for batch in batches for group in batch.groups]
    (in_pieces,) = {batch.program.shape.in_pieces for batch in batches}
    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:

        def table(segment: Segment) -> Future[Array]:
            return pool.submit(signal_table, signals, simulation, segment.start, segment.steps, in_pieces=in_pieces)

        following = table(segments[0])
        for i, segment in enumerate(segments):
            current = following.result()
            if i + 1 < len(segments):
                following = table(segments[i + 1])
            if len(groups) == 1:
                groups[0].advance(segment, current)
            else:
                _finish([pool.submit(group.advance, segment, current) for group in groups])
            if progress is not None:
                progress((segment.start + segment.steps) / simulation.steps)
    last = final_row(signals, simulation, in_pieces=in_pieces)
    for group in groups:
        group.finish(simulation.steps, last)


def _finish(pending: list[Future[None]]) -> None:
    """Wait for all of them; what interrupts that, an error or Ctrl-C, does not wait for those that have not begun."""
    try:
        for one in pending:
            one.result()
    except BaseException:
        for one in pending:
            one.cancel()
        raise
