"""The terms of a regressor, written as formulas: parsed, never executed."""

from __future__ import annotations

import ast
from collections.abc import Callable
from functools import cache

import numpy as np

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


def _tree(term: str) -> ast.expr:
    try:
        return ast.parse(term.strip(), mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        raise InputError(f"plant.regressor.terms: {term!r} is not a formula") from None


def states_of(term: str) -> int:
    """The largest number of a state in a formula."""
    return max(
        (int(node.id[1:]) for node in ast.walk(_tree(term)) if isinstance(node, ast.Name) and node.id[1:].isdigit()), default=0
    )


@cache
def formula(term: str) -> Callable[[Value], Value]:
    """A formula as a function of x; nothing but the operations named above can be in it."""

    def refuse(node: ast.AST) -> InputError:
        return InputError(
            f"plant.regressor.terms: {term!r} may contain x1, x2, ..., numbers, + - * / ** and {', '.join(_FUNCTIONS)}, "
            f"not {ast.unparse(node)!r}"
        )

    def build(node: ast.expr) -> Callable[[Value], Value]:
        match node:
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                return lambda _: float(value)
            case ast.Name(id=name) if name[0] == "x" and name[1:].isdigit() and int(name[1:]) >= 1:
                index = int(name[1:]) - 1
                return lambda x: x[index]
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                inner = build(operand)
                return lambda x: -inner(x)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                if isinstance(op, ast.Pow) and not isinstance(right, ast.Constant):
                    raise refuse(node)
                combine, a, b = _OPERATORS[type(op)], build(left), build(right)
                return lambda x: combine(a(x), b(x))
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in _FUNCTIONS:
                function, inner = _FUNCTIONS[name], build(argument)
                return lambda x: function(inner(x))
        raise refuse(node)

    return build(_tree(term))
