"""Members that share a kernel, and the time loop that advances them in threads while the next table of signals is computed."""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from math import inf

import numpy as np

from barbalat import validate
from barbalat.budget import Progress
from barbalat.judge.appended import Watched
from barbalat.judge.memory import Begins
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.lowering.llvm.machine import Kernel, Rings, Watch, vector_width
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller, Signal
from barbalat.run.engine.continued import Continuation, Continued, Continuing
from barbalat.run.kernel.delay import CHANNELS_PER_INPUT
from barbalat.run.kernel.grid import WHOLE_STEP, Segment, final_row, segments_of, signal_table
from barbalat.run.kernel.members import Members
from barbalat.run.kernel.metrics import Metrics, Totals
from barbalat.run.kernel.portable import standard_normal
from barbalat.run.kernel.step import PLAIN_RHYTHM, Rhythm, StepProgram
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array


def best_lanes(members: int) -> int:
    """Members in one kernel call: one, or two vector registers, so that chains of operations overlap."""
    if members == 1:
        return 1
    return min(2 * vector_width(), 1 << (members - 1).bit_length())


@dataclass(frozen=True, eq=False)
class Blocks:
    """The record of B blocks for M members, up to the last block that any member reached.

    starts, lengths  (B,) in steps
    states           (B, size, M) at each block's start; NaN once all members of a kernel's call have diverged
    accumulators     (B, accumulators, M) over each block's steps; NaN in the same case
    memory           (B, rows, M) the judge's memory at each block's start; NaN in the same case
    """

    starts: Array
    lengths: Array
    states: Array
    accumulators: Array
    at: dict[tuple[str, str], slice]
    memory: Array

    def figure(self, quantity: str, operation: str) -> Array:
        """(B, entries, M) accumulators by name, see ``Accumulators``."""
        return self.accumulators[:, self.at[quantity, operation]]


@dataclass(eq=False)
class Batch:
    """Members of one structure: the same step program, with different initial states and parameters.

    loop     the loop of the first member; states (size, M), parameters (p, M)
    lags     (M,) for a step with a delay, see ``delay.lag``, and history (m, M), the value of each of its m inputs before t = 0
    seeds    (M,) and numbers (M,) for a step with noise: the stream of each member, 0 ... M - 1 by default
    record   keep every block's initial state and accumulators
    watch    the windows of a program with a monitored quantity
    steps    number of steps of the whole run
    """

    loop: ClosedLoop
    program: StepProgram
    states: Array
    parameters: Array
    rhythm: Rhythm = PLAIN_RHYTHM
    record: bool = False
    lanes: int | None = None
    lags: Array | None = None
    history: Array | None = None
    seeds: Array | None = None
    numbers: Array | None = None
    watch: Watch | None = None
    steps: float = inf
    totals: Totals = field(init=False)
    groups: list[Group] = field(init=False)

    @classmethod
    def of(
        cls,
        members: Sequence[tuple[TrackingProblem, Controller]],
        simulation: Simulation,
        *,
        record: bool = False,
        lanes: int | None = None,
        windows: int = 0,
        adjustable: bool = False,
        watched: Watched | None = None,
    ) -> Batch:
        """All these members (see ``Members``) in one batch."""
        read = Members.read(members, simulation, windows=windows, adjustable=adjustable, watched=watched)
        return cls.part(read, slice(0, len(read)), record=record, lanes=lanes)

    @classmethod
    def part(cls, members: Members, which: slice, *, record: bool = False, lanes: int | None = None) -> Batch:
        """Some of the members; their results do not depend on the others and are bit-identical. Raises InputError for
        variable-step members."""
        members.simulation.require_steps("a batch of fixed-step runs")
        some = members.some(which)
        return cls(
            some.loop,
            some.program,
            some.states,
            some.parameters,
            some.rhythm,
            record=record,
            lanes=lanes or best_lanes(len(members)),
            lags=some.lags,
            history=some.history,
            seeds=some.seeds,
            numbers=some.numbers,
            watch=some.watch(),
            steps=some.simulation.steps,
        )

    def __post_init__(self) -> None:
        assert self.program.accumulators is not None
        members = self.states.shape[1]
        width = self.lanes or best_lanes(members)
        self.totals = self.program.accumulators.totals(members)
        kernel = self.program.compile(width, self.steps * -(-members // width))
        self.groups = []
        for first in range(0, members, width):
            index = np.minimum(np.arange(first, first + width), members - 1)  # the last group repeats the last member
            columns = slice(first, min(first + width, members))
            state = np.ascontiguousarray(np.vstack([self.states[:, index], *self._unjudged(width)]))
            parameters = np.ascontiguousarray(self.parameters[:, index])
            past = None if self.lags is None else self._past(index)
            numbers = np.arange(members) if self.numbers is None else self.numbers
            streams = None if self.seeds is None else [(int(self.seeds[i]), int(numbers[i])) for i in index]
            self.groups.append(Group(self, kernel, columns, state, parameters, past, streams, self._watching(width)))

    def _watching(self, width: int) -> Watch | None:
        """A watch for one group; a single member uses the batch's watch."""
        given = self.watch if self.program.watches(width) else None
        if given is None or self.states.shape[1] == 1:
            return given
        return Watch(given.states, given.first, given.stop, given.window, width)

    def _unjudged(self, width: int) -> list[Array]:
        """The judge's memory before the first sample, (rows, W)."""
        memory = self.program.memory
        return [] if memory is None else [np.array(memory.begins)[:, None].repeat(width, axis=1)]

    def _past(self, index: Array) -> Rings:
        assert self.lags is not None
        inputs = self.program.shape.delayed // CHANNELS_PER_INPUT
        given = np.zeros((inputs, self.states.shape[1])) if self.history is None else self.history
        return Rings(self.lags[index], np.repeat(given, CHANNELS_PER_INPUT, axis=0)[:, index])

    @property
    def final_states(self) -> Array:
        """The final states of all members, (size, M)."""
        return np.concatenate([g.state[: self.loop.size, : g.columns.stop - g.columns.start] for g in self.groups], axis=1)

    @property
    def diverged_step(self) -> Array:
        """(M,) the step at which each member left the bounded region; NaN if it did not."""
        return self.totals.diverged_step

    def metrics(self, simulation: Simulation) -> Metrics:
        return self.totals.metrics(simulation, self.final_states[self.loop.theta_hat_rows])

    def blocks(self, simulation: Simulation) -> Blocks:
        """The record of the run made with ``simulation``."""
        kept = [np.concatenate(group.recorded) for group in self.groups]
        count = max(len(blocks) for blocks in kept)
        padded = [np.pad(b, ((0, count - len(b)), (0, 0), (0, 0)), constant_values=np.nan) if len(b) < count else b for b in kept]
        together = padded[0] if len(padded) == 1 else np.concatenate(padded, axis=2)
        cut = list(segments_of(simulation, recorded=True))
        starts = np.concatenate([s.start + np.arange(s.blocks) * s.length for s in cut])
        lengths = np.repeat([s.length for s in cut], [s.blocks for s in cut])
        states, own = self.program.shape.states, self.loop.size
        return Blocks(
            starts[:count], lengths[:count], together[:, :own], together[:, states:], self.totals.at, together[:, own:states]
        )

    def together(self, groups: Sequence[Group]) -> Sequence[Continuing]:
        """These groups, arranged for fast continuations."""
        return groups

    def resumed(self, state: Array) -> Group:
        """The single member, starting from this state (size,) with an empty delay buffer. With a delay this is possible only
        at t = 0."""
        (group,) = self.groups
        past = None if group.past is None else Rings(group.past.lags, group.past.history)
        return replace(group, state=np.vstack([state[:, None], *self._unjudged(1)]), past=past, recorded=[])


@dataclass(eq=False)
class Group:
    """The members of one kernel call, as many as the kernel has lanes.

    quiet        whether to omit the measurement noise
    before_tail  (rows, W) the judge's memory of the run before its tail, and ``judged`` its memory of the whole run; None until
                 known
    """

    batch: Batch
    kernel: Kernel
    columns: slice
    state: Array
    parameters: Array
    past: Rings | None
    streams: list[tuple[int, int]] | None  # seed and number of each member, for its noise
    watch: Watch | None
    recorded: list[Array] = field(default_factory=list)
    quiet: bool = False
    before_tail: Array | None = None
    judged: Array | None = None

    def advance(self, segment: Segment, table: Array) -> None:
        if not np.isnan(self.batch.totals.diverged_step[self.columns]).any():
            return  # every member has diverged
        if segment.in_tail and self.before_tail is None:
            self.before_tail = self.renew(Begins.TAIL)
        out = self.call(segment.start, segment.blocks, segment.length, self.state, table)
        self.batch.totals.merge(segment, out[:, self.batch.program.shape.states :], self.columns)
        if self.batch.record:
            self.recorded.append(out)

    def finish(self, steps: int, row: Array) -> None:
        """The outputs at t_end, after all ``steps``, by one more step whose end state is discarded."""
        state = self.at_end()
        out = self.call(steps, 1, 1, state, row)
        self.batch.totals.merge_final(out[0, self.batch.program.shape.states :], self.columns)
        own, memory = self.batch.loop.size, self.batch.program.memory
        self.judged = state[own:]
        if memory is not None:
            self.judged[memory.responses] = self.state[own:][memory.responses]

    def at_end(self) -> Array:
        """A copy of the state, (rows, W), with which the step at t_end begins."""
        return self.state.copy()

    def renew(self, at: Begins) -> Array:
        """Return the judge's memory so far, (rows, W), and restart the parts for the tail or a window."""
        own, memory = self.batch.loop.size, self.batch.program.memory
        before = self.state[own:].copy()
        if memory is not None:
            rows = np.array(memory.renewed(at))
            self.state[own + rows] = np.array(memory.begins)[rows, None]
        return before

    def independent_copy(self) -> Group:
        """A copy of the group at the same step that continues independently, with the same watch."""
        return replace(self, state=self.state.copy(), past=copy.deepcopy(self.past))

    def continued(self, simulation: Simulation, held: Array) -> Continuation:
        """See ``Continuing``."""
        return Continued.of(self, simulation, held)

    def held_rows(self, simulation: Simulation, step: int, steps: int, values: Array) -> Array:
        """Rows of signals, as returned by ``grid.signal_table``, held at ``values``. NaN is replaced by the time, which
        continues."""
        nodes = simulation.solver.nodes
        held = np.tile(values, (steps, len(nodes), 1))
        if np.isnan(values).any():
            numbers = np.arange(step, step + steps)[:, None] + np.array(nodes)
            held[:, :, np.isnan(values)] = simulation.time(numbers)[:, :, None]
        rows = held.reshape(steps, -1)
        return np.column_stack([rows, np.tile(WHOLE_STEP, (steps, 1))]) if self.batch.program.shape.in_pieces else rows

    def call(self, start: int, blocks: int, length: int, state: Array, table: Array) -> Array:
        shape, rhythm = self.batch.program.shape, self.batch.rhythm
        out = np.empty((blocks, shape.states + shape.accumulators, self.state.shape[1]))
        arrays = (state, self.parameters, table, out, self.past, self._noise(start, blocks * length), self.watch)
        self.kernel(blocks, length, *arrays, start=start, sample_every=rhythm.sample_every, noise_hold=rhythm.noise_hold)
        return out[:, :, : self.columns.stop - self.columns.start]

    def _noise(self, start: int, steps: int) -> Array | None:
        """The rows of every member's noise for these steps, (rows, channels, W)."""
        if self.streams is None:
            return None
        hold, channels = self.batch.rhythm.noise_hold, self.batch.program.shape.noise
        first, last = start // hold, (start + steps - 1) // hold
        if self.quiet:
            return np.zeros((last - first + 1, channels, self.state.shape[1]))
        streams = [standard_normal(*stream, first, last - first + 1, channels) for stream in self.streams]
        return np.ascontiguousarray(np.stack(streams, axis=2))


def run(
    batches: list[Batch],
    signals: tuple[Signal, ...],
    simulation: Simulation,
    *,
    threads: int | None = None,
    progress: Progress | None = None,
) -> None:
    """Advance all batches from 0 to t_end. Memory grows with t_end only if a batch is recorded."""
    (in_pieces,) = {batch.program.shape.in_pieces for batch in batches}

    def rows(segment: Segment) -> Array:
        return signal_table(signals, simulation, segment.start, segment.steps, in_pieces=in_pieces)

    def last() -> Array:
        return final_row(signals, simulation, in_pieces=in_pieces)

    advance(batches, rows, last, simulation, threads=threads, progress=progress)


def advance(
    batches: list[Batch],
    rows: Callable[[Segment], Array],
    last: Callable[[], Array],
    simulation: Simulation,
    *,
    threads: int | None = None,
    progress: Progress | None = None,
) -> None:
    """Advance all batches from 0 to t_end, with the signals given by the rows of ``grid.signal_table``.

    rows  the rows of a segment's steps
    last  the row at t_end, see ``grid.final_row``
    """
    if threads is not None:
        validate.whole("threads", threads, least=1)
    segments = list(segments_of(simulation, recorded=any(batch.record for batch in batches)))
    groups = [group for batch in batches for group in batch.groups]
    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        following = pool.submit(rows, segments[0])
        for i, segment in enumerate(segments):
            current = following.result()
            if i + 1 < len(segments):
                following = pool.submit(rows, segments[i + 1])
            if len(groups) == 1:
                groups[0].advance(segment, current)
            else:
                at_once = max(TASK_STEPS // segment.steps, 1)  # groups in a task
                tasks = [groups[first : first + at_once] for first in range(0, len(groups), at_once)]
                _finish([pool.submit(_advance, some, segment, current) for some in tasks])
            if progress is not None:
                progress((segment.start + segment.steps) / simulation.steps)
    final = last()
    for group in groups:
        group.finish(simulation.steps, final)


TASK_STEPS = 2**14
"""Smallest number of kernel steps in a task of a pool, about a millisecond, if there are enough groups. Starting a task takes
about 50 us, which would otherwise be added for each group with a short run."""


def _advance(groups: Sequence[Group], segment: Segment, table: Array) -> None:
    for group in groups:
        group.advance(segment, table)


def _finish(pending: list[Future[None]]) -> None:
    """Wait for all tasks; an error or Ctrl-C does not wait for those that have not started."""
    try:
        for one in pending:
            one.result()
    except BaseException:
        for one in pending:
            one.cancel()
        raise
