"""An operation list evaluated in Python, one operation after another, with the numbers of a target: slow, plain, independent."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping

import numpy as np

from barbalat.lowering.c99 import Real
from barbalat.lowering.functions import FUNCTIONS, function
from barbalat.lowering.operations import Operation, Program
from barbalat.validate import Array

_TRUTH: dict[str, Callable[..., object]] = {
    "lt": operator.lt, "le": operator.le, "eq": operator.eq, "ne": operator.ne,
    "and": lambda a, b: bool(a) and bool(b), "or": lambda a, b: bool(a) or bool(b), "not": lambda a: not a,
}  # fmt: skip
_NUMBERS: dict[str, Callable[..., object]] = {
    "add": operator.add, "sub": operator.sub, "mul": operator.mul, "div": operator.truediv, "neg": operator.neg,
    "sqrt": np.sqrt, "fabs": np.abs, "floor": np.floor, "ceil": np.ceil, "copysign": np.copysign,
    "fmin": lambda a, b: b if a > b else a, "fmax": lambda a, b: b if a < b else a,
    "select": lambda c, a, b: a if c else b,
    "exponent": lambda x: np.frexp(np.abs(x))[1] - 1, "significand": lambda x: 2 * np.frexp(np.abs(x))[0],
    "pow2": np.exp2,
}  # fmt: skip
"""Operations that IEEE 754 rounds in one way only, and those on the bits of a normal number."""


def evaluate(program: Program, inputs: Mapping[tuple[int, int], object], real: Real) -> Array:
    """The first output; every operation is rounded as by ``real``, also those of sin, exp and the like, which are lists too."""
    with np.errstate(all="ignore"):
        values = _values(program, inputs, real)
        return np.array([real.numbers(values[i]) for i in program.outputs[0]])  # type: ignore[arg-type]


def _values(program: Program, inputs: Mapping[tuple[int, int], object], real: Real) -> list[object]:
    values: list[object] = []
    for op in program.operations:
        values.append(_value(op, values, inputs, real))
    return values


def _called(name: str, arguments: list[object], real: Real) -> object:
    """A function by its own list; by the rare one where the usual one says so."""
    made, inputs = function(name, real.format), {(i, 0): value for i, value in enumerate(arguments)}
    usual = _values(made.usual, inputs, real)
    if made.rare is not None and usual[made.usual.outputs[1][0]]:
        return _values(made.rare, inputs, real)[made.rare.outputs[0][0]]
    return usual[made.usual.outputs[0][0]]


def _value(op: Operation, values: list[object], inputs: Mapping[tuple[int, int], object], real: Real) -> object:
    numbers = real.numbers
    if op.name == "constant":
        return numbers(op.value)
    if op.name == "input":
        return numbers(inputs[op.source])  # type: ignore[arg-type]
    x = [values[i] for i in op.operands]
    if op.name in _TRUTH:
        return bool(_TRUTH[op.name](*x))
    if op.name == "if_else_zero":
        return x[1] if x[0] else numbers(0.0)
    if op.name == "lookup":
        return numbers(op.table[int(x[0])])  # type: ignore[call-overload]
    first = 1 if op.name == "select" else 0
    rounded = [numbers(one) for one in x[first:]]  # type: ignore[arg-type]
    if op.name in FUNCTIONS:
        return _called(op.name, list(rounded), real)
    return numbers(_NUMBERS[op.name](*x[:first], *rounded))  # type: ignore[arg-type]
