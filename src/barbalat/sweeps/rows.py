"""All members' columns, one column at a time: in memory, or in files where they would take too much of it."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Protocol

import numpy as np

from barbalat.sweeps.study import Columns
from barbalat.validate import Array

MOST_IN_MEMORY = 2**28
"""Bytes of all columns together."""


class Rows(Protocol):
    """What a finished sweep can be asked."""

    @property
    def names(self) -> list[str]:
        """Of the columns, in their order."""
        ...

    def column(self, name: str) -> Array:
        """(M,) by the members' numbers."""
        ...

    def row(self, member: int) -> dict[str, float]:
        """Of one member."""
        ...


@dataclass(eq=False)
class Kept:
    """Columns in memory, or in a folder of one file for each chunk, which goes when the sweep is forgotten."""

    folder: Path | None
    parts: list[Columns] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    starts: list[int] = field(default_factory=list)
    members: int = 0

    @classmethod
    def room_for(cls, members: int, columns: int) -> Kept:
        """For so many; files of it are gone when it is."""
        if members * columns * 8 <= MOST_IN_MEMORY:
            return cls(None)
        folder = Path(tempfile.mkdtemp(prefix="barbalat-sweep-"))
        found = cls(folder)
        weakref.finalize(found, shutil.rmtree, folder, ignore_errors=True)
        return found

    def add(self, columns: Columns) -> None:
        """The next members."""
        self.names = list(columns)
        self.starts.append(self.members)
        self.members += len(columns["member"])
        if self.folder is None:
            self.parts.append(columns)
        else:
            np.save(self._file(len(self.starts) - 1), np.array([values.astype(float) for values in columns.values()]))

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
