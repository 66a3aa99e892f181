"""Runs and continuations of variable-step members in the lanes of one kernel, each with individual steps."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import inf

import numpy as np

from barbalat.budget import Progress
from barbalat.judge.memory import Begins
from barbalat.lowering.llvm.machine import vector_width
from barbalat.run.engine.continued import Continued, Continuing, Seen
from barbalat.run.engine.engine import Group
from barbalat.run.engine.lanes import Lanes, Turns, advance
from barbalat.run.engine.motion import Delay, Motion, Nodes, StalledError, compiled_attempts
from barbalat.run.engine.observed_group import ObservedBatch, ObservedGroup
from barbalat.run.kernel.grid import Segment
from barbalat.run.kernel.members import Members
from barbalat.run.kernel.observed import Observed
from barbalat.run.kernel.past import SAME_INSTANT
from barbalat.run.kernel.pieces import Pieces
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

COUNTED = 200_000
"""Number of attempts (about half a second) from which the attempts of a whole run are extrapolated."""


def run_members(
    members: Members,
    which: slice,
    *,
    threads: int | None = None,
    lanes: int | None = None,
    progress: Progress | None = None,
) -> ObservedBatch:
    """Some of the members after their runs.

    The results are bit-identical for any number of threads and lanes, and do not depend on other members. A member that stalls
    has no metrics.
    """
    workers = threads or os.cpu_count() or 1
    runs = Runs(members, which, workers, lanes or vector_width(), progress)
    runs.advance()
    return runs.batch


def expected_attempts(members: Members) -> float:
    """The attempts that the first member's run takes, extrapolated from the first ``COUNTED`` attempts if it takes more."""
    runs = Runs(members, slice(0, 1), 1, vector_width())
    lanes = Lanes(runs, runs.width, 1)
    made = lanes.run(COUNTED)
    share = 1.0 if lanes.motions[0] is None else lanes.state[lanes.row("t"), 0] / members.simulation.t_end
    return float(made / share)


@dataclass(eq=False)
class Runs:
    """The runs of some members, whose lanes have this ``width``, in as many threads as there are ``workers``."""

    members: Members
    which: slice
    workers: int
    width: int
    progress: Progress | None = None
    batch: MembersBatch = field(init=False)
    observed: Observed = field(init=False)
    turns: Turns = field(init=False)

    def __post_init__(self) -> None:
        members, which = self.members, self.which
        assert members.observed is not None
        states, parameters = members.states[:, which], members.parameters[:, which]
        self.batch = MembersBatch(
            members.loop, members.program, states, parameters, lanes=1, steps=inf, remembered=members.remembered, runs=self
        )
        self.observed = members.observed
        self.turns = Turns(len(self.batch.groups), self.progress)

    def advance(self) -> None:
        """Run from 0 to t_end."""
        advance(self, self.workers, self.width)

    @cached_property
    def grid(self) -> Simulation:
        return self.members.simulation.grid

    @property
    def stop(self) -> float:
        return self.grid.t_end

    @cached_property
    def tail(self) -> float:
        """The beginning of the tail [s]."""
        return float(self.grid.time(self.grid.tail_start))

    @cached_property
    def first(self) -> Motion:
        """The motion of the first member, whose pieces all members share unless there is noise."""
        return motion_of_member(self.members, self.which.start)

    @property
    def rows(self) -> Array:
        return self.first.rows

    def begun(self, number: int) -> tuple[Motion, Array]:
        """See ``Side``: at t = 0."""
        like = self.first if self.members.seeds is None else None
        motion = motion_of_member(self.members, self.which.start + number, like)
        column = self.observed.initial(motion.state)
        column[self.observed.row("pause")] = self.tail
        return motion, column

    def goes_on(self, number: int, motion: Motion, column: Array, records: Array | None) -> bool:
        """See ``Side``. Changes from the head to the tail."""
        if motion.diverged or motion.stalled or motion.t >= self.stop:
            self._end(number, motion, column, records)
            return False
        if motion.t >= column[self.observed.row("pause")]:
            self._begin_tail(number, motion, column)
        return True

    def _begin_tail(self, number: int, motion: Motion, column: Array) -> None:
        """Store the metrics so far and begin those of the tail."""
        at = self.observed.places
        group = self._group(number, motion, column)
        self._merge(number, column, in_tail=False)
        group.before_tail = group.renew(Begins.TAIL)
        column[at["kept"]] = group.state[self.batch.loop.size :, 0]
        accumulators = self.batch.program.accumulators
        assert accumulators is not None
        column[at["figures"]] = accumulators.resets
        column[at["apart"]] = 1.0
        column[self.observed.row("pause")] = np.inf

    def _group(self, number: int, motion: Motion, column: Array) -> ObservedGroup:
        """The member's group, with its present state."""
        group = self.batch.groups[number]
        if not isinstance(group, ObservedGroup):
            group = self.batch.groups[number] = ObservedGroup.of(group, motion)
        loop, at = self.batch.loop, self.observed.places
        last = column[at["x"]] if loop.sampled else motion.x  # without a sample that is due now
        group.state[: loop.size, 0], group.state[loop.size :, 0] = last, column[at["kept"]]
        return group

    def _merge(self, number: int, column: Array, *, in_tail: bool) -> None:
        """Add the metrics of the head or of the tail to the member's."""
        totals, grid = self.batch.totals, self.grid
        begin, end = (grid.tail_start, grid.steps) if in_tail else (0, grid.tail_start)
        whole = column[self.observed.places["figures"]].copy()
        whole[totals.at["good", "steps"]] = (end - begin) * whole[totals.at["good", "alive"]]
        totals.merge(Segment(begin, 1, end - begin, in_tail), whole[None, :, None], slice(number, number + 1))

    def _end(self, number: int, motion: Motion, column: Array, records: Array | None) -> None:
        """The member's results, and its group at the end of the motion."""
        grid, group = self.grid, self._group(number, motion, column)
        self._merge(number, column, in_tail=group.before_tail is not None)
        self.batch.stalled[number] = motion.stalled
        if motion.diverged or motion.stalled:
            instants = grid.time(np.arange(grid.steps + 1)) * (1 - SAME_INSTANT)
            self.batch.totals.diverged_step[number] = np.searchsorted(instants, motion.t, side="right")
        motion.state[self.observed.row("pause")] = np.inf
        motion.take(records)
        nodes = Nodes(motion, grid, self.members.signals, grid.steps, grid.steps)
        group.finish(grid.steps, nodes.final(float(column[self.observed.places["before"]][0])))
        group.motion = motion.ended()


@dataclass(eq=False)
class MembersBatch(ObservedBatch):
    """The batch of ``runs``, whose members also continue in lanes."""

    runs: Runs = field(kw_only=True)

    def together(self, groups: Sequence[Group]) -> Sequence[Continuing]:
        """See ``Batch.together``."""
        return [BesideEachOther(self, np.array([group.columns.start for group in groups]))] if groups else []


@dataclass(frozen=True, eq=False)
class BesideEachOther:
    """The members of a batch with these numbers."""

    batch: MembersBatch
    columns: Array

    def continued(self, simulation: Simulation, held: Array) -> ContinuedMembers:
        """See ``Continuing``."""
        return ContinuedMembers(self.batch, self.columns, simulation, held, simulation.steps)


@dataclass(eq=False)
class ContinuedMembers:
    """Members of a batch that continue in lanes, with commands and disturbances held and without measurement noise; ``groups``
    contains those that have continued, by their numbers in ``columns``."""

    batch: MembersBatch
    columns: Array
    simulation: Simulation
    held: Array
    step: int
    groups: dict[int, ObservedGroup] = field(default_factory=dict)

    def copied(self) -> ContinuedMembers:
        """See ``Continuation``."""
        return replace(self, groups={i: group.independent_copy() for i, group in self.groups.items()})

    def window(self, steps: int, members: Array) -> Seen:
        """See ``Continuation``."""
        memory, runs, size = self.batch.program.memory, self.batch.runs, self.batch.loop.size
        assert memory is not None
        at, shape = memory.places, (len(self.columns), memory.inputs)
        for i in members:
            if i not in self.groups:
                ended = self.batch.groups[int(self.columns[i])]
                assert isinstance(ended, ObservedGroup)
                self.groups[int(i)] = ended.independent_copy()
        chosen = [self.groups[int(i)] for i in members]
        before = np.array([group.renew(Begins.WINDOW)[at["reversals"], 0] for group in chosen])
        self.step += steps
        side = Window(runs.observed, chosen, self.held, float(self.simulation.time(self.step)), Turns(len(chosen)))
        advance(side, runs.workers, runs.width)
        low, high, turned = (np.full(shape, np.nan) for _ in range(3))
        largest, lost = np.full((shape[0], self.batch.loop.errors), np.nan), np.zeros(shape[0], dtype=bool)
        after = np.array([group.state[size:, 0] for group in chosen])
        low[members], high[members], largest[members] = (after[:, at[name]] for name in ("low", "high", "largest y"))
        turned[members], lost[members] = after[:, at["reversals"]] - before, side.lost
        self.batch.stalled[self.columns[members]] |= np.array([one.motion is not None and one.motion.stalled for one in chosen])
        return Seen(low, high, turned, lost, largest)

    def traced(self, steps: int, samples: int, members: Array) -> tuple[Array, Array]:
        """See ``Continuation``. Members are computed one after another; NaN for a member that stalls."""
        memory = self.batch.program.memory
        assert memory is not None
        t, found, only = np.zeros(1), dict[int, Array](), np.zeros(1, dtype=int)
        for i in members:
            alone = Continued(self.groups[int(i)], self.simulation, self.held, self.step)
            try:
                t, found[int(i)] = alone.traced(steps, samples, only)
            except StalledError:
                self.batch.stalled[self.columns[i]] = True
        unknown = np.full((len(t), 1, memory.inputs), np.nan)
        return t, np.concatenate([found.get(int(i), unknown) for i in members], axis=1)


@dataclass(eq=False)
class Window:
    """A window of the continuation of these groups, up to ``stop`` [s], with the signals held at these values."""

    observed: Observed
    groups: Sequence[ObservedGroup]
    held: Array
    stop: float
    turns: Turns
    lost: Array = field(init=False)

    def __post_init__(self) -> None:
        self.lost = np.zeros(len(self.groups), dtype=bool)

    @cached_property
    def rows(self) -> Array:
        """See ``Side``."""
        return self._motion(0).held(self.held, self.stop).rows

    def _motion(self, number: int) -> Motion:
        motion = self.groups[number].motion
        assert motion is not None
        return motion

    def begun(self, number: int) -> tuple[Motion, Array]:
        """See ``Side``."""
        group, motion, size = self.groups[number], self._motion(number).along(self.rows), self.observed.attempts.loop.size
        column = self.observed.initial(motion.state)
        column[self.observed.places["kept"]] = group.state[size:, 0]
        return replace(motion, pieces=replace(motion.pieces, noise=None)), column

    def goes_on(self, number: int, motion: Motion, column: Array, records: Array | None) -> bool:
        """See ``Side``."""
        if not (motion.diverged or motion.stalled) and motion.t < self.stop:
            return True
        group, size = self.groups[number], self.observed.attempts.loop.size
        group.state[:size, 0], group.state[size:, 0] = motion.x, column[self.observed.places["kept"]]
        self.lost[number] = motion.diverged or motion.stalled
        motion.take(records)
        group.motion = motion
        return False


def motion_of_member(members: Members, i: int, like: Motion | None = None) -> Motion:
    """The motion of member ``i``, numbered from 0, at t = 0; ``like`` is a motion with the same pieces."""
    simulation, attempts = members.simulation, members.attempts
    assert attempts is not None
    assert simulation.tolerance is not None
    start, parameters, delay = members.states[:, i].copy(), members.parameters[:, i].copy(), None
    if members.delays is not None and members.history is not None:
        delay = Delay(float(members.delays[i]), members.history[:, i])
    if like is not None:
        return replace(like, start=start, parameters=parameters, delay=delay).again(simulation.tolerance, simulation.t_end)
    noise = None if members.problem is None else members.problem.noise
    own = None if noise is None or members.seeds is None else replace(noise, seed=int(members.seeds[i]))
    code = compiled_attempts(*attempts.lists, attempts.shape)
    return Motion.begun(
        Pieces(attempts, own, int(members.numbers[i])), code, start, parameters, simulation, simulation.tolerance, delay
    )
