"""Members in pieces that take a second or so: what a store's files hold, and what an interrupt costs."""

from __future__ import annotations

from collections.abc import Iterator
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
