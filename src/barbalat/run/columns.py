"""The numbers of many members of one structure, read one member after another: only those in which they differ are kept."""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

import numpy as np

from barbalat.loop.structure import DEEPEST_NESTING, parts_of, same_names, same_whole, values_of
from barbalat.validate import Array

_BYTES = struct.Struct("d").pack


class StructureError(Exception):
    """A member has more than other numbers."""


class _Part(NamedTuple):
    """A part of the first member, and where its leaves stand among all of them."""

    first: Any
    begin: int
    end: int
    inner: tuple[_Part, ...] | None  # None for a leaf, and for what has no parts


class Columns:
    """Leaves are the arrays and numbers of a member, in the order of its parts.

    A leaf of which every member has the first's bits takes no memory; any other one an entry for each member. A part that is
    the first member's own object is not looked into.
    """

    def __init__(self, first: Any) -> None:
        self.first = first
        self.count = 1
        self._leaves: list[Array] = []
        self._whole = self._read(first, 0)
        self._bytes = [leaf.tobytes() for leaf in self._leaves]
        self._kept: dict[int, bytearray] = {}

    def _read(self, part: Any, depth: int) -> _Part:
        begin, inner = len(self._leaves), None
        if isinstance(part, (np.ndarray, float)):
            self._leaves.append(np.asarray(part, dtype=float))
        elif depth < DEEPEST_NESTING and (parts := parts_of(part)) is not None:
            inner = tuple(self._read(value, depth + 1) for value in parts.values())
        return _Part(part, begin, len(self._leaves), inner)

    def add(self, member: Any) -> None:
        """Take up the next member; StructureError where it differs by more than numbers."""
        self._take(member, self._whole)
        self.count += 1

    def _take(self, part: Any, place: _Part) -> None:
        first, begin, end, inner = place
        if part is first:
            if self._kept and begin < end:
                self._keep_first(begin, end)
        elif inner is not None:
            if type(part) is not type(first) or not same_names(part, first):
                raise StructureError
            for value, within in zip(values_of(part), inner, strict=True):
                if value is not within.first or (self._kept and within.begin < within.end):
                    self._take(value, within)
        elif isinstance(first, np.ndarray):
            if not isinstance(part, np.ndarray) or part.shape != first.shape:
                raise StructureError
            self._keep(begin, part.tobytes() if part.dtype == float else np.asarray(part, dtype=float).tobytes())
        elif isinstance(first, float):
            if not isinstance(part, float):
                raise StructureError
            self._keep(begin, _BYTES(part))
        elif not same_whole(part, first):
            raise StructureError

    def _keep(self, leaf: int, given: bytes) -> None:
        kept = self._kept.get(leaf)
        if kept is not None:
            kept += given
        elif given != self._bytes[leaf]:
            self._kept[leaf] = bytearray(self._bytes[leaf] * self.count) + given

    def _keep_first(self, begin: int, end: int) -> None:
        for leaf, kept in self._kept.items():
            if begin <= leaf < end:
                kept.extend(self._bytes[leaf])

    def differing(self) -> tuple[Array, Array]:
        """Which of all numbers differ between members, (N,), and those, (p, M)."""
        differs, rows = [], []
        for i, leaf in enumerate(self._leaves):
            values = self._values(i)
            found = (values != leaf.reshape(-1, 1)).any(axis=1)
            differs.append(found)
            if found.any():
                rows.append(values[found])
        return np.concatenate([*differs, np.zeros(0, dtype=bool)]), np.concatenate([*rows, np.zeros((0, self.count))])

    def _values(self, leaf: int) -> Array:
        """(entries, M), or (entries, 1) where all members have the same."""
        if leaf not in self._kept:
            return self._leaves[leaf].reshape(-1, 1)
        return np.frombuffer(self._kept[leaf]).reshape(self.count, -1).T

    def everything(self) -> Array:
        """(N, M) all numbers of all members; those that don't differ take no memory of their own where none does."""
        values = [np.broadcast_to(self._values(i), (leaf.size, self.count)) for i, leaf in enumerate(self._leaves)]
        return values[0] if len(values) == 1 else np.concatenate(values)
