"""Evaluates an operation list in the number type of a target, for many columns of inputs at once."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from barbalat.lowering.c99 import Real
from barbalat.lowering.functions import function
from barbalat.lowering.operations import COMPARISONS, Operation, Program
from barbalat.validate import Array

Inputs = Mapping[tuple[int, int], Any]
"""The inputs of a list by (argument, component), each a single number or one for each column."""


def _lookup(x: Array, table: tuple[float, ...]) -> Array:
    with np.errstate(invalid="ignore"):  # for a NaN argument the caller uses a different value
        places = np.clip(np.nan_to_num(x).astype(int), 0, len(table) - 1)
    return np.array(table)[places]


_TRUTH: dict[str, Callable[..., Any]] = {
    "lt": operator.lt, "le": operator.le, "eq": operator.eq, "ne": operator.ne,
    "and": np.logical_and, "or": np.logical_or, "not": np.logical_not,
}  # fmt: skip
_NUMBERS: dict[str, Callable[..., Any]] = {
    "add": operator.add, "sub": operator.sub, "mul": operator.mul, "div": operator.truediv, "neg": operator.neg,
    "sqrt": np.sqrt, "fabs": np.abs, "floor": np.floor, "ceil": np.ceil, "copysign": np.copysign,
    "fmin": lambda a, b: np.where(a > b, b, a), "fmax": lambda a, b: np.where(a < b, b, a),
    "exponent": lambda x: np.frexp(np.abs(x))[1] - 1, "significand": lambda x: 2 * np.frexp(np.abs(x))[0],
    "pow2": np.exp2,
}  # fmt: skip
"""Operations with a unique rounding by IEEE 754, and operations on the bits of a normal number."""


def evaluate(program: Program, inputs: Inputs, real: Real) -> Array:
    """The first output, (components, columns); every operation is rounded as ``real`` rounds, including sin, exp and similar
    functions."""
    found = values(program, inputs, real)
    made = [_number(found[i], real) for i in program.outputs[0]]
    shape = max((one.shape for one in made), key=len)
    return np.array([np.broadcast_to(one, shape) for one in made])


def values(program: Program, inputs: Inputs, real: Real) -> list[Any]:
    """The value of each operation: an array of numbers or of truth values, or a single value if it does not depend on the
    columns."""
    found: list[Any] = []
    with np.errstate(all="ignore"):
        for op in program.operations:
            found.append(value(op, [found[i] for i in op.operands], inputs, real))
    return found


def value(op: Operation, x: Sequence[Any], inputs: Inputs, real: Real) -> Any:
    """The value of an operation from the values of its operands."""
    numbers = real.numbers
    if (made := _NUMBERS.get(op.name)) is not None:
        return _number(made(*[_number(one, real) for one in x]), real)
    if op.name == "constant":
        return numbers(op.value)
    if op.name == "input":
        return np.asarray(inputs[op.source], dtype=numbers)
    if op.name in COMPARISONS:
        return _TRUTH[op.name](*x)
    if op.name in ("select", "if_else_zero"):
        other = _number(x[2], real) if op.name == "select" else numbers(0.0)
        return np.where(x[0], _number(x[1], real), other)
    if op.name == "lookup":
        return _number(_lookup(x[0], op.table), real)
    return _called(op.name, [_number(one, real) for one in x], real)


def _number(x: Any, real: Real) -> Any:
    """A truth value as 1 or 0, and every number in the target's type."""
    return np.asarray(x, dtype=real.numbers)


def _called(name: str, arguments: list[Any], real: Real) -> Any:
    """A function, evaluated by its operation list, or by the list for rare arguments where the usual list requests it."""
    made, inputs = function(name, real.format), {(i, 0): value for i, value in enumerate(arguments)}
    usual = values(made.usual, inputs, real)
    found = usual[made.usual.outputs[0][0]]
    if made.rare is None or not np.any(rarely := usual[made.usual.outputs[1][0]]):
        return found
    return np.where(rarely, values(made.rare, inputs, real)[made.rare.outputs[0][0]], found)
