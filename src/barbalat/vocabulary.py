"""The operations of CasADi that equations may use: those that every backend supports."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import casadi

BINARY = "ADD SUB MUL DIV LT LE EQ NE AND OR FMIN FMAX POW CONSTPOW COPYSIGN IF_ELSE_ZERO"
UNARY = "NEG INV SQRT FABS NOT EXP LOG SIN COS TAN TANH ATAN FLOOR CEIL SQ TWICE SIGN"

BENDING = frozenset({"fabs", "fmin", "fmax"})
"""Operations with a discontinuous slope."""
JUMPING = frozenset({"sign", "lt", "le", "eq", "ne", "not", "and", "or", "floor", "ceil", "copysign", "if_else_zero"})
"""Operations with a discontinuous value."""


@cache
def names() -> dict[int, str]:
    """The names of the operations by CasADi's codes."""
    import casadi as ca

    return {getattr(ca, f"OP_{name}"): name.lower() for name in f"{BINARY} {UNARY}".split()}


def used(function: casadi.Function) -> frozenset[str]:
    """Return the operations that occur in a function of scalar expressions."""
    codes = _codes(function)
    return frozenset(name for code, name in names().items() if code in codes)


def unknown(function: casadi.Function) -> list[str]:
    """The operations in a function that are not supported, by CasADi's names: "sinh", "atan2"."""
    import casadi as ca

    codes = _codes(function) - names().keys() - {ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT}
    return sorted(name[3:].lower() for name in dir(ca) if name.startswith("OP_") and getattr(ca, name) in codes)


def _codes(function: casadi.Function) -> set[int]:
    return {function.instruction_id(k) for k in range(function.n_instructions())}
