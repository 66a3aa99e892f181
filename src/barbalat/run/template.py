"""What many members have in common, with symbols for the numbers in which they differ: what their one kernel is made of."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from barbalat.loop.checking import Ports, check_varied
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import symbols
from barbalat.loop.structure import DEEPEST, comes_from_outside, parts_of, structure, with_parts
from barbalat.protocols import Value
from barbalat.validate import Array, InputError


@dataclass(frozen=True, eq=False)
class _Member:
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
    def of(cls, loops: Sequence[ClosedLoop], weights: Sequence[Array] | None, *, free_step: float | None = None) -> Template:
        """``free_step`` [s] makes symbols of the step and of all weights. InputError where more than numbers differ."""
        if free_step is not None:
            return _adjustable(loops, weights, free_step)
        each = [None] * len(loops) if weights is None else weights
        return _varied([_Member(*pair) for pair in zip(loops, each, strict=True)])


def _varied(members: Sequence[_Member]) -> Template:
    first = members[0]
    if len(members) == 1:
        return Template(first.loop, first.delay_weights, np.zeros((0, 1)), None)
    common = list(structure(first))
    numbers = np.empty((len(list(_numbers(first))), len(members)))
    for i, member in enumerate(members):
        if list(structure(member)) != common:
            raise InputError(
                f"all members must have one structure (scheme, sizes, projection, delay), but member {i + 1} differs; "
                "whole numbers belong to it: write 2.0 for a number that varies"
            )
        numbers[:, i] = list(_numbers(member))
    differs = (numbers != numbers[:, :1]).any(axis=1)
    column, parameters = symbols("parameters", int(differs.sum()))
    places = np.cumsum(differs) - 1
    values = iter([parameters[int(place)] if d else None for place, d in zip(places, differs, strict=True)])
    found = _replace(first, values)
    if comes_from_outside(first.loop.equations):
        loop = first.loop
        ports = Ports.of(loop.plant, loop.model, loop.commands, loop.inputs)
        check_varied(loop.equations, found.loop.equations, ports, (column, numbers[differs, 0]))
    return Template(found.loop, found.delay_weights, numbers[differs], column)


def _adjustable(loops: Sequence[ClosedLoop], weights: Sequence[Array] | None, dt: float) -> Template:
    import casadi as ca

    found = _varied([_Member(loop, None) for loop in loops])
    flat = np.zeros((0, len(loops))) if weights is None else np.column_stack([value.reshape(-1) for value in weights])
    column, own = symbols("grid", 1 + len(flat))
    return Template(
        loop=found.loop,
        delay_weights=None if weights is None else own[1:].reshape(*weights[0].shape),
        values=np.vstack([found.values, np.full((1, len(loops)), dt), flat]),
        column=column if found.column is None else ca.vertcat(found.column, column),
        dt=own[0],
    )


def _numbers(part: Any, depth: int = 0) -> Iterator[float]:
    parts = parts_of(part) if depth < DEEPEST else None
    if isinstance(part, np.ndarray):
        yield from part.ravel().tolist()
    elif isinstance(part, float):
        yield part
    elif parts is not None:
        for inner in parts.values():
            yield from _numbers(inner, depth + 1)


def _replace(part: Any, values: Iterator[Any], depth: int = 0) -> Any:
    """A copy with each number for which ``values`` has a symbol replaced by it, in the order of ``_numbers``."""
    if isinstance(part, np.ndarray):
        entries = [next(values) for _ in range(part.size)]
        return part if all(entry is None for entry in entries) else _array_of(part, entries)
    if isinstance(part, float):
        symbol = next(values)
        return part if symbol is None else symbol
    parts = parts_of(part) if depth < DEEPEST else None
    return part if parts is None else with_parts(part, [_replace(inner, values, depth + 1) for inner in parts.values()])


def _array_of(numbers: Array, entries: list[Any]) -> Any:
    """An array of expressions with the shape of ``numbers``."""
    import casadi as ca

    flat = [number if entry is None else ca.SX(entry) for number, entry in zip(numbers.ravel().tolist(), entries, strict=True)]
    return ca.array(ca.vertcat(*flat)).reshape(*numbers.shape)
