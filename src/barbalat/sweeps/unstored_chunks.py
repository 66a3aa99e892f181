"""Where chunks of columns go, and those that no store keeps: in memory, or in files where they would take too much of it."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import ClassVar

import numpy as np

from barbalat.sweeps.chunks import Chunk
from barbalat.sweeps.rows import Rows
from barbalat.sweeps.study import Columns
from barbalat.validate import Array

MOST_IN_MEMORY = 2**28
"""Bytes of all columns together."""


Made = Iterator[tuple[Chunk, Columns]]
"""Chunks with their columns, as they are complete."""


def in_order(made: Made) -> Made:
    """By their first members; what comes early waits in memory."""
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
    """Columns in memory, or in a folder of one file for each chunk, which goes when the sweep is forgotten.

    Chunks are put here as into a ``Store``, but by their first members.
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
        """For so many; files of it are gone when it is."""
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
            found[start:stop] = np.load(self._file(chunk), mmap_mode="r")[place]  # one file is mapped at a time
        return found

    def row(self, member: int) -> dict[str, float]:
        chunk = int(np.searchsorted(self.starts, member, side="right")) - 1
        place = member - self.starts[chunk]
        if self.folder is None:
            return {name: float(values[place]) for name, values in self.parts[chunk].items()}
        stored = np.load(self._file(chunk), mmap_mode="r")[:, place]
        return dict(zip(self.names, map(float, stored), strict=True))
