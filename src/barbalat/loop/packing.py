"""Nested named tuples of arrays <-> flat vectors; symbols and columns of CasADi."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from barbalat.protocols import Value

if TYPE_CHECKING:
    import casadi


def flatten(state: Any) -> Value:
    """All arrays of a nested NamedTuple, one after another, row by row."""
    return np.concatenate([leaf if leaf.ndim == 1 else leaf.reshape(-1) for leaf in _leaves(state)])


def map_arrays(function: Any, state: Any) -> Any:
    """A nested NamedTuple with the function applied to every array."""
    if isinstance(state, tuple):
        parts = [map_arrays(function, part) for part in state]
        return _like(state, parts)
    return function(state)


def _like(template: Any, parts: list[Any]) -> Any:
    """A tuple of the template's kind: plain, or named."""
    return tuple(parts) if type(template) is tuple else type(template)(*parts)


def _leaves(state: Any) -> list[Value]:
    found: list[Value] = []
    for part in state if isinstance(state, tuple) else (state,):
        if isinstance(part, tuple):
            found += _leaves(part)
        else:
            found.append(as_array(part))
    return found


def as_array(value: Value) -> Value:
    """A plain number as an array; arrays of numbers or expressions as they are."""
    return np.asarray(value) if isinstance(value, (int, float)) else value


def unflatten(template: Any, flat: Value, start: int) -> tuple[Any, int]:
    """The inverse of ``flatten`` for the shapes of ``template``; also where the next part starts."""
    if isinstance(template, tuple):
        parts = []
        for part in template:
            value, start = unflatten(part, flat, start)
            parts.append(value)
        return _like(template, parts), start
    shape = template.shape
    size = math.prod(shape)
    part = flat[start : start + size]
    return part if len(shape) == 1 else part.reshape(shape), start + size


def symbols(name: str, size: int) -> tuple[casadi.SX, Value]:
    """A column of symbols, as CasADi's matrix and as the array (size,) that equations compute with."""
    import casadi as ca

    matrix = ca.SX.sym(name, size)
    return matrix, ca.array(matrix).reshape(-1)


def column(value: Value) -> casadi.SX:
    """An array of expressions as a CasADi column."""
    import casadi as ca

    return ca.SX(value.reshape(-1))
