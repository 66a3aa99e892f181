"""Formulas in named variables: parsed, never executed."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.protocols import Value
from barbalat.validate import InputError

_FUNCTIONS: dict[str, Callable[[Value], Value]] = {
    "abs": np.abs, "exp": np.exp, "sin": np.sin, "cos": np.cos, "sqrt": np.sqrt, "tanh": np.tanh,
}  # fmt: skip


_OPERATORS: dict[type, Callable[[Value, Value], Value]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a**b,
}

Evaluation = Callable[[Mapping[str, Value]], Value]
"""From the variables' values by name, by whatever arithmetic they have."""


@dataclass(frozen=True)
class Variables:
    """Which names a formula may use: a regular expression, and how a message speaks of them."""

    pattern: str
    shown: str


@dataclass(frozen=True, eq=False)
class Formula:
    """What was parsed, and the variables in it."""

    names: frozenset[str]
    evaluate: Evaluation


def formula(field: str, text: Any, variables: Variables) -> Formula:
    """The text as a formula; InputError, which names the field, where it is none or uses anything else."""
    if not isinstance(text, str):
        raise _refusal(field, text, variables)
    return _parsed(field, text, variables)


def _refusal(field: str, text: Any, variables: Variables, part: ast.AST | None = None) -> InputError:
    found = "" if part is None else f", which contains {ast.unparse(part)!r}"
    return InputError(
        f"{field} must be a formula in {variables.shown}, numbers, + - * / ** and {', '.join(_FUNCTIONS)}, "
        f"got {validate.show(text)}{found}"
    )


@cache
def _parsed(field: str, text: str, variables: Variables) -> Formula:
    names: set[str] = set()

    def build(node: ast.expr) -> Evaluation:
        match node:
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                return lambda _: float(value)
            case ast.Name(id=name) if re.fullmatch(variables.pattern, name):
                names.add(name)
                return lambda given: given[name]
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                inner = build(operand)
                return lambda given: -inner(given)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                if isinstance(op, ast.Pow) and not isinstance(right, ast.Constant):
                    raise _refusal(field, text, variables, node)
                combine, a, b = _OPERATORS[type(op)], build(left), build(right)
                return lambda given: combine(a(given), b(given))
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in _FUNCTIONS:
                function, inner = _FUNCTIONS[name], build(argument)
                return lambda given: function(inner(given))
        raise _refusal(field, text, variables, node)

    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        raise _refusal(field, text, variables) from None
    evaluate = build(tree)
    return Formula(frozenset(names), evaluate)
