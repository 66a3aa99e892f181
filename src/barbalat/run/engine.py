"""The time loop: kernels advance groups of members segment by segment, in threads, while the next table is prepared."""

from __future__ import annotations

import os
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np

from barbalat import validate
from barbalat.lowering.llvm.machine import Kernel, Past, Watch, vector_width
from barbalat.protocols import Signal
from barbalat.run.delay import PER_INPUT
from barbalat.run.grid import Segment, final_row, segments_of, signal_table
from barbalat.run.metrics import Metrics, Totals
from barbalat.run.noise import standard_normal
from barbalat.run.progress import Progress
from barbalat.run.step import StepProgram
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array


def best_lanes(members: int) -> int:
    """Members in one kernel call: alone, or two vector registers, whose chains of operations then overlap."""
    if members == 1:
        return 1
    return min(2 * vector_width(), 1 << (members - 1).bit_length())


@dataclass(eq=False)
class Batch:
    """Members of one structure: the same step program, each with its own initial state and parameters.

    states (size, M), parameters (p, M); lags (M,) for a step with a delay, see ``delay.lag``, and history (m, M), what each of
    its m inputs was before t = 0, zero unless given; seeds (M,) and numbers (M,) for one with noise: which stream each member
    has, 0 ... M - 1 unless given.
    ``record`` keeps every block's start state and accumulators; ``watch`` goes with a program that watches, of one member.
    """

    program: StepProgram
    states: Array
    parameters: Array
    record: bool = False
    lanes: int | None = None
    lags: Array | None = None
    history: Array | None = None
    seeds: Array | None = None
    numbers: Array | None = None
    watch: Watch | None = None
    totals: Totals = field(init=False)
    groups: list[Group] = field(init=False)

    def __post_init__(self) -> None:
        assert self.program.accumulators is not None
        members = self.states.shape[1]
        width = self.lanes or best_lanes(members)
        self.totals = Totals(self.program.accumulators, members)
        kernel = self.program.compile(width)
        self.groups = []
        for first in range(0, members, width):
            index = np.minimum(np.arange(first, first + width), members - 1)  # the last group repeats the last member
            columns = slice(first, min(first + width, members))
            state, parameters = (np.ascontiguousarray(part_of[:, index]) for part_of in (self.states, self.parameters))
            past = None if self.lags is None else self._past(index)
            numbers = np.arange(members) if self.numbers is None else self.numbers
            streams = None if self.seeds is None else [(int(self.seeds[i]), int(numbers[i])) for i in index]
            self.groups.append(Group(self, kernel, columns, state, parameters, past, streams, self.watch))

    def _past(self, index: Array) -> Past:
        assert self.lags is not None
        inputs = self.program.shape.delayed // PER_INPUT
        given = np.zeros((inputs, self.states.shape[1])) if self.history is None else self.history
        return Past(self.lags[index], np.repeat(given, PER_INPUT, axis=0)[:, index])

    @property
    def final_states(self) -> Array:
        return np.concatenate([g.state[:, : g.columns.stop - g.columns.start] for g in self.groups], axis=1)

    def metrics(self, simulation: Simulation, theta_hat_rows: slice) -> Metrics:
        return self.totals.metrics(simulation, self.final_states[theta_hat_rows])


@dataclass(eq=False)
class Group:
    """As many members as the kernel has lanes."""

    batch: Batch
    kernel: Kernel
    columns: slice
    state: Array
    parameters: Array
    past: Past | None
    streams: list[tuple[int, int]] | None  # seed and number of each member: its noise
    watch: Watch | None
    recorded: list[Array] = field(default_factory=list)

    def advance(self, segment: Segment, table: Array) -> None:
        if not np.isnan(self.batch.totals.diverged_step[self.columns]).any():
            return  # every member has diverged
        out = self.call(segment.start, segment.blocks, segment.length, self.state, table)
        self.batch.totals.merge(segment, out[:, self.batch.program.shape.states :], self.columns)
        if self.batch.record:
            self.recorded.append(out)

    def finish(self, steps: int, row: Array) -> None:
        """The outputs at t_end, after all ``steps``: one more step whose end state is thrown away."""
        out = self.call(steps, 1, 1, self.state.copy(), row)
        self.batch.totals.merge_final(out[0, self.batch.program.shape.states :], self.columns)

    def call(self, start: int, blocks: int, length: int, state: Array, table: Array) -> Array:
        shape = self.batch.program.shape
        out = np.empty((blocks, shape.states + shape.accumulators, self.state.shape[1]))
        noise = self._noise(start, blocks * length)
        self.kernel(blocks, length, state, self.parameters, table, out, self.past, noise, self.watch, start=start)
        return out[:, :, : self.columns.stop - self.columns.start]

    def _noise(self, start: int, steps: int) -> Array | None:
        """The rows of every member's noise that these steps need, (rows, channels, W)."""
        if self.streams is None:
            return None
        shape = self.batch.program.shape
        first, last = start // shape.noise_hold, (start + steps - 1) // shape.noise_hold
        streams = [standard_normal(*stream, first, last - first + 1, shape.noise) for stream in self.streams]
        return np.ascontiguousarray(np.stack(streams, axis=2))


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
    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:

        def table(segment: Segment) -> Future[Array]:
            return pool.submit(signal_table, signals, simulation, segment.start, segment.steps)

        following = table(segments[0])
        for i, segment in enumerate(segments):
            current = following.result()
            if i + 1 < len(segments):
                following = table(segments[i + 1])
            if len(groups) == 1:
                groups[0].advance(segment, current)
            else:
                for done in [pool.submit(group.advance, segment, current) for group in groups]:
                    done.result()
            if progress is not None:
                progress((segment.start + segment.steps) / simulation.steps)
    last = final_row(signals, simulation)
    for group in groups:
        group.finish(simulation.steps, last)
