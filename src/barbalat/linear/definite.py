"""Whether a symmetric matrix is definite, for certain: elimination in ball arithmetic."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from barbalat.validate import Array, InputError

if TYPE_CHECKING:
    from flint import arb_mat


def smallest_eigenvalue(P: Array) -> float:
    """A guaranteed lower bound of lambda_min of the symmetric positive definite P, as tight as rounding allows.

    Raises InputError where P is not positive definite.
    """
    approximate = float(np.linalg.eigvalsh(P)[0])
    for slack in (1e-14, 1e-12, 1e-9, 1e-6, 1e-3):
        candidate = approximate - slack * float(np.linalg.norm(P, 2))
        if candidate > 0 and is_positive_definite(exact_matrix(P), candidate):
            return candidate
    raise InputError(f"P must be positive definite, but its smallest eigenvalue is {approximate:.3g}")


def is_positive_definite(matrix: arb_mat, shift: float = 0.0) -> bool:
    """Whether the symmetric matrix - shift I is positive definite for certain: elimination in balls has positive pivots."""
    from flint import arb, arb_mat

    n = matrix.nrows()
    work = arb_mat(matrix)
    for i in range(n):
        work[i, i] -= arb(shift)
    for k in range(n):
        if not work[k, k] > 0:
            return False
        for i in range(k + 1, n):
            factor = work[i, k] / work[k, k]
            for j in range(k, n):
                work[i, j] -= factor * work[k, j]
    return True


def lyapunov_holds(P: Array, A_m: Array) -> bool:
    """Whether P A_m + A_m'P is negative definite for certain with P as it is stored, roundings and all."""
    exact_P, exact_A = exact_matrix(P), exact_matrix(A_m)
    return is_positive_definite(-(exact_P * exact_A + exact_A.transpose() * exact_P))


def exact_matrix(matrix: Array) -> arb_mat:
    """The matrix in balls, without rounding."""
    from flint import arb_mat

    return arb_mat(matrix.tolist())
