"""A sweep on disk: a folder of Parquet files, each with a chunk or a part of a chunk, and an index. Stored rows are never
changed.

When no sweep is running, every file in the folder is Parquet, so pandas, Polars and DuckDB read the folder as one table. The
index is a file without rows, and its JSON is in the file's metadata. While a sweep is written, the folder also contains a lock
and a folder for incomplete data, both hidden.
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
    """A folder to which only this process writes (see ``opened``).

    damaged  names of files that are missing or differ from what was stored: their chunks are computed again
    """

    folder: Path
    index: StoreIndex
    damaged: tuple[str, ...] = ()

    in_order: ClassVar[bool] = False

    @property
    def chunks(self) -> list[Chunk]:
        """All chunks of the sweep."""
        return list(chunks_of(self.index.members, self.index.chunk))

    @property
    def missing(self) -> list[Chunk]:
        """The chunks that are missing, or the missing parts of incomplete chunks."""
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
        """Add the columns of a chunk. They are written to the disk completely or not at all."""
        self.add_all([(chunk, columns)])

    def add_all(self, made: Sequence[tuple[Chunk, Columns]]) -> None:
        """Store several chunks, each in its own file, and then one index."""
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
        """Remove files of members that the index does not list, because a writer was killed before it wrote the index.

        Their members will run again, perhaps in different pieces, and would occur twice if the folder were read as one table.
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
        """Write under a different name and rename the file when it is on the disk, so that no reader sees an incomplete file."""
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
        """The columns of the stored rows, which later rows must have too; empty if nothing is stored yet."""
        return names_in(self.folder)

    def rows(self) -> StoredRows:
        return StoredRows(self.folder, self.index)


STORED_EVERY = 3.0
"""Interval at which completed chunks are stored [s]: if the process is killed, this much work is lost in addition to the
running chunks."""
MANY_FILES, FILES_FOR_DOUBLE = 1024, 512
"""Number of files above which a store is written less often; the interval grows in proportion to this number, so 4096 files
correspond to a day."""
MOST_WAITING = 4
"""Largest number of chunks that wait in memory, in parts: workers complete them in any order."""


@dataclass(eq=False)
class Waiting:
    """Results that are complete but not yet stored. A complete chunk is stored at once, everything else every few seconds."""

    store: Store
    made: list[tuple[Chunk, Columns]] = field(default_factory=list)
    stored_at: float = field(init=False)

    def __post_init__(self) -> None:
        self.stored_at = time.perf_counter()

    def add(self, chunk: Chunk, columns: Columns) -> None:
        """Add complete results, and store those that are due."""
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
        """Interval between two writes [s]."""
        return float(STORED_EVERY * 2.0 ** max((len(self.store.index.files) - MANY_FILES) / FILES_FOR_DOUBLE, 0.0))

    def put(self) -> None:
        """Store the waiting results; results that could not be stored are dropped."""
        runs, self.made = self._runs(), []
        if runs:
            self.store.add_all([_joined(several) for several in runs])
        self.stored_at = time.perf_counter()

    def _runs(self) -> list[list[tuple[Chunk, Columns]]]:
        """The contents of the individual files: consecutive members of a chunk."""
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
    """Open a new store, or one to continue, locked for this process. A complete store is not written to.

    grows  whether the store may have fewer members than are now requested, namely the first members of the same plan

    Raises InputError for a folder that can't be written, that another process is writing to, or that contains a different sweep
    or other files.
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
    """Raise InputError for a folder that ``opened`` would reject in any case, and if a store's dependencies are missing.

    Commands call this before they compute anything. The test leaves no files behind and does not write to a complete store.
    """
    require_parquet()
    folder = validate.local_path("the store", folder)
    index = read_index(folder)
    if index is None or not index.complete:
        with _locked(folder):
            if read_index(folder) is None:
                _require_empty(folder)


def _require_empty(folder: Path) -> None:
    """Raise InputError if the folder contains other files."""
    ours = (LOCK_FILE, WRITING_DIR)
    if foreign := sorted(one.name for one in folder.iterdir() if one.name not in ours and not _ours(one)):
        raise InputError(f"the store {str(folder)!r} contains other files, such as {foreign[0]!r}: choose a different folder")


def _damaged(folder: Path, index: StoreIndex) -> tuple[str, ...]:
    return tuple(name for name, file in index.files.items() if not intact(folder / name, file["sha256"]))


def _ours(file: Path) -> bool:
    return file.name.startswith("members-") and file.suffix == ".parquet"


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Create the folder if necessary and lock it for this process; it is removed if it stays empty."""
    from filelock import FileLock, Timeout

    refusal = f"the store {str(folder)!r} cannot be written"
    with made(folder, refusal):
        lock = FileLock(folder / LOCK_FILE, timeout=0)
        with refused(refusal):
            try:
                lock.acquire()
            except Timeout:  # a timeout is an OSError too
                raise InputError(
                    f"the store {str(folder)!r} is being written by another process: wait for it, or choose a different folder"
                ) from None
        try:
            yield
        finally:
            shutil.rmtree(folder / WRITING_DIR, ignore_errors=True)
            # removed while it is locked; a waiting process notices this and creates a new folder
            with contextlib.suppress(OSError):
                (folder / LOCK_FILE).unlink()
            lock.release()


def _sync(folder: Path) -> None:
    """Flush the directory entries of the folder to the disk. Windows has no handle for this and flushes by itself."""
    if sys.platform == "win32":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _table(columns: Columns) -> pa.Table:
    """The columns as a table, in which a missing metric is null."""
    import pyarrow as pa

    found = {}
    for name, values in columns.items():
        if name.endswith(f"/{OSCILLATED}"):
            found[name] = pa.array(values == 1, mask=np.isnan(values))
        else:
            found[name] = pa.array(values, from_pandas=True)
    return pa.table(found)
