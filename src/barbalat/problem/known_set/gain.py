"""Adaptive gains Gamma > 0: a number, a diagonal (n,) or a symmetric positive definite matrix (n, n)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from barbalat import validate
from barbalat.protocols import Value
from barbalat.validate import Array, InputError


@dataclass(frozen=True, eq=False)
class Gain:
    """The gain or covariance of a law, of any of the three kinds, in numbers or symbols."""

    value: Value
    dimensions: int = field(init=False, repr=False)  # 0 for a number, 1 for a diagonal, 2 for a matrix

    def __post_init__(self) -> None:
        object.__setattr__(self, "dimensions", 0 if isinstance(self.value, (int, float)) else self.value.ndim)

    @property
    def is_matrix(self) -> bool:
        return self.dimensions == 2

    @property
    def couples(self) -> bool:
        """Whether a parameter's rate depends on another parameter's: true for a matrix that is not diagonal."""
        return self.is_matrix and bool((self.value - np.diag(np.diag(self.value))).any())

    def require_size(self, field: str, n: int) -> None:
        """Raise InputError if a diagonal or a matrix does not have the size of the problem."""
        if self.dimensions and self.value.shape not in ((n,), (n, n)):
            got = f"{' x '.join(map(str, self.value.shape))}: {validate.show(self.value)}"
            raise InputError.of(field, f"must fit the {validate.counted(n, 'parameter')}, got {got}")

    @property
    def largest(self) -> float:
        """The largest eigenvalue, up to rounding, or the number itself."""
        return float(np.linalg.eigvalsh(self.value)[-1]) if self.is_matrix else float(np.max(self.value))

    def times(self, vector: Value) -> Value:
        """Return Gamma v."""
        return self.value @ vector if self.is_matrix else self.value * vector

    def scaled(self, scalar: Value, vector: Value) -> Value:
        """Return Gamma s v for a scalar s."""
        return self.value @ (scalar * vector) if self.is_matrix else self.value * scalar * vector

    def over(self, T: float) -> Gain:
        """Return the gain T Gamma of a step over T seconds."""
        return Gain(T * self.value)

    def of_first(self, n: int) -> Gain:
        """Return the gain of only the first n components, for a scalar or diagonal gain."""
        return self if self.dimensions == 0 else Gain(self.value[:n])

    def as_matrix(self, n: int) -> Value:
        """Return the gain of any kind as a matrix (n, n)."""
        return self.value if self.is_matrix else self.value * np.eye(n)

    def implicit_step(self, theta: Value, phi: Value, coupling: Value, error: Value) -> Value:
        """Return theta_next = theta + Gamma phi s with s = error - K phi'(theta_next - theta), K = ``coupling``.

        phi is (n,). With m inputs phi is (n, m), coupling (m, m) and error (m,).
        """
        if phi.ndim == 1:
            moves = self.times(phi)
            return theta + moves * (error / (1 + coupling * quadratic(phi, moves)))
        moves = self.as_matrix(phi.shape[0]) @ phi
        return theta + moves @ np.linalg.solve(np.eye(phi.shape[1]) + coupling @ (phi.T @ moves), error)


def quadratic(phi: Value, gain_phi: Value) -> Value:
    """Return phi'Gamma phi, clipped at zero, because rounding or a bit flip may have made a covariance Gamma indefinite."""
    return np.maximum(phi @ gain_phi, 0)


UNIT_GAIN = Gain(1.0)


def accept(field: str, value: float | Array) -> float | Array:
    """Return a positive number as a float, or a positive diagonal or an s.p.d. matrix as a read-only array. Raises InputError for
    other values."""
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
    """Return whether the matrix is positive definite beyond rounding errors. The error of the smallest eigenvalue is of the order
    of eps times the largest eigenvalue."""
    eigenvalues = np.linalg.eigvalsh(matrix)
    return bool(eigenvalues[0] > len(matrix) * np.finfo(float).eps * eigenvalues[-1])
