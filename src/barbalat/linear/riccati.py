"""Stabilising solutions of Riccati equations, computed with SciPy's solvers in scaled coordinates.

SciPy scales the pencil of an equation only roughly: with the covariance of a fine encoder, R = 1e-13, its solver fails or loses
all digits. Here the states are scaled by powers of two that balance the Hamiltonian matrix, and the weight R becomes I.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from barbalat.linear.conditions import balance
from barbalat.validate import Array


def continuous(A: Array, B: Array, Q: Array, R: Array) -> Array:
    """P, (n, n), of A'P + P A - P B R^-1 B'P + Q = 0 with a Hurwitz A - B R^-1 B'P.

    Shapes: A, Q (n, n), B (n, m), R (m, m) positive definite. Raises LinAlgError if none is found.
    """
    from scipy.linalg import solve_continuous_are

    P = _scaled(solve_continuous_are, A, B, Q, R)
    poles = np.linalg.eigvals(A - B @ np.linalg.solve(R, B.T @ P))
    return _stabilising(P, bool(poles.real.max() < 0))


def discrete(A: Array, B: Array, Q: Array, R: Array) -> Array:
    """P, (n, n), of A'P A - P - A'P B (R + B'P B)^-1 B'P A + Q = 0 whose closed loop is inside the unit circle.

    Shapes: A, Q (n, n), B (n, m), R (m, m) positive definite. Raises LinAlgError if none is found.
    """
    from scipy.linalg import solve_discrete_are

    P = _scaled(solve_discrete_are, A, B, Q, R)
    poles = np.linalg.eigvals(A - B @ np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A))
    return _stabilising(P, bool(np.abs(poles).max() < 1))


def _scaled(solve: Callable[..., Array], A: Array, B: Array, Q: Array, R: Array) -> Array:
    """P = S^-1 X S^-1, where X is the solution for the states z of x = S z, S = diag(s), and for the inputs R^(1/2) u."""
    n = len(A)
    unit = np.linalg.solve(np.linalg.cholesky(R), B.T).T
    _, scale = balance(np.block([[A, -unit @ unit.T], [-Q, -A.T]]))
    s = 2.0 ** np.round(np.log2(scale[:n] / scale[n:]) / 2)
    try:
        X = solve(A * s / s[:, None], unit / s[:, None], Q * np.outer(s, s), np.eye(len(R)))
    except ValueError as failed:  # SciPy raises it for a pencil that is too badly conditioned
        raise np.linalg.LinAlgError(str(failed)) from failed
    return np.asarray(X / np.outer(s, s))


def _stabilising(P: Array, stable: bool) -> Array:
    if not stable:
        raise np.linalg.LinAlgError("the solution found is not stabilising")
    return P
