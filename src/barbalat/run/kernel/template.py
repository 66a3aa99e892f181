"""Members of one structure: the numbers in which they differ, and a template with a symbol for each of these numbers."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, is_dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from barbalat.loop.checking import Ports, check_varied
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import symbols
from barbalat.loop.structure import DEEPEST_NESTING, comes_from_outside, parts_of, same_names, same_whole, values_of, with_parts
from barbalat.protocols import Value
from barbalat.validate import Array

_BYTES = struct.Struct("d").pack


class StructureError(Exception):
    """A member differs from the first in more than numbers."""


class _ColumnPart(NamedTuple):
    """A part of the first member, and the positions of its leaves."""

    first: Any
    leaf: int  # the position of a leaf, or of the first leaf within the part
    inner: tuple[_ColumnPart, ...] | None  # None for a leaf, and for an object without parts
    named: bool = False  # whether the class alone determines the parts


class Columns:
    """The leaves of members, which are their arrays and numbers, in the order of their parts.

    A leaf that is bit-identical in every member takes no memory. Any other leaf has an entry for each member up to the last one
    that differs; the remaining members have the first member's value. A part that is the same object as in the first member is
    not examined.
    """

    def __init__(self, first: Any, depth: int = 0) -> None:
        """``depth`` is the depth of ``first`` within the examined object."""
        self.first = first
        self.count = 1
        self._leaves: list[Array] = []
        self._whole = self._read(first, depth)
        self._bytes = [leaf.tobytes() for leaf in self._leaves]
        self._numbers = np.concatenate([*(leaf.ravel() for leaf in self._leaves), np.zeros(0)])
        self._kept: dict[int, bytearray] = {}

    def _read(self, part: Any, depth: int) -> _ColumnPart:
        begin = len(self._leaves)
        if isinstance(part, (np.ndarray, float)):
            self._leaves.append(np.asarray(part, dtype=float))
        elif depth < DEEPEST_NESTING and (parts := parts_of(part)) is not None:
            inner = tuple(self._read(value, depth + 1) for value in parts.values())
            return _ColumnPart(part, begin, inner, is_dataclass(part))
        return _ColumnPart(part, begin, None)

    def again(self) -> Columns:
        """Columns that contain only the first member."""
        other = copy(self)
        other.count, other._kept = 1, {}
        return other

    def add(self, member: Any) -> None:
        """Read the next member; raises StructureError if it differs in more than numbers."""
        self._take(member, self._whole)
        self.count += 1

    def _take(self, part: Any, place: _ColumnPart) -> None:
        first, leaf, inner, named = place
        if part is first:
            return
        if inner is not None:
            if type(part) is not type(first) or not (named or same_names(part, first)):
                raise StructureError
            for value, within in zip(values_of(part), inner, strict=True):
                if value is not within.first:
                    self._take(value, within)
            return
        if isinstance(first, np.ndarray):
            if not isinstance(part, np.ndarray) or part.shape != first.shape:
                raise StructureError
            given = part.tobytes() if part.dtype == float else np.asarray(part, dtype=float).tobytes()
        elif isinstance(first, float):
            if not isinstance(part, float):
                raise StructureError
            given = _BYTES(part)
        elif same_whole(part, first):
            return
        else:
            raise StructureError
        if given != self._bytes[leaf]:
            self._filled(leaf).extend(given)

    def _filled(self, leaf: int) -> bytearray:
        """The stored values of a leaf, completed with the first member's value for all members after the last that differed."""
        kept, same = self._kept.setdefault(leaf, bytearray()), self._bytes[leaf]
        missing = self.count - len(kept) // len(same) if same else 0
        if missing:
            kept += same * missing
        return kept

    def differing(self) -> tuple[Array, Array]:
        """The numbers that differ between members, as truth values (N,), and their values, (p, M)."""
        differs, rows = [], []
        for i, leaf in enumerate(self._leaves):
            values = self._values(i)
            found = (values != leaf.reshape(-1, 1)).any(axis=1)
            differs.append(found)
            if found.any():
                rows.append(values[found])
        return np.concatenate([*differs, np.zeros(0, dtype=bool)]), np.concatenate([*rows, np.zeros((0, self.count))])

    @property
    def leaves(self) -> tuple[Array, ...]:
        """The arrays of the first member."""
        return tuple(self._leaves)

    def first_numbers(self) -> Array:
        """(N,) all numbers of the first member."""
        return self._numbers

    def chosen(self, which: Array, rounding: float = 0.0) -> Array:
        """(p, M) the numbers selected by the truth values ``which`` (N,); raises StructureError if any other number differs
        between members.

        rounding  difference allowed for the other numbers, relative to the largest finite number of their array
        """
        found = np.repeat(self.first_numbers()[which][:, None], self.count, axis=1)
        for i in self._kept:  # the other leaves are bit-identical in every member
            leaf, values = self._leaves[i], self._values(i)
            begin = sum(one.size for one in self._leaves[:i])
            wanted, row = which[begin : begin + leaf.size], int(which[:begin].sum())
            if self._differs_beyond(rounding, leaf, values, ~wanted):
                raise StructureError
            found[row : row + int(wanted.sum())] = values[wanted]
        return found

    @staticmethod
    def _differs_beyond(rounding: float, leaf: Array, values: Array, which: Array) -> bool:
        """Whether some numbers differ from those of the first member by more than ``rounding``; numbers that are not finite are
        compared bit for bit."""
        first, found = leaf.reshape(-1, 1)[which], values[which]
        other = found != first
        if rounding == 0.0 or not other.any():
            return bool(other.any())
        largest = np.abs(leaf[np.isfinite(leaf)]).max(initial=0.0)
        with np.errstate(invalid="ignore"):
            return not bool((np.abs(found - first)[other] <= rounding * largest).all())

    def _values(self, leaf: int) -> Array:
        """The values (entries, M), or (entries, 1) if all members are equal."""
        if leaf not in self._kept:
            return self._leaves[leaf].reshape(-1, 1)
        return np.frombuffer(self._filled(leaf)).reshape(self.count, -1).T

    def everything(self) -> Array:
        """(N, M) all numbers of all members; if none differ, they take no additional memory."""
        values = [np.broadcast_to(self._values(i), (leaf.size, self.count)) for i, leaf in enumerate(self._leaves)]
        return values[0] if len(values) == 1 else np.concatenate(values)


@dataclass(frozen=True, eq=False)
class Member:
    """Everything on which a member's step depends."""

    loop: ClosedLoop
    delay_weights: Array | None  # as returned by ``delay.weights``


@dataclass(frozen=True, eq=False)
class Template:
    """The first member with a symbol in place of each number that differs.

    values  (p, M) the values of the symbols; ``column`` contains the symbols
    dt      a symbol if the step has one, otherwise None
    """

    loop: ClosedLoop
    delay_weights: Value
    values: Array
    column: Any
    dt: Value = None

    @classmethod
    def of(cls, members: Columns, *, opened: bool = False) -> Template:
        """``members`` has read each ``Member``; with ``opened`` all numbers that ``open_numbers`` names are symbols."""
        first: Member = members.first
        which = argument_numbers(members, opened=opened)
        if not which.any():
            return cls(first.loop, first.delay_weights, np.zeros((0, members.count)), None)
        values = members.chosen(which)
        column, parameters = symbols("parameters", len(values))
        places = np.cumsum(which) - 1
        found = with_symbols(first, iter([parameters[int(place)] if d else None for place, d in zip(places, which, strict=True)]))
        loop = first.loop
        if comes_from_outside(loop.equations):
            ports = Ports.of(loop.plant, loop.model, loop.commands, loop.inputs)
            check_varied(loop.equations, found.loop.equations, ports, (column, values[:, 0]))
        begun = replace(found.loop, begins=loop.equations.initial())  # initial() is written for numbers only
        return cls(begun, found.delay_weights, values, column)

    def adjustable(self, dt: float, weights: Columns | None) -> Template:
        """This template with additional symbols for the step ``dt`` [s] and for all weights of the delay, which are read
        separately from the members."""
        import casadi as ca

        values = with_grid(self.values, dt, weights)
        column, own = symbols("grid", len(values) - len(self.values))
        return Template(
            loop=self.loop,
            delay_weights=None if weights is None else own[1:].reshape(*weights.first.shape),
            values=values,
            column=column if self.column is None else ca.vertcat(self.column, column),
            dt=own[0],
        )


def with_grid(values: Array, dt: float, weights: Columns | None) -> Array:
    """The kernel's arguments (p, M), followed by the step and the delay's weights."""
    members = values.shape[1]
    return np.vstack([values, np.full((1, members), dt), *([] if weights is None else [weights.everything()])])


def argument_numbers(members: Columns, *, opened: bool) -> Array:
    """(N,) which numbers of a member are arguments of the kernel, as truth values; ``opened`` as in ``Template.of``."""
    differing = members.differing()[0]
    return differing | open_numbers(members.first) if opened else differing


def open_numbers(member: Member) -> Array:
    """(N,) which numbers of a member are parameters of a kernel whose list does not depend on them, as truth values.

    These are all numbers with two exceptions. The zeros of matrices determine the structure, and the code of parts from outside
    the package may use a number in ways that a symbol does not support.
    """
    loop, found = member.loop, [np.zeros(0, dtype=bool)]
    for part in (parts_of(loop) or {}).values():
        closed = comes_from_outside(part)
        for leaf in Columns(part, depth=2).leaves:
            open_here = leaf != 0 if leaf.ndim == 2 else np.ones(leaf.shape, dtype=bool)
            found.append(open_here.reshape(-1) & (not closed))
    found += [np.ones(leaf.size, dtype=bool) for leaf in Columns(member.delay_weights, depth=1).leaves]
    return np.concatenate(found)


def with_symbols(part: Any, values: Iterator[Any], depth: int = 0) -> Any:
    """A copy in which each number for which ``values`` has a symbol is replaced by the symbol, in the order of ``Columns``."""
    if isinstance(part, np.ndarray):
        entries = [next(values) for _ in range(part.size)]
        return part if all(entry is None for entry in entries) else _array_of(part, entries)
    if isinstance(part, float):
        symbol = next(values)
        return part if symbol is None else symbol
    parts = parts_of(part) if depth < DEEPEST_NESTING else None
    return part if parts is None else with_parts(part, [with_symbols(inner, values, depth + 1) for inner in parts.values()])


def _array_of(numbers: Array, entries: list[Any]) -> Any:
    """An array of expressions with the shape of ``numbers``."""
    import casadi as ca

    flat = [number if entry is None else ca.SX(entry) for number, entry in zip(numbers.ravel().tolist(), entries, strict=True)]
    return ca.array(ca.vertcat(*flat)).reshape(*numbers.shape)
