"""A sweep on disk: a folder of Parquet files, one for each chunk, and an index. What is stored stays, whatever kills its writer.

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
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from barbalat import validate
from barbalat.sweeps.chunks import Chunk, chunks_of
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
    read_index,
    require_same,
)
from barbalat.sweeps.study import OSCILLATED, Columns
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
        """Those that are not there yet."""
        return [chunk for chunk in self.chunks if name_of(chunk) not in self.index.files]

    @property
    def stored(self) -> int:
        """The number of members that are stored."""
        return sum(file["count"] for file in self.index.files.values())

    def add(self, chunk: Chunk, columns: Columns) -> None:
        """A chunk's columns: on disk when this returns, or not at all."""
        from pyarrow import parquet

        table = _table(columns)
        buffer = io.BytesIO()
        parquet.write_table(table, buffer)
        content = buffer.getvalue()
        self._write(name_of(chunk), content)
        entry = {"first": chunk.first, "count": chunk.size, "sha256": hashlib.sha256(content).hexdigest()}
        self.index.files[name_of(chunk)] = entry
        try:
            self._write_index(table.schema)
        except BaseException:
            del self.index.files[name_of(chunk)]
            raise

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

    def rows(self) -> StoredRows:
        return StoredRows(self.folder, self.index)


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
    if whole is not None and sum(file["count"] for file in whole.files.values()) == whole.members:
        require_same(folder, whole, identity, differences)
        if not _damaged(folder, whole):
            yield Store(folder, whole)
            return
    made = [one for one in (folder, *folder.parents) if not one.exists()]
    try:
        with _locked(folder):
            index = found()
            if index is None:
                _require_empty(folder)
                yield Store(folder, StoreIndex.new(identity, members, chunk))
            else:
                require_same(folder, index, identity, differences)
                damaged = _damaged(folder, index)
                for name in damaged:
                    del index.files[name]
                yield Store(folder, index, damaged)
    finally:
        for one in made:
            with contextlib.suppress(OSError):  # it is not empty
                one.rmdir()


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
    from filelock import FileLock, Timeout

    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / LOCK_FILE, timeout=0)
        lock.acquire()
    except Timeout:
        raise InputError(
            f"the store {str(folder)!r} is being written by another process: wait for it, or choose another"
        ) from None
    except OSError as error:
        reason = (
            "it, or what it would be in, is a file"
            if isinstance(error, (FileExistsError, NotADirectoryError))
            else error.strerror
        )
        raise InputError(f"the store {str(folder)!r} cannot be written: {reason}") from None
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
