"""What many members have in common, with symbols for the numbers in which they differ: what their one kernel is made of."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from barbalat.loop.checking import Ports, check_varied
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import symbols
from barbalat.loop.structure import DEEPEST_NESTING, comes_from_outside, parts_of, with_parts
from barbalat.protocols import Value
from barbalat.run.kernel.columns import Columns
from barbalat.validate import Array


@dataclass(frozen=True, eq=False)
class Member:
    """Everything that a member's step depends on."""

    loop: ClosedLoop
    delay_weights: Array | None  # as of ``delay.weights``


@dataclass(frozen=True, eq=False)
class Template:
    """The first member with a symbol in place of each number that differs.

    values  (p, M) the numbers that the symbols stand for; ``column`` has the symbols
    dt      a symbol where the step is one of them, else None
    """

    loop: ClosedLoop
    delay_weights: Value
    values: Array
    column: Any
    dt: Value = None

    @classmethod
    def of(cls, members: Columns, *, opened: bool = False) -> Template:
        """``members`` has read each ``Member``; with ``opened`` all numbers are symbols that ``open_numbers`` names."""
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
        begun = replace(found.loop, begins=loop.equations.initial())  # initial() is written for numbers alone
        return cls(begun, found.delay_weights, values, column)

    def adjustable(self, dt: float, weights: Columns | None) -> Template:
        """With symbols for the step, which is ``dt`` [s], and for all the delay's weights, read apart from the members."""
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
    """The kernel's arguments (p, M) with the step and the delay's weights behind them."""
    members = values.shape[1]
    return np.vstack([values, np.full((1, members), dt), *([] if weights is None else [weights.everything()])])


def argument_numbers(members: Columns, *, opened: bool) -> Array:
    """(N,) which of all numbers of a member are arguments of the kernel; ``opened`` as of ``Template.of``."""
    differing = members.differing()[0]
    return differing | open_numbers(members.first) if opened else differing


COMPUTED_PARTS = ("model", "equations", "discrete_model")
"""Parts of a loop that a sampled controller's computer has: its list is exported, with their numbers in it."""


def open_numbers(member: Member) -> Array:
    """(N,) which of a member's numbers are parameters of a kernel whose list does not depend on them.

    All but the zeros of matrices, which say what a state acts on at all; the numbers of a sampled controller, whose list is the
    same in exported C; and those of parts from outside the package, which may do with their numbers what no symbol bears.
    """
    loop, found = member.loop, [np.zeros(0, dtype=bool)]
    for name, part in (parts_of(loop) or {}).items():
        closed = (loop.sampled and name in COMPUTED_PARTS) or comes_from_outside(part)
        for leaf in Columns(part, depth=2).leaves:
            open_here = leaf != 0 if leaf.ndim == 2 else np.ones(leaf.shape, dtype=bool)
            found.append(open_here.reshape(-1) & (not closed))
    found += [np.ones(leaf.size, dtype=bool) for leaf in Columns(member.delay_weights, depth=1).leaves]
    return np.concatenate(found)


def with_symbols(part: Any, values: Iterator[Any], depth: int = 0) -> Any:
    """A copy with each number for which ``values`` has a symbol replaced by it, in the order of ``Columns``."""
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
