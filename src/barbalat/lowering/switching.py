"""Turns the choices of an expression with jumps or corners into inputs: with constant choices it is smooth, and a step can end
where a choice changes.

A choice is a condition of ``np.where``, the side that a minimum, a maximum or a magnitude takes, or a comparison used as a
number. Conditions joined by and, or or not form one choice. This module contains no control theory.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from barbalat import vocabulary

if TYPE_CHECKING:
    import casadi as ca

COUNTLESS = frozenset({"floor", "ceil", "copysign"})
"""Operations with more than two branches, which cannot be represented by a choice between two sides."""


class CountlessError(ValueError):
    """The expression contains one of COUNTLESS; the error names it."""


class Condition(NamedTuple):
    """A condition whose outcome is an input.

    truth   whether the condition holds
    margin  positive where it holds, negative where it does not, continuous wherever its operands are
    size    the magnitude of the compared values
    """

    truth: Any
    margin: Any
    size: Any


class Switched(NamedTuple):
    """An expression with its J choices as inputs.

    values      values with the given choices
    conditions  the conditions of all choices at the given arguments, if the choices have the given values
    """

    values: list[Any]
    conditions: list[Condition]


def switched(function: ca.Function, arguments: list[Any], choices: Any = None) -> Switched:
    """The function of these arguments, columns of expressions, with its choices as ``choices``, a column of J numbers 0 or 1.

    Without ``choices``, each choice follows from its condition, so that the truth values of the conditions are the choices at
    these arguments. Raises CountlessError for an expression with an operation of ``COUNTLESS``.
    """
    import casadi as ca

    reading = _Reading(choices)
    entries: list[list[Any]] = [[0] * function.nnz_out(k) for k in range(function.n_out())]
    for k in range(function.n_instructions()):
        code, given, target = function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)
        if code == ca.OP_CONST:
            reading.work[target[0]] = ca.SX(function.instruction_constant(k))
        elif code == ca.OP_INPUT:
            reading.work[target[0]] = arguments[given[0]][given[1]]
        elif code == ca.OP_OUTPUT:
            entries[target[0]][target[1]] = reading.number(given[0])
        else:
            reading.work[target[0]] = reading.operation(k, code, given)
    return Switched([ca.vertcat(*row) if row else ca.SX(0, 1) for row in entries], reading.conditions)


class _Compared(NamedTuple):
    """A condition that has not yet been used as a number; ``key`` names it, negated or not."""

    key: int
    condition: Condition
    negated: bool = False

    @property
    def signed(self) -> Condition:
        import casadi as ca

        truth, margin, size = self.condition
        return Condition(ca.logic_not(truth), -margin, size) if self.negated else self.condition


@dataclass
class _Reading:
    """One pass over a function's instructions.

    choices  the choices, or None if each follows from its condition
    work     the content of CasADi's work vector: expressions, and comparisons
    """

    choices: Any
    conditions: list[Condition] = field(default_factory=list)
    places: dict[int, int] = field(default_factory=dict)
    work: dict[int, Any] = field(default_factory=dict)

    def chosen(self, key: int, condition: Condition) -> Any:
        """The choice as a number, 0 or 1; ``key`` names the condition, which may be used several times."""
        if condition.truth.is_constant():
            return condition.truth
        if key not in self.places:
            self.places[key] = len(self.conditions)
            self.conditions.append(condition)
        return condition.truth if self.choices is None else self.choices[self.places[key]]

    def number(self, place: int) -> Any:
        """The value at a position of the work vector, as a number."""
        import casadi as ca

        value = self.work[place]
        if not isinstance(value, _Compared):
            return value
        found = self.chosen(value.key, value.condition)
        return ca.logic_not(found) if value.negated else found

    def operation(self, k: int, code: int, given: list[int]) -> Any:
        """The result of instruction ``k``, whose operands are at the places ``given``."""
        import casadi as ca

        name, values = vocabulary.names().get(code, ""), [self.work[i] for i in given]
        if name in COUNTLESS:
            raise CountlessError(name)
        if name in ("not", "and", "or") and all(isinstance(value, _Compared) for value in values):
            return self._joined(k, name, values)
        numbers = [self.number(i) for i in given]
        if name in ("lt", "le", "fmin", "fmax", "fabs", "sign"):
            return self._choice(k, name, numbers)
        if len(numbers) == 2 and name not in (
            "sq",
            "twice",
            "inv",
        ):  # these operations have one operand, which CasADi lists twice
            return ca.SX.binary(code, *numbers)
        return ca.SX.unary(code, numbers[0])

    @staticmethod
    def _joined(k: int, name: str, values: list[_Compared]) -> _Compared:
        import casadi as ca

        if name == "not":
            (one,) = values
            return one._replace(negated=not one.negated)
        a, b = (value.signed for value in values)
        if name == "and":
            return _Compared(k, Condition(ca.logic_and(a.truth, b.truth), ca.fmin(a.margin, b.margin), a.size + b.size))
        return _Compared(k, Condition(ca.logic_or(a.truth, b.truth), ca.fmax(a.margin, b.margin), a.size + b.size))

    def _choice(self, k: int, name: str, numbers: list[Any]) -> Any:
        import casadi as ca

        a, size = numbers[0], sum(map(ca.fabs, numbers))
        if name == "fabs":
            return ca.if_else(self.chosen(k, Condition(a < 0, -a, size)), -a, a)
        if name == "sign":
            above, below = (
                self.chosen(2 * k + 1, Condition(a > 0, a, size)),
                self.chosen(-2 * k - 1, Condition(a < 0, -a, size)),
            )
            return above - below
        b = numbers[1]
        if name in ("lt", "le"):
            return _Compared(k, Condition(a < b if name == "lt" else a <= b, b - a, size))
        other, margin = (b < a, a - b) if name == "fmin" else (a < b, b - a)
        return ca.if_else(self.chosen(k, Condition(other, margin, size)), b, a)
