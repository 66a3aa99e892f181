"""Formulas in named variables. They are parsed and never executed."""

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
FUNCTION_NAMES = tuple(_FUNCTIONS)


BEND_OF_ABS = "the zero of an abs(...) or sqrt(...) in a formula"
"""How runs name this corner of a rate."""

_OPERATORS: dict[type, Callable[[Value, Value], Value]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a**b,
}

Evaluation = Callable[[Mapping[str, Value]], Value]
"""A function of the variables' values by name, evaluated in the arithmetic of their type."""


@dataclass(frozen=True)
class FormulaNames:
    """The names that a formula may use, as a regular expression, and their description for messages."""

    pattern: str
    shown: str


DEEPEST_NESTING = 400
"""Deepest nesting of a formula. Python allows 1000 nested calls; the rest is left to the caller."""


@dataclass(frozen=True, eq=False)
class Formula:
    """A parsed formula and its variables."""

    names: frozenset[str]
    evaluate: Evaluation
    bends: bool
    """Whether the formula uses abs or sqrt, whose slope jumps or is unbounded at zero."""


def formula(field: str, text: Any, variables: FormulaNames) -> Formula:
    """Parse the text of a formula. Raises InputError, with the field, if it is not a formula or uses anything that is not
    admitted."""
    if not isinstance(text, str):
        raise _refusal(field, text, variables)
    return _parsed(field, text, variables)


def _refusal(field: str, text: Any, variables: FormulaNames, part: ast.AST | None = None) -> InputError:
    found = "" if part is None else f", which contains {ast.unparse(part)!r}"
    return InputError.of(
        field,
        f"must be a formula in {variables.shown}, numbers, + - * / ** and {', '.join(_FUNCTIONS)}, "
        f"got {validate.show(text)}{found}",
    )


@cache
def _parsed(field: str, text: str, variables: FormulaNames) -> Formula:
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        raise _refusal(field, text, variables) from None
    reader = _Reader(field, text, variables)
    evaluate, _ = reader.read(tree, 0)
    bends = any(isinstance(part, ast.Name) and part.id in ("abs", "sqrt") for part in ast.walk(tree))
    return Formula(frozenset(reader.names), evaluate, bends)


class _Reader:
    """Reads the parts of one formula; ``names`` collects its variables."""

    def __init__(self, field: str, text: str, variables: FormulaNames) -> None:
        self.field, self.text, self.variables = field, text, variables
        self.names: set[str] = set()

    def read(self, node: ast.expr, depth: int) -> tuple[Evaluation, bool]:
        """Return a part as a function of the variables, and whether it is a constant, which must be a finite real number."""
        if depth > DEEPEST_NESTING:
            raise InputError.of(
                self.field, f"must not be nested more than {DEEPEST_NESTING} deep, got {validate.show(self.text)}"
            )
        evaluate, parts = self._combined(node, depth + 1)
        if isinstance(node, ast.Name) or not all(constant for _, constant in parts):
            self._require_divisor(node, parts)
            return evaluate, False
        value = _number(evaluate)
        if value is None:
            raise self._unusable(node, "is not a finite real number: it divides by zero, is too large, or has no real value")
        return (lambda _: value), True

    def _combined(self, node: ast.expr, depth: int) -> tuple[Evaluation, list[tuple[Evaluation, bool]]]:
        """Return the operands of a part and the function that combines them."""
        match node:
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                return (lambda _: float(value)), []
            case ast.Name(id=name) if re.fullmatch(self.variables.pattern, name):
                self.names.add(name)
                return (lambda given: given[name]), []
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                inner = self.read(operand, depth)
                return (lambda given: -inner[0](given)), [inner]
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                if isinstance(op, ast.Pow) and not isinstance(right, ast.Constant):
                    why = "; an exponent must be a positive number: write 1/(J**2) for J**-2"
                    raise InputError(f"{_refusal(self.field, self.text, self.variables, node)}{why}", field=self.field)
                combine, a, b = _OPERATORS[type(op)], self.read(left, depth), self.read(right, depth)
                return (lambda given: combine(a[0](given), b[0](given))), [a, b]
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in _FUNCTIONS:
                function, inner = _FUNCTIONS[name], self.read(argument, depth)
                return (lambda given: function(inner[0](given))), [inner]
        raise _refusal(self.field, self.text, self.variables, node)

    def _require_divisor(self, node: ast.expr, parts: list[tuple[Evaluation, bool]]) -> None:
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div):
            divisor, constant = parts[1]
            if constant and divisor({}) == 0:
                raise self._unusable(node, "divides by zero")

    def _unusable(self, node: ast.expr, why: str) -> InputError:
        part = validate.show(ast.unparse(node))
        return InputError.of(self.field, f"must have a finite real value, got {validate.show(self.text)}, of which {part} {why}")


def _number(evaluate: Evaluation) -> float | None:
    """Return the value of a constant if it is a finite real number; otherwise None."""
    try:
        with np.errstate(all="ignore"):
            value = evaluate({})
    except (ArithmeticError, ValueError):
        return None
    return None if isinstance(value, complex) or not np.isfinite(value) else float(value)
