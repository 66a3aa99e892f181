"""Continues members after the end of their run, with commands and disturbances held and without measurement noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from barbalat.judge.memory import Begins
from barbalat.run.kernel.grid import CHUNK_STEPS
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

if TYPE_CHECKING:
    from barbalat.run.engine.engine import Group


class Seen(NamedTuple):
    """The observations of some members in a window: (M, m) per control, (M,) whether the members diverged, and (M, n) the largest
    magnitudes of the components."""

    low: Array
    high: Array
    reversals: Array
    lost: Array
    largest: Array

    @classmethod
    def together(cls, pieces: Sequence[Seen]) -> Seen:
        """The observations of the window that these pieces form; reversals between two pieces are not counted."""
        low, high, reversals, lost, largest = zip(*pieces, strict=True)
        ends = np.min(low, axis=0), np.max(high, axis=0)
        return cls(*ends, np.sum(reversals, axis=0), np.any(lost, axis=0), np.max(largest, axis=0))


class Continuation(Protocol):
    """M members that continue in windows; ``members`` are numbers from 0 to M - 1."""

    def copied(self) -> Continuation:
        """A copy that continues independently."""
        ...

    def window(self, steps: int, members: Array) -> Seen:
        """Continue for this number of steps; only these ``members`` must be observed."""
        ...

    def traced(self, steps: int, samples: int, members: Array) -> tuple[Array, Array]:
        """About ``samples`` instants (K,) [s] over this number of steps, with the farthest point of each control of these
        ``members``, (K, len(members), m)."""
        ...


class Continuing(Protocol):
    """The members with the numbers ``columns`` of a batch, which continue together."""

    @property
    def columns(self) -> slice | Array: ...

    def continued(self, simulation: Simulation, held: Array) -> Continuation:
        """The continuation of the members from the end of the run, with the signals held at these values; the members are
        unchanged."""
        ...


@dataclass(eq=False)
class Continued:
    """Continues a group after the end of its run, with commands and disturbances held and without measurement noise."""

    group: Group
    simulation: Simulation
    held: Array
    step: int

    @classmethod
    def of(cls, group: Group, simulation: Simulation, held: Array) -> Continued:
        """The continuation from the end of the group's run; the group is unchanged."""
        return cls(replace(group, recorded=[], quiet=True), simulation, held, simulation.steps).copied()

    def copied(self) -> Continued:
        """A copy that continues independently."""
        return replace(self, group=self.group.independent_copy())

    def window(self, steps: int, _members: Array) -> Seen:
        """See ``Continuation.window``: all members advance together."""
        group, memory = self.group, self.group.batch.program.memory
        assert memory is not None
        own, shape = group.batch.loop.size, group.batch.program.shape
        before, good = group.renew(Begins.WINDOW), 0.0
        done = 0
        while done < steps:
            count = min(CHUNK_STEPS, steps - done)
            if group.watch is not None:
                group.watch = group.watch.elsewhere(self.step, self.step + count)
            out = group.call(self.step, 1, count, group.state, self._table(count))
            good = good + out[0, shape.states + group.batch.totals.at["good", "steps"].start]
            self.step, done = self.step + count, done + count
        columns = slice(0, group.columns.stop - group.columns.start)
        after = group.state[own:, columns].copy()
        rows = memory.places
        turned = after[rows["reversals"]] - before[rows["reversals"], columns]
        ends = after[rows["low"]].T, after[rows["high"]].T
        return Seen(*ends, turned.T, np.asarray(good < steps), after[rows["largest y"]].T)

    def traced(self, steps: int, samples: int, members: Array) -> tuple[Array, Array]:
        """See ``Continuation.traced``."""
        group, memory = self.group, self.group.batch.program.memory
        assert memory is not None
        own, (farthest, direction) = group.batch.loop.size, (memory.places[name] for name in ("farthest", "direction"))
        length = min(max(steps // max(samples, 1), 1), CHUNK_STEPS)
        blocks, found = steps // length, []
        first, per_call = self.step, CHUNK_STEPS // length
        for begin in range(0, blocks, per_call):
            count = min(per_call, blocks - begin)
            if group.watch is not None:
                group.watch = group.watch.elsewhere(self.step, self.step + count * length)
            out = group.call(self.step, count, length, group.state, self._table(count * length))
            kept = out[:, own:]
            found.append((kept[:, farthest] * kept[:, direction]).transpose(0, 2, 1)[:, members])
            self.step += count * length
        return self.simulation.time(first + length * np.arange(blocks)), np.concatenate(found)

    def _table(self, count: int) -> Array:
        return self.group.held_rows(self.simulation, self.step, count, self.held)
