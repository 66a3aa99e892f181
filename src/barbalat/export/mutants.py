"""Mutants of an exported step, each of which is the list with one small fault, and the test vectors that detect them.

Every operation, constant, selection, load and store has at least one mutant. A vector detects a mutant if any bit of the
resulting state differs: the self-test compares all of them.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from barbalat.export.evaluation import Inputs, value, values
from barbalat.lowering.c99 import Real
from barbalat.lowering.operations import Operation, Program
from barbalat.problem.known_set import UNREACHED_BOUND
from barbalat.run.kernel.sampled_controller import FREEZE, STATE
from barbalat.validate import Array

OTHER = {"add": "sub", "sub": "add", "mul": "div", "div": "mul", "lt": "le", "le": "lt", "eq": "ne", "ne": "eq", "and": "or",
         "or": "and"}  # fmt: skip
"""The operation that replaces another with the same operands."""
NEGATED = ("lt", "le")
"""Comparisons that are also reversed."""


@dataclass(frozen=True)
class Mutant:
    """One fault.

    place      position of the operation in the list, or the row of the state that is stored
    said       the fault in words
    operation  the operation that replaces the original one; None if the row is not stored and keeps its value
    denied     whether the comparison is reversed
    tie        whether the mutant differs only if two numbers are equal, such as < in place of <=
    """

    place: int
    said: str
    operation: Operation | None
    denied: bool = False
    tie: bool = False


def mutants(program: Program, rows: Sequence[int], real: Real) -> tuple[Mutant, ...]:
    """All mutants of a list whose outputs are these rows of the state, in the order of the list."""
    loads: dict[int, list[int]] = {}
    for op in program.operations:
        if op.name == "input":
            loads.setdefault(op.source[0], []).append(op.source[1])
    found = [
        Mutant(i, said, *made, tie={op.name, made[0].name} == {"lt", "le"})
        for i, op in enumerate(program.operations)
        for said, made in _of(op, loads, real)
    ]
    return (*found, *(Mutant(row, "is not stored", None) for row in rows))


def _of(op: Operation, loads: dict[int, list[int]], real: Real) -> Iterator[tuple[str, tuple[Operation, bool]]]:
    """The possible faults of one operation."""
    if op.name in OTHER:
        yield f"{op.name} becomes {OTHER[op.name]}", (op._replace(name=OTHER[op.name]), False)
    if op.name in NEGATED:
        yield f"{op.name} is turned around", (op, True)
    if op.name == "constant":
        with np.errstate(over="ignore"):
            number = real.numbers(op.value)
        as_a_number = 0 < abs(float(number)) < UNREACHED_BOUND  # an inactive bound and NaN have no such mutant
        moved = np.nextafter(number, real.numbers(np.inf)) if as_a_number else real.numbers(1.0)
        yield f"{op.value!r} becomes {float(moved)!r}", (op._replace(value=float(moved)), False)
    elif op.name == "input":
        argument, component = op.source
        others = sorted(loads[argument])
        other = others[(others.index(component) + 1) % len(others)]
        made = op._replace(source=(argument, other)) if other != component else Operation("constant")
        yield "a different entry is loaded" if other != component else "0 is loaded", (made, False)
    elif op.name in ("select", "fmin", "fmax"):
        for which, operand in zip(("first", "second"), op.operands[-2:], strict=True):
            yield f"{op.name} always takes the {which}", (Operation("copy", (operand,)), False)
    elif op.name == "if_else_zero":
        yield "always takes the value", (Operation("copy", op.operands[1:]), False)
        yield "takes zero always", (Operation("constant"), False)
    elif len(op.operands) == 1 and op.name not in OTHER:
        yield f"{op.name} is omitted", (Operation("copy", op.operands), False)


class Judge:
    """A list with test vectors, which determines the vectors that detect a mutant."""

    def __init__(self, program: Program, rows: Sequence[int], inputs: Inputs, real: Real) -> None:
        self.program, self.inputs, self.real = program, inputs, real
        self.values = values(program, inputs, real)
        self.before = {row: np.asarray(inputs[STATE, row], dtype=real.numbers) for row in rows}
        self.stored: dict[int, list[int]] = {}
        for row, i in zip(rows, program.outputs[0], strict=True):
            self.stored.setdefault(i, []).append(row)
        self.of_row = dict(zip(rows, program.outputs[0], strict=True))
        self.readers: list[list[int]] = [[] for _ in program.operations]
        for i, op in enumerate(program.operations):
            for operand in set(op.operands):
                self.readers[operand].append(i)
        self.count = max((one.size for one in map(np.asarray, self.values)), default=1)

    def tell(self, mutant: Mutant) -> Array:
        """(K,) the vectors after which a bit differs."""
        if mutant.operation is None:
            return np.broadcast_to(self._apart(self.before[mutant.place], self.values[self.of_row[mutant.place]]), self.count)
        found = np.zeros(self.count, dtype=bool)
        operations, values = self.program.operations, self.values.copy()  # values that follow from the fault are replaced
        place, waiting, queued = mutant.place, [mutant.place], {mutant.place}
        with np.errstate(all="ignore"):
            while waiting:
                i = heapq.heappop(waiting)
                op = operations[i]
                changed = (
                    self._mutated(mutant) if i == place else value(op, [values[j] for j in op.operands], self.inputs, self.real)
                )
                apart = self._apart(changed, self.values[i])
                if not apart.any():
                    continue
                values[i] = changed
                if i in self.stored:
                    found = found | apart
                for reader in self.readers[i]:
                    if reader not in queued:
                        queued.add(reader)
                        heapq.heappush(waiting, reader)
        return np.broadcast_to(found, self.count)

    def outcomes(self) -> tuple[int, int]:
        """For the choices that C prints, each with one condition: the number of outcomes that the vectors take, and the number
        of all outcomes."""
        found = list[Any]()
        for op in self.program.operations:
            x = [self.values[i] for i in op.operands]
            if op.name in ("select", "if_else_zero"):
                found.append(np.asarray(x[0]) != 0)
            elif op.name in ("fmin", "fmax"):
                found.append(np.greater(*x) if op.name == "fmin" else np.less(*x))
            elif op.name == "input" and op.source[0] == FREEZE:
                found.append(np.asarray(self.inputs[op.source]) != 0)
        return sum(int(one.any()) + int((~one).any()) for one in found), 2 * len(found)

    def begins(self, mutant: Mutant) -> Array:
        """(K,) the vectors at which the fault changes the value at its position, whatever its effect."""
        if mutant.operation is None:
            return np.zeros(self.count, dtype=bool)
        return np.broadcast_to(self._apart(self._mutated(mutant), self.values[mutant.place]), self.count)

    def _mutated(self, mutant: Mutant) -> Any:
        op = mutant.operation
        assert op is not None
        x = [self.values[i] for i in op.operands]
        if op.name == "copy":
            return np.asarray(x[0], dtype=self.real.numbers)
        with np.errstate(all="ignore"):
            found = value(op, x, self.inputs, self.real)
        return np.logical_not(found) if mutant.denied else found

    def _apart(self, a: Any, b: Any) -> Array:
        """Whether two values differ in a bit, entry by entry; NaNs count as equal."""
        a, b = np.asarray(a), np.asarray(b)
        if a.dtype == bool and b.dtype == bool:
            return np.asarray(a != b)
        a, b = np.asarray(a, dtype=self.real.numbers), np.asarray(b, dtype=self.real.numbers)
        bits = np.dtype(f"u{a.itemsize}")
        apart = np.asarray(a.view(bits) != b.view(bits))
        return apart & ~(np.isnan(a) & np.isnan(b)) if apart.any() else apart
