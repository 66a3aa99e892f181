"""An operation list evaluated in Python, one operation after another, with the numbers of a target: slow, plain, independent."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping

import numpy as np

from barbalat.lowering.operations import Operation, Program
from barbalat.validate import Array, InputError

_TRUTH: dict[str, Callable[..., object]] = {
    "lt": operator.lt, "le": operator.le, "eq": operator.eq, "ne": operator.ne,
    "and": lambda a, b: bool(a) and bool(b), "or": lambda a, b: bool(a) or bool(b), "not": lambda a: not a,
}  # fmt: skip
_NUMBERS: dict[str, Callable[..., object]] = {
    "add": operator.add, "sub": operator.sub, "mul": operator.mul, "div": operator.truediv, "neg": operator.neg,
    "sqrt": np.sqrt, "fabs": np.abs, "floor": np.floor, "ceil": np.ceil, "copysign": np.copysign,
    "fmin": lambda a, b: b if a > b else a, "fmax": lambda a, b: b if a < b else a,
    "select": lambda c, a, b: a if c else b,
}  # fmt: skip
"""Operations that IEEE 754 rounds in one way only."""


def evaluate(program: Program, inputs: Mapping[tuple[int, int], object], numbers: type[np.floating]) -> Array:
    """The first output; every operation is rounded to ``numbers``. InputError for a function of lists that have 64 bits."""
    values: list[object] = []
    with np.errstate(all="ignore"):
        for op in program.operations:
            values.append(_value(op, values, inputs, numbers))
        return np.array([numbers(values[i]) for i in program.outputs[0]])  # type: ignore[arg-type]


def _value(op: Operation, values: list[object], inputs: Mapping[tuple[int, int], object], numbers: type[np.floating]) -> object:
    if op.name == "constant":
        return numbers(op.value)
    if op.name == "input":
        return numbers(inputs[op.source])  # type: ignore[arg-type]
    x = [values[i] for i in op.operands]
    if op.name in _TRUTH:
        return bool(_TRUTH[op.name](*x))
    if op.name == "if_else_zero":
        return x[1] if x[0] else numbers(0.0)
    if op.name not in _NUMBERS:
        raise InputError(
            f"float32 takes controllers of + - * /, sqrt and comparisons, and this one calls {op.name}, which has no list of its "
            "own in 32 bits; export it in float64"
        )
    first = 1 if op.name == "select" else 0
    return _NUMBERS[op.name](*x[:first], *(numbers(one) for one in x[first:]))  # type: ignore[arg-type]
