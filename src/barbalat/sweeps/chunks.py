"""Members in pieces: what a store's files hold at most, and what is run at once so that it takes a second or so."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

CHUNK_WORK = 2 * 10**8
"""Solver steps of all members of a chunk: two seconds of one core, at some 10 ns for a small loop."""
FEWEST_MEMBERS, MOST_MEMBERS = 32, 2**16
"""Members of a chunk: two kernel calls at least, and at most some 30 MB of columns."""
MOST_CHUNKS = 4096
"""Of a sweep: its index, some hundred bytes for each, is written after every one."""


class Chunk(NamedTuple):
    """Members ``first`` to ``first + size - 1``."""

    first: int
    size: int


def chunk_size(members: int, steps: int) -> int:
    """Members of a chunk, for runs of so many steps."""
    by_time = min(max(CHUNK_WORK // max(steps, 1), FEWEST_MEMBERS), MOST_MEMBERS)
    return max(by_time, -(-members // MOST_CHUNKS))


def chunks_of(members: int, size: int) -> Iterator[Chunk]:
    """All of them, the last one as long as what is left."""
    for first in range(0, members, size):
        yield Chunk(first, min(size, members - first))


UNIT_SECONDS = 1.0
"""What is run at once takes about that long: a kill costs that, beside what waits to be stored."""
GROWTH = 8
"""Members that are run next, as a multiple of those before, at most: the first ones pay for compiling and tell little."""


@dataclass(eq=False)
class Pace:
    """How many members are run at once, by how long those before took. No bit depends on it.

    ahead  units that wait for each that runs: what is begun takes so many times longer than its own work
    """

    ahead: int = 1
    size: int = FEWEST_MEMBERS
    begun: dict[int, float] = field(default_factory=dict)

    def units(self, chunks: Sequence[Chunk]) -> Iterator[Chunk]:
        """All of these, in pieces of which each is begun when it is asked for; none reaches into two chunks."""
        for chunk in chunks:
            done = 0
            while done < chunk.size:
                unit = Chunk(chunk.first + done, min(self.size, chunk.size - done))
                self.begun[unit.first] = time.perf_counter()
                yield unit
                done += unit.size

    def done(self, unit: Chunk) -> None:
        """The next ones are sized by the time since this one was begun."""
        seconds = (time.perf_counter() - self.begun.pop(unit.first)) / self.ahead
        wanted = unit.size * min(UNIT_SECONDS / max(seconds, 1e-9), GROWTH)
        self.size = int(max(wanted, FEWEST_MEMBERS))
