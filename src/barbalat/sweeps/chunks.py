"""Divides members into chunks, and keeps columns without a store, in memory or in files if they are too large. A chunk contains
the members that run together for about a second and form one file of a store.
"""

from __future__ import annotations

import shutil
import tempfile
import time
import weakref
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from barbalat.validate import Array

Columns = dict[str, Array]
"""(M,) values by the names of a store's columns."""


class Rows(Protocol):
    """The interface to the data of a finished sweep."""

    @property
    def names(self) -> list[str]:
        """The names of the columns, in order."""
        ...

    def column(self, name: str) -> Array:
        """The values (M,) by member number."""
        ...

    def row(self, member: int) -> dict[str, float]:
        """The numbers of one member, by column."""
        ...


CHUNK_WORK = 2 * 10**8
"""Solver steps of all members of a chunk: two seconds of one core, at some 10 ns per step of a small loop."""
FEWEST_MEMBERS, MOST_MEMBERS = 32, 2**16
"""Members of a chunk: at least two kernel calls, and at most some 30 MB of columns."""
MOST_CHUNKS = 4096
"""Largest number of chunks of a sweep: its index, some hundred bytes per chunk, is written after every chunk."""


class Chunk(NamedTuple):
    """Members ``first`` to ``first + size - 1``."""

    first: int
    size: int


def chunk_size(members: int, steps: int) -> int:
    """Number of members in a chunk, for runs with this number of steps."""
    by_time = min(max(CHUNK_WORK // max(steps, 1), FEWEST_MEMBERS), MOST_MEMBERS)
    return max(by_time, -(-members // MOST_CHUNKS))


def chunks_of(members: int, size: int) -> Iterator[Chunk]:
    """All chunks; the last one contains the remainder."""
    for first in range(0, members, size):
        yield Chunk(first, min(size, members - first))


UNIT_SECONDS = 1.0
"""Approximate duration of a unit of work [s]. If the process is killed, this much work is lost in addition to the unstored
results."""
GROWTH = 8
"""Largest growth of the number of members between units: the first units include compilation and are not representative."""


@dataclass(eq=False)
class Pace:
    """The number of members that run at once, based on the duration of earlier units. No bit of the results depends on it.

    ahead   number of units that wait for each running unit; a started unit takes longer than its work by this factor
    fewest  smallest number of members that run together, so that kernels have work for all lanes
    """

    ahead: int = 1
    size: int = FEWEST_MEMBERS
    fewest: int = FEWEST_MEMBERS
    begun: dict[int, float] = field(default_factory=dict)

    def units(self, chunks: Sequence[Chunk]) -> Iterator[Chunk]:
        """Divide these chunks into units, each of which starts when it is requested; no unit spans two chunks."""
        for chunk in chunks:
            done = 0
            while done < chunk.size:
                unit = Chunk(chunk.first + done, min(self.size, chunk.size - done))
                self.begun[unit.first] = time.perf_counter()
                yield unit
                done += unit.size

    def done(self, unit: Chunk) -> None:
        """Determine the size of the next units from the time since this unit started."""
        seconds = (time.perf_counter() - self.begun.pop(unit.first)) / self.ahead
        wanted = unit.size * min(UNIT_SECONDS / max(seconds, 1e-9), GROWTH)
        self.size = int(max(wanted, self.fewest))


MOST_IN_MEMORY = 2**28
"""Largest total size of all columns in bytes."""


Made = Iterator[tuple[Chunk, Columns]]
"""Chunks with their columns, in the order of completion."""


def in_order(made: Made) -> Made:
    """Chunks in the order of their first members; early ones wait in memory."""
    waiting: dict[int, tuple[Chunk, Columns]] = {}
    first = 0
    for chunk, columns in made:
        waiting[chunk.first] = chunk, columns
        while first in waiting:
            following = waiting.pop(first)
            yield following
            first += following[0].size


@dataclass(eq=False)
class UnstoredChunks:
    """Columns in memory, or in a folder with one file for each chunk, which is deleted with the object.

    Chunks are added as to a ``Store``, but in the order of their first members.
    """

    folder: Path | None
    missing: list[Chunk] = field(default_factory=list)
    parts: list[Columns] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    starts: list[int] = field(default_factory=list)
    members: int = 0

    in_order: ClassVar[bool] = True
    damaged: ClassVar[tuple[str, ...]] = ()
    stored: ClassVar[int] = 0

    @classmethod
    def room_for(cls, chunks: list[Chunk], columns: int) -> UnstoredChunks:
        """Storage for these chunks; its files are deleted with the object."""
        if sum(chunk.size for chunk in chunks) * columns * 8 <= MOST_IN_MEMORY:
            return cls(None, chunks)
        folder = Path(tempfile.mkdtemp(prefix="barbalat-sweep-"))
        found = cls(folder, chunks)
        weakref.finalize(found, shutil.rmtree, folder, ignore_errors=True)
        return found

    def add(self, chunk: Chunk, columns: Columns) -> None:
        """Add the rows of the next members."""
        self.names = list(columns)
        self.starts.append(self.members)
        self.members += len(columns["member"])
        if self.folder is None:
            self.parts.append(columns)
        else:
            np.save(self._file(len(self.starts) - 1), np.array([values.astype(float) for values in columns.values()]))

    def rows(self) -> Rows:
        return self

    def _file(self, chunk: int) -> Path:
        assert self.folder is not None
        return self.folder / f"{chunk}.npy"

    def column(self, name: str) -> Array:
        if self.folder is None:
            return np.concatenate([part[name] for part in self.parts])
        place, found = self.names.index(name), np.empty(self.members)
        for chunk, (start, stop) in enumerate(pairwise([*self.starts, self.members])):
            found[start:stop] = np.load(self._file(chunk), mmap_mode="r")[place]  # only one file is mapped at a time
        return found

    def row(self, member: int) -> dict[str, float]:
        chunk = int(np.searchsorted(self.starts, member, side="right")) - 1
        place = member - self.starts[chunk]
        if self.folder is None:
            return {name: float(values[place]) for name, values in self.parts[chunk].items()}
        stored = np.load(self._file(chunk), mmap_mode="r")[:, place]
        return dict(zip(self.names, map(float, stored), strict=True))
