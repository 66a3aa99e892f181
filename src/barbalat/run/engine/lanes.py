"""The lanes of one kernel. Each lane advances a member with individual steps; when the member has ended, the lane takes the next
one."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import lru_cache
from math import inf
from threading import Lock
from typing import Protocol

import numpy as np

from barbalat.budget import Progress, carried
from barbalat.lowering.llvm.machine import Kernel
from barbalat.lowering.operations import Program
from barbalat.lowering.shape import LoopShape
from barbalat.run.engine.motion import LEAST_PROGRESS_AMONG_OTHERS, LOOKED_AT_EVERY, Motion, StalledError
from barbalat.run.kernel.attempt import DIVERGED, STALLED
from barbalat.run.kernel.observed import Observed
from barbalat.run.kernel.past import with_room
from barbalat.run.kernel.step import CompiledLoop
from barbalat.validate import Array

FEWEST_AT_ONCE, MOST_AT_ONCE = 16, 128
"""Attempts per call of the kernel. After each call every lane is examined, which takes as long as about ten attempts; a lane
whose member has ended waits for the end of the call."""


@lru_cache(maxsize=16)
def compiled_lanes(program: Program, begin: Program, shape: LoopShape, lanes: int) -> CompiledLoop:
    """The code of observed attempts."""
    return CompiledLoop(lambda quickly: Kernel(program, shape, (), lanes, begin, quickly=quickly))


@dataclass(eq=False)
class Turns:
    """The queue of M members: each takes the next free lane of any thread."""

    members: int
    progress: Progress | None = None
    _begun: int = 0
    _done: int = 0
    _lock: Lock = field(default_factory=Lock)

    def next(self) -> int | None:
        """The number of the next member to begin; None if all have begun."""
        with self._lock:
            if self._begun == self.members:
                return None
            self._begun += 1
            return self._begun - 1

    def ended(self) -> None:
        """Record that a member has ended."""
        with self._lock:
            self._done += 1
            done = self._done / self.members
        if self.progress is not None:
            self.progress(done)


class Side(Protocol):
    """The members whose motions the lanes of all threads advance."""

    observed: Observed
    turns: Turns

    @property
    def rows(self) -> Array:
        """The rows of pieces that all motions share, unless there is noise."""
        ...

    @property
    def stop(self) -> float:
        """The end of the motions [s]."""
        ...

    def begun(self, number: int) -> tuple[Motion, Array]:
        """The motion of a member, and the column of the kernel's state with which it begins."""
        ...

    def goes_on(self, number: int, motion: Motion, column: Array, records: Array | None) -> bool:
        """Take the results of a member that has paused, ended, diverged or stalled; returns whether it continues, with the
        contents of this column."""
        ...


def advance(side: Side, workers: int, width: int) -> None:
    """Advance all members of the ``Side`` in lanes."""
    each = -(-side.turns.members // workers)
    lanes = [Lanes(side, width, each) for _ in range(min(workers, side.turns.members))]
    if len(lanes) == 1:
        lanes[0].run()
        return
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(carried(Lanes.run), lanes))


@dataclass(eq=False)
class Lanes:
    """The members that one thread advances side by side, at most ``most`` at once; lanes without a member are idle.

    motions   the motions of the members, and their numbers in the batch; None for an idle lane
    attempts  upper bound on the number of attempts of each member so far
    """

    side: Side
    width: int
    most: int
    code: CompiledLoop = field(init=False)
    state: Array = field(init=False)
    parameters: Array = field(init=False)
    rows: Array = field(init=False)
    records: Array | None = None
    motions: list[Motion | None] = field(init=False)
    numbers: list[int] = field(init=False)
    attempts: list[int] = field(init=False)
    _calls: dict[int, Callable[[], None]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        observed, width = self.side.observed, self.width
        self.code = compiled_lanes(*observed.lists, observed.shape, width)
        self.state = np.zeros((observed.size, width))
        self.state[self.row("status")] = DIVERGED
        self.parameters = np.zeros((observed.shape.parameters, width))
        first = self.side.rows
        self.rows = np.zeros((len(first), width, first.shape[1])) if observed.shape.rows_per_member else first
        self.motions, self.numbers, self.attempts = [None] * width, [0] * width, [0] * width

    def row(self, name: str) -> int:
        """The row of a part of the attempts' state."""
        return self.side.observed.row(name)

    def run(self, most: float = inf) -> int:
        """Advance members until none is left, or until each lane has made about ``most`` attempts; return the number of
        attempts."""
        for lane in range(min(self.width, self.most)):
            self._fill(lane)
        count, made = FEWEST_AT_ONCE, 0
        while made < most and any(motion is not None for motion in self.motions):
            self._advance(count)
            made += count
            count = min(2 * count, MOST_AT_ONCE)
            for lane in self._stopped():
                self._look(lane)
        return made

    def _fill(self, lane: int) -> None:
        """Begin the next member in this lane."""
        side = self.side
        number = side.turns.next()
        if number is None:
            self.motions[lane] = None
            self.state[self.row("status"), lane] = DIVERGED
            return
        motion, self.state[:, lane] = side.begun(number)
        self.motions[lane], self.numbers[lane], self.attempts[lane] = motion, number, 0
        delay = [] if motion.delay is None else [motion.delay.time]
        self.parameters[:, lane] = [*motion.parameters, motion.tolerance, *delay]
        if side.observed.shape.rows_per_member:
            self.rows[:, lane] = motion.rows
        if motion.records is not None:
            self._keep(motion.records, lane)

    def _keep(self, records: Array, lane: int) -> None:
        """Store the content of the delay of a member that begins."""
        rows, width = records.shape
        if self.records is None or self.records.shape[1] < rows:
            found = np.zeros((self.width, rows, width))
            if self.records is not None:
                found[:, : self.records.shape[1]] = self.records
            self.records = found
            self._calls.clear()
        self.records[lane, :rows] = records

    def _advance(self, count: int) -> None:
        """Make this number of attempts in every lane."""
        if self.records is not None:
            self._make_room(count)
        kernel = self.code.for_steps(count)
        if count not in self._calls or self._kernel is not kernel:
            self._kernel = kernel
            out = np.empty((1, self.state.size))
            records = None if self.records is None else self.records.reshape(-1, self.records.shape[2])
            self._calls[count] = kernel.bound(
                1, count, self.state, self.parameters, self.rows, out, records=records, sample_every=1
            )
        self._calls[count]()
        for lane in range(self.width):
            self.attempts[lane] += count

    _kernel: Kernel | None = None

    def _make_room(self, count: int) -> None:
        """Make room for the records of further attempts, in place of those that have left the delay."""
        assert self.records is not None
        rows = [self.row("leaving"), self.row("records")]
        first, last = self.state[rows].astype(int)
        found, left = with_room(self.records, first, last, count)
        self.state[rows] -= left
        if found is not self.records:
            self.records = found
            self._calls.clear()

    def _stopped(self) -> list[int]:
        """The lanes whose member has reached its tail or its end, or must be checked for progress."""
        side, state = self.side, self.state
        at = side.observed.places
        settled = (state[at["waits"]][0] == 0) & (state[at["observed"]][0] == 0) & (state[self.row("renew")] == 0)
        arrived = state[self.row("t")] >= np.minimum(state[self.row("pause")], side.stop)
        over = settled & (arrived | (state[self.row("status")] != 0))
        long = np.array(self.attempts) >= LOOKED_AT_EVERY
        return [int(lane) for lane in np.flatnonzero(over | long) if self.motions[lane] is not None]

    def _look(self, lane: int) -> None:
        """Continue or end a member, or check whether it advances."""
        motion, number, side = self.motions[lane], self.numbers[lane], self.side
        assert motion is not None
        motion.state = self.state[: side.observed.attempts.carried.size, lane].copy()
        try:
            self._require_progress(motion, lane)
        except StalledError:
            motion.stop()
        records = None if self.records is None else self.records[lane]
        if not side.goes_on(number, motion, self.state[:, lane], records):
            side.turns.ended()
            self._fill(lane)

    def _require_progress(self, motion: Motion, lane: int) -> None:
        """StalledError for a member that does not advance."""
        motion.rejected += self.attempts[lane]
        self.attempts[lane] = 0
        if motion.state[self.row("status")] == STALLED:
            motion.require_step()
        motion.require_progress(LEAST_PROGRESS_AMONG_OTHERS)
        self.state[self.row("status"), lane] = motion.state[self.row("status")]
