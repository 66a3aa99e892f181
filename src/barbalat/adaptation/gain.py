"""Adaptive gains Gamma > 0: a number, a diagonal (n,) or a symmetric positive definite matrix (n, n)."""

from __future__ import annotations

from typing import Any

import numpy as np

from barbalat import validate
from barbalat.protocols import Value
from barbalat.validate import Array, InputError


def accept(field: str, value: Any) -> Any:
    """A positive number as a float, a positive diagonal or an s.p.d. matrix as a read-only array; InputError for others."""
    if isinstance(value, (bool, int, float, np.integer, np.floating)):
        return validate.positive(field, value)
    kinds = f"{field} must be a positive number, a list of them (a diagonal) or a symmetric positive definite matrix"
    dimensions = validate.dimensions(value)
    if dimensions == 1:
        diagonal = validate.vector(field, value)
        if not (diagonal > 0).all():
            raise InputError(f"{kinds}, got {validate.show(diagonal)}")
        return diagonal
    if dimensions == 2:
        matrix = validate.square_matrix(field, value)
        if (matrix != matrix.T).any() or not _is_positive_definite(matrix):
            raise InputError(f"{kinds}, got {validate.show(matrix)}")
        return matrix
    raise InputError(f"{kinds}, got {validate.show(value)}")


def _is_positive_definite(matrix: Array) -> bool:
    """Beyond rounding: the smallest eigenvalue is computed with an error of the order of eps times the largest."""
    eigenvalues = np.linalg.eigvalsh(matrix)
    return bool(eigenvalues[0] > len(matrix) * np.finfo(float).eps * eigenvalues[-1])


def require_size(field: str, gain: Any, n: int) -> None:
    """InputError where a diagonal or a matrix is not of the size of the problem."""
    shape = getattr(gain, "shape", ())
    if shape not in ((), (n,), (n, n)):
        raise InputError(f"{field} must fit the {n} parameters, got {' x '.join(map(str, shape))}: {validate.show(gain)}")


def is_matrix(gain: Value) -> bool:
    """Whether the gain, in numbers or symbols, is an (n, n) array."""
    return len(getattr(gain, "shape", ())) == 2


def times(gain: Value, vector: Value) -> Value:
    """Gamma v."""
    return gain @ vector if is_matrix(gain) else gain * vector


def scaled(gain: Value, scalar: Value, vector: Value) -> Value:
    """Gamma s v, for a number s."""
    return gain @ (scalar * vector) if is_matrix(gain) else gain * scalar * vector


def as_matrix(gain: Any, n: int) -> Array:
    """The gain as an (n, n) array."""
    return np.array(gain) if is_matrix(gain) else gain * np.eye(n)
