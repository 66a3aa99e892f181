"""Reads the folder of a sweep, even while another process is writing to it."""

from __future__ import annotations

import hashlib
import io
import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import barbalat
from barbalat import validate
from barbalat.sweeps.chunks import MOST_CHUNKS, Chunk
from barbalat.validate import Array, InputError

if TYPE_CHECKING:
    import pyarrow as pa

INDEX_FILE = "_index.parquet"
INDEX_KEY = b"barbalat"
"""The key of the index in the metadata of its file; its ``checksum`` is under ``KEY + b".sha256"``."""
READ_AT_ONCE = 2**27
"""Bytes of columns read at once."""
NAMES_OF_DIFFERENCES = {
    "case": "a different case file",
    "plan": "a different --vary, --sample, --members, --design or --seed",
    "equations": "different equations",
    "judge": "the verdicts of a different judge",
    "bounds": "the opposite choice of --no-bounds",
}
"""The words for a difference, by the keys of ``Study.identity``."""


@dataclass(frozen=True)
class StoreIndex:
    """The index of a store: ``files`` by name, each with its first member, number of members and SHA-256."""

    identity: dict[str, Any]
    members: int
    chunk: int
    versions: dict[str, str]
    files: dict[str, dict[str, Any]]

    @classmethod
    def new(cls, identity: dict[str, Any], members: int, chunk: int) -> StoreIndex:
        packages = ("numpy", "scipy", "casadi", "llvmlite", "pyarrow")
        versions = {"barbalat": barbalat.__version__, "python": sys.version.split()[0]}
        return cls(identity, members, chunk, versions | {name: metadata.version(name) for name in packages}, {})

    def as_text(self) -> str:
        return json.dumps(vars(self))

    @property
    def complete(self) -> bool:
        """Whether every member is in one of the files."""
        return bool(sum(file["count"] for file in self.files.values()) == self.members)


def name_of(chunk: Chunk) -> str:
    """The file name of a chunk, which contains its first member."""
    return f"members-{chunk.first:012}.parquet"


def require_parquet() -> None:
    """Raise InputError if the packages for reading and writing Parquet are missing."""
    for module in ("pyarrow", "filelock"):
        validate.require_extra(module, "study", "a store")


def read_index(folder: Path) -> StoreIndex | None:
    """The index of a folder, None without one; raises InputError if it can't be read."""
    from pyarrow import ArrowException

    try:
        content = (folder / INDEX_FILE).read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise InputError(f"the store {str(folder)!r} cannot be read: {error.strerror or error}") from None
    try:
        schema = _schema(content)
        found = schema.metadata or {}
        text = found[INDEX_KEY]
        if checksum(text, schema) != found[INDEX_KEY + b".sha256"]:
            raise ValueError("its checksum differs")
        return StoreIndex(**json.loads(text))
    except (ArrowException, OSError, ValueError, LookupError, TypeError):
        raise InputError(
            f"the index of the store {str(folder)!r} is damaged: delete {INDEX_FILE} there and run the same command again to "
            f"restart the sweep"
        ) from None


def _schema(index: bytes) -> pa.Schema:
    """The schema in the bytes of an index file."""
    from pyarrow import parquet

    return parquet.read_schema(io.BytesIO(index))


def names_in(folder: Path) -> list[str]:
    """The columns of a store; none if nothing is stored yet."""
    try:
        return list(_schema((folder / INDEX_FILE).read_bytes()).names)
    except (FileNotFoundError, NotADirectoryError):
        return []


def checksum(text: bytes, schema: pa.Schema) -> bytes:
    """SHA-256 of an index's text and of its columns, whose names no other checksum covers."""
    columns = "".join(f"\n{one.name}: {one.type}" for one in schema)
    return hashlib.sha256(text + columns.encode()).hexdigest().encode()


def row_of(folder: Path, identity: dict[str, Any], member: int) -> dict[str, float]:
    """The row of a member, even from a store that is being written; raises InputError if the store belongs to a different sweep
    or lacks the member."""
    index = read_index(folder)
    if index is None:
        raise InputError(f"the store {str(folder)!r} does not contain a sweep")
    require_same(folder, index, identity)
    return StoredRows(folder, index).row(member)


def require_same(
    folder: Path, index: StoreIndex, identity: dict[str, Any], differences: Mapping[str, str] = NAMES_OF_DIFFERENCES
) -> None:
    """Raise InputError, with the difference, if the store belongs to a different sweep."""
    for key, what in differences.items():
        if key in identity.keys() & index.identity.keys() and index.identity[key] != identity[key]:
            by = f" (made by barbalat {index.versions.get('barbalat')})" if key in ("equations", "judge") else ""
            raise InputError(
                f"the store {str(folder)!r} was made with {what}{by}: choose a different folder, or use the command that made it"
            )


def grown(index: StoreIndex, identity: dict[str, Any], members: int) -> StoreIndex:
    """The index extended to further members of a plan that keeps its first members; unchanged for a different sweep or the same
    number of members."""
    plan = index.identity.get("plan", {}) | {"members": members}
    known = {key: value for key, value in identity.items() if key in index.identity}  # an old store has fewer columns
    if members <= index.members or -(-members // index.chunk) > MOST_CHUNKS or index.identity | {"plan": plan} != known:
        return index
    return replace(index, identity=known, members=members, files=dict(index.files))


class StoredRows:
    """The columns of a store's files, some of them read together."""

    def __init__(self, folder: Path, index: StoreIndex) -> None:
        self.folder, self.index = folder, index
        self.files = sorted(index.files)
        self.names = names_in(folder)
        self._read: dict[str, Array] = {}

    def column(self, name: str) -> Array:
        if name not in self._read:
            self._read.clear()
            at_once = max(READ_AT_ONCE // (8 * self.index.members), 1)
            start = self.names.index(name)
            names = self.names[start : start + at_once]
            tables = [_table(self.folder / file, names) for file in self.files]
            for one in names:
                self._read[one] = np.concatenate([_numbers(table, one) for table in tables])
        return self._read[name]

    def row(self, member: int) -> dict[str, float]:
        for file in self.files:
            place = member - self.index.files[file]["first"]
            if 0 <= place < self.index.files[file]["count"]:
                if not intact(self.folder / file, self.index.files[file]["sha256"]):
                    raise InputError(
                        f"the store's file {str(self.folder / file)!r} is damaged or missing: run the same command without "
                        f"--member to write it again"
                    )
                table = _table(self.folder / file, None).slice(place, 1)
                return {name: float(_numbers(table, name)[0]) for name in table.column_names}
        raise InputError(f"the store {str(self.folder)!r} does not contain member {member}")


def _table(file: Path, names: list[str] | None) -> pa.Table:
    """These columns of a file, or all of them.

    Arrow receives the open file, because it would treat a name with a colon as a URL, expand ``~``, and read a folder ``a=1`` as
    a column.
    """
    from pyarrow import parquet

    with file.open("rb") as content:
        return parquet.ParquetFile(content).read(columns=names)


def intact(file: Path, sha256: str) -> bool:
    """Whether a file exists with the stored bytes."""
    try:
        with file.open("rb") as content:
            return hashlib.file_digest(content, "sha256").hexdigest() == sha256
    except OSError:
        return False


def _numbers(table: pa.Table, name: str) -> Array:
    found = table.column(name)
    if str(found.type) == "int64":
        return found.to_numpy()
    return np.asarray(found.cast("float64").to_numpy(), dtype=float)
