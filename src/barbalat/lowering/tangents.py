"""Derivatives of an operation list along several directions at once: the same list, followed by the operations of its tangents.

The operations of the original list are unchanged, so its values keep their bits. The tangent of a selection, a minimum or a
maximum is that of the selected branch; comparisons, and anything rounded to an integer, have no tangent.
"""

from __future__ import annotations

from collections.abc import Callable

from barbalat.lowering.operations import COMPARISONS, Operation, Program
from barbalat.lowering.optimize import drop_dead

Tangents = Callable[[tuple[int, int]], tuple[tuple[int, int] | None, ...]]
"""The inputs (argument, component) that contain the tangents of an input along each direction; None for a zero tangent."""
FLAT = COMPARISONS | {"floor", "ceil"}
"""Operations whose slope is zero wherever it exists."""


class Tangented:
    """A list to which the tangents of its operations are appended.

    operations  the list so far
    place       by position in the original list, the position of its value
    """

    def __init__(self, program: Program, directions: int, placed: Callable[[tuple[int, int]], tuple[int, int]]) -> None:
        """``placed`` returns the new source of an input of the original list."""
        self.program, self.directions = program, directions
        self.operations: list[Operation] = []
        self.known: dict[Operation, int] = {}
        self.fused = any(op.name in ("fma", "fnma") for op in program.operations)
        self.place: list[int] = []
        for op in program.operations:
            source = placed(op.source) if op.name == "input" else op.source
            self.operations.append(op._replace(operands=tuple([self.place[j] for j in op.operands]), source=source))
            self.place.append(len(self.operations) - 1)
        self.by_direction: list[list[int | None]] = [[] for _ in range(directions)]

    def differentiate(self, tangents: Tangents) -> None:
        """Append the tangents of all operations; ValueError for an operation without a derivative."""
        for i, op in enumerate(self.program.operations):
            inputs = tangents(op.source) if op.name == "input" else ()
            for d, known in enumerate(self.by_direction):
                if op.name == "input":
                    source = inputs[d]
                    known.append(None if source is None else self.emit("input", source=source))
                    continue
                given = [known[j] for j in op.operands]
                none = op.name in FLAT or all(one is None for one in given)
                known.append(None if none else self._slope(i, op, given))

    def emit(self, name: str, *operands: int, value: float = 0.0, source: tuple[int, int] = (0, 0)) -> int:
        """Append an operation unless it already exists; return its position."""
        op = Operation(name, operands, value, source)
        if op not in self.known:
            self.operations.append(op)
            self.known[op] = len(self.operations) - 1
        return self.known[op]

    def constant(self, value: float) -> int:
        return self.emit("constant", value=value)

    def or_zero(self, position: int | None) -> int:
        return self.constant(0.0) if position is None else position

    def _scaled(self, factor: int, tangent: int | None) -> int | None:
        return None if tangent is None else self.emit("mul", factor, tangent)

    def _plus(self, one: int | None, other: int | None) -> int | None:
        if one is None or other is None:
            return other if one is None else one
        return self.emit("add", one, other)

    def _sum_of_products(self, factor: int, tangent: int | None, rest: int | None) -> int | None:
        """factor times tangent plus rest."""
        if tangent is None or rest is None or not self.fused:
            return self._plus(self._scaled(factor, tangent), rest)
        return self.emit("fma", factor, tangent, rest)

    def _negated(self, tangent: int | None) -> int | None:
        return None if tangent is None else self.emit("neg", tangent)

    def _chosen(self, condition: int, one: int | None, other: int | None) -> int:
        return self.emit("select", condition, self.or_zero(one), self.or_zero(other))

    def _slope(self, i: int, op: Operation, given: list[int | None]) -> int | None:
        """The tangent of operation i, whose operands have the tangents ``given``, at least one of which is not zero."""
        value, x = self.place[i], [self.place[j] for j in op.operands]
        d = [*given, None, None]
        match op.name:
            case "add":
                return self._plus(d[0], d[1])
            case "sub":
                if d[0] is None or d[1] is None:
                    return d[0] if d[1] is None else self._negated(d[1])
                return self.emit("sub", d[0], d[1])
            case "neg":
                return self._negated(d[0])
            case "mul" | "fma" | "fnma":
                product = self._sum_of_products(x[0], d[1], self._scaled(x[1], d[0]))
                return self._plus(self._negated(product) if op.name == "fnma" else product, d[2])
            case "div":
                reciprocal = self.emit("div", self.constant(1.0), x[1])
                above = self._plus(d[0], self._negated(self._scaled(value, d[1])))
                return self._scaled(reciprocal, above)
            case "fmin" | "fmax":
                second = self.emit("lt", *(x if op.name == "fmax" else reversed(x)))
                return self._chosen(second, d[1], d[0])
            case "select":
                return self._chosen(x[0], d[1], d[2])
            case "if_else_zero":
                return None if d[1] is None else self._chosen(x[0], d[1], None)
            case "fabs":
                return self._chosen(self.emit("lt", x[0], self.constant(0.0)), self._negated(d[0]), d[0])
            case "copysign":
                turned = self.emit("lt", self.emit("mul", x[0], value), self.constant(0.0))
                return None if d[0] is None else self._chosen(turned, self._negated(d[0]), d[0])
            case "pow":
                return self._of_power(value, x, d)
        return self._scaled(self._factor(op.name, value, x[0]), d[0])

    def _of_power(self, value: int, x: list[int], d: list[int | None]) -> int | None:
        lower = self.emit("mul", x[1], self.emit("pow", x[0], self.emit("sub", x[1], self.constant(1.0))))
        grown = None if d[1] is None else self._scaled(self.emit("mul", value, self.emit("log", x[0])), d[1])
        return self._sum_of_products(lower, d[0], grown)

    def _factor(self, name: str, value: int, x: int) -> int:
        """The derivative of a function of one number."""
        one = self.constant(1.0)
        match name:
            case "sqrt":  # zero at zero, where a root of a sum of squares has a corner
                return self._chosen(value, self.emit("div", self.constant(0.5), value), None)
            case "exp":
                return value
            case "log":
                return self.emit("div", one, x)
            case "sin":
                return self.emit("cos", x)
            case "cos":
                return self.emit("neg", self.emit("sin", x))
            case "tan":
                return self.emit("add", one, self.emit("mul", value, value))
            case "tanh":
                return self.emit("sub", one, self.emit("mul", value, value))
            case "atan":
                return self.emit("div", one, self.emit("add", one, self.emit("mul", x, x)))
        raise ValueError(f"the operation {name} has no derivative")

    def made(self, outputs: tuple[tuple[int, ...], ...]) -> Program:
        """The list with these outputs, without operations that they do not need."""
        return drop_dead(Program(tuple(self.operations), outputs))
