"""A sweep on disk: a folder of Parquet files, each of a chunk or a part of one, and an index. What is stored stays.

Everything in the folder of a sweep at rest is Parquet, so that pandas, Polars and DuckDB read the folder as one table: the index
is a file without rows, and its JSON stands in the file's metadata. While a sweep is written a lock and a folder for what is not
complete yet lie there too, both hidden.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import shutil
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from barbalat import validate
from barbalat.folders import made, refused
from barbalat.sweeps.chunks import Chunk, Columns, chunks_of
from barbalat.sweeps.stored import (
    INDEX_FILE,
    INDEX_KEY,
    NAMES_OF_DIFFERENCES,
    StoredRows,
    StoreIndex,
    checksum,
    grown,
    intact,
    name_of,
    names_in,
    read_index,
    require_parquet,
    require_same,
)
from barbalat.sweeps.study import OSCILLATED
from barbalat.validate import InputError

if TYPE_CHECKING:
    import pyarrow as pa

LOCK_FILE, WRITING_DIR = ".lock", ".writing"


@dataclass(eq=False)
class Store:
    """A folder that this process alone writes; see ``opened``.

    damaged  names of files that are not what was stored, or are gone: their chunks are made again
    """

    folder: Path
    index: StoreIndex
    damaged: tuple[str, ...] = ()

    in_order: ClassVar[bool] = False

    @property
    def chunks(self) -> list[Chunk]:
        """All of the sweep's."""
        return list(chunks_of(self.index.members, self.index.chunk))

    @property
    def missing(self) -> list[Chunk]:
        """The chunks that are not there yet; of a chunk that is there in part what it lacks."""
        holes, here = [], 0
        for first, count in sorted((file["first"], file["count"]) for file in self.index.files.values()):
            holes.append((here, first))
            here = first + count
        found = []
        for begin, end in (*holes, (here, self.index.members)):
            first = begin
            while first < end:
                stop = min(end, (first // self.index.chunk + 1) * self.index.chunk)
                found.append(Chunk(first, stop - first))
                first = stop
        return found

    @property
    def stored(self) -> int:
        """The number of members that are stored."""
        return sum(file["count"] for file in self.index.files.values())

    def add(self, chunk: Chunk, columns: Columns) -> None:
        """A chunk's columns: on disk when this returns, or not at all."""
        self.add_all([(chunk, columns)])

    def add_all(self, made: Sequence[tuple[Chunk, Columns]]) -> None:
        """Store several chunks, each in a file of its own, with one index after them."""
        before = dict(self.index.files)
        try:
            schemas = [self._add(chunk, columns) for chunk, columns in made]
            self._write_index(schemas[-1])
        except BaseException:
            self.index.files.clear()
            self.index.files.update(before)
            raise

    def _add(self, chunk: Chunk, columns: Columns) -> pa.Schema:
        from pyarrow import parquet

        table = _table(columns)
        buffer = io.BytesIO()
        parquet.write_table(table, buffer)
        content = buffer.getvalue()
        self._write(name_of(chunk), content)
        entry = {"first": chunk.first, "count": chunk.size, "sha256": hashlib.sha256(content).hexdigest()}
        self.index.files[name_of(chunk)] = entry
        return table.schema

    def remove_unlisted(self) -> None:
        """Files of members that the index does not name: a writer was killed before it wrote the index.

        Their members are run again, in other pieces perhaps, and who reads the folder as one table would have them twice.
        """
        for file in self.folder.iterdir():
            if _ours(file) and file.name not in self.index.files:
                file.unlink()

    def _write_index(self, schema: pa.Schema) -> None:
        from pyarrow import parquet

        text = self.index.as_text().encode()
        stated = {INDEX_KEY: text, INDEX_KEY + b".sha256": checksum(text, schema)}
        buffer = io.BytesIO()
        parquet.write_table(schema.with_metadata(stated).empty_table(), buffer)
        self._write(INDEX_FILE, buffer.getvalue())

    def _write(self, name: str, content: bytes) -> None:
        """Under another name first, and under its own when it is on the disk: nobody ever sees half of it."""
        temporary = self.folder / WRITING_DIR / name
        temporary.parent.mkdir(exist_ok=True)
        try:
            with temporary.open("wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            temporary.replace(self.folder / name)
        finally:
            temporary.unlink(missing_ok=True)
        _sync(self.folder)

    @property
    def names(self) -> list[str]:
        """The columns that its rows have, and go on to have; none where nothing is stored yet."""
        return names_in(self.folder)

    def rows(self) -> StoredRows:
        return StoredRows(self.folder, self.index)


STORED_EVERY = 3.0
"""Seconds after which what is complete is stored: what a kill costs, beside what is being run."""
MANY_FILES, FILES_FOR_DOUBLE = 1024, 512
"""A store of so many files is written less often, and with so many more again half as often: 4096 files are a day's."""
MOST_WAITING = 4
"""Chunks that wait in memory, in parts, at most: workers complete them in any order."""


@dataclass(eq=False)
class Waiting:
    """What is complete and not stored yet; a chunk is stored as soon as nothing of it is missing, all else every few seconds."""

    store: Store
    made: list[tuple[Chunk, Columns]] = field(default_factory=list)
    stored_at: float = field(init=False)

    def __post_init__(self) -> None:
        self.stored_at = time.perf_counter()

    def add(self, chunk: Chunk, columns: Columns) -> None:
        """Take up what is complete, and store what is due."""
        self.made.append((chunk, columns))
        waiting = sum(one.size for one, _ in self.made)
        if time.perf_counter() - self.stored_at >= self.pause or waiting >= MOST_WAITING * self.store.index.chunk:
            self.put()
            return
        missing = set(self.store.missing)
        for several in self._runs():
            if _extent(several) in missing:
                self.store.add_all([_joined(several)])
                gone = {one for one, _ in several}
                self.made = [one for one in self.made if one[0] not in gone]

    @property
    def pause(self) -> float:
        """Seconds between two times of storing."""
        return float(STORED_EVERY * 2.0 ** max((len(self.store.index.files) - MANY_FILES) / FILES_FOR_DOUBLE, 0.0))

    def put(self) -> None:
        """Store what waits; what could not be stored is forgotten."""
        runs, self.made = self._runs(), []
        if runs:
            self.store.add_all([_joined(several) for several in runs])
        self.stored_at = time.perf_counter()

    def _runs(self) -> list[list[tuple[Chunk, Columns]]]:
        """What goes into one file each: members of a chunk that follow one another."""
        together: list[list[tuple[Chunk, Columns]]] = []
        for one in sorted(self.made, key=lambda one: one[0]):
            first = one[0].first
            if first % self.store.index.chunk and together and sum(together[-1][-1][0]) == first:
                together[-1].append(one)
            else:
                together.append([one])
        return together


def _extent(several: Sequence[tuple[Chunk, Columns]]) -> Chunk:
    first = several[0][0].first
    return Chunk(first, sum(several[-1][0]) - first)


def _joined(several: Sequence[tuple[Chunk, Columns]]) -> tuple[Chunk, Columns]:
    columns = [one for _, one in several]
    return _extent(several), {name: np.concatenate([one[name] for one in columns]) for name in columns[0]}


@contextlib.contextmanager
def opened(
    folder: Path,
    identity: dict[str, Any],
    members: int,
    chunk: int,
    differences: Mapping[str, str] = NAMES_OF_DIFFERENCES,
    *,
    grows: bool = False,
) -> Iterator[Store]:
    """A new store, or one to go on with, of this process alone; of one that is complete nothing is written.

    grows  it may have fewer members than are asked for now, the first ones of the same plan

    InputError for a folder that can't be written, that another process writes, or that holds another sweep or other things.
    """

    folder = validate.local_path("the store", folder)

    def found() -> StoreIndex | None:
        index = read_index(folder)
        return grown(index, identity, members) if index is not None and grows else index

    whole = found()
    if whole is not None and whole.complete:
        require_same(folder, whole, identity, differences)
        if not _damaged(folder, whole):
            yield Store(folder, whole)
            return
    with _locked(folder):
        index = found()
        damaged: tuple[str, ...] = ()
        if index is None:
            _require_empty(folder)
            index = StoreIndex.new(identity, members, chunk)
        else:
            require_same(folder, index, identity, differences)
            damaged = _damaged(folder, index)
            for name in damaged:
                del index.files[name]
        store = Store(folder, index, damaged)
        store.remove_unlisted()
        yield store


def require_place(folder: Path) -> None:
    """InputError for a folder that ``opened`` would refuse whatever is to be stored, and without what a store needs.

    A command asks this before it computes anything. Nothing is left of the attempt, and of a store that is complete nothing is
    written.
    """
    require_parquet()
    folder = validate.local_path("the store", folder)
    index = read_index(folder)
    if index is None or not index.complete:
        with _locked(folder):
            if read_index(folder) is None:
                _require_empty(folder)


def _require_empty(folder: Path) -> None:
    """InputError where others' files lie there."""
    ours = (LOCK_FILE, WRITING_DIR)
    if foreign := sorted(one.name for one in folder.iterdir() if one.name not in ours and not _ours(one)):
        raise InputError(f"the store {str(folder)!r} holds other files, such as {foreign[0]!r}: choose another folder")


def _damaged(folder: Path, index: StoreIndex) -> tuple[str, ...]:
    return tuple(name for name, file in index.files.items() if not intact(folder / name, file["sha256"]))


def _ours(file: Path) -> bool:
    return file.name.startswith("members-") and file.suffix == ".parquet"


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """The folder, made if need be, of this process alone; it goes again where it stays empty."""
    from filelock import FileLock, Timeout

    refusal = f"the store {str(folder)!r} cannot be written"
    with made(folder, refusal):
        lock = FileLock(folder / LOCK_FILE, timeout=0)
        with refused(refusal):
            try:
                lock.acquire()
            except Timeout:  # which is an OSError too
                raise InputError(
                    f"the store {str(folder)!r} is being written by another process: wait for it, or choose another"
                ) from None
        try:
            yield
        finally:
            shutil.rmtree(folder / WRITING_DIR, ignore_errors=True)
            with contextlib.suppress(OSError):  # while it is held: who waits for it sees that it is gone, and makes a new one
                (folder / LOCK_FILE).unlink()
            lock.release()


def _sync(folder: Path) -> None:
    """Have the folder's own entries on the disk; Windows has no handle for that, and does it by itself."""
    if sys.platform == "win32":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _table(columns: Columns) -> pa.Table:
    """A figure that a member does not have is null."""
    import pyarrow as pa

    found = {}
    for name, values in columns.items():
        if name.endswith(f"/{OSCILLATED}"):
            found[name] = pa.array(values == 1, mask=np.isnan(values))
        else:
            found[name] = pa.array(values, from_pandas=True)
    return pa.table(found)
