"""Projections onto a box with a gain matrix or a covariance: the nearest rate that does not leave the box, and the nearest
point in it."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from barbalat.protocols import Value

if TYPE_CHECKING:
    from barbalat.problem.known_set.box import ParameterBox

EXACT_FACES = 4
"""Largest number of faces for which the projection with a gain matrix is exact. It tries all 2^n sets of faces."""
EXACT_FACES_OF_STEPS = 2
"""Largest number of faces with which a step over a sample is moved back into the box without an increase of V; see
``nearest``."""
CONE_PASSES = 3
"""Number of passes over the faces, if there are more than EXACT_FACES, and over the half-spaces of the box. Any remainder outside
is cut off afterwards."""


def onto_the_cone(rate: Value, theta_hat: Value, box: ParameterBox, gain: Value, first: int = 0) -> Value:
    """Return the nearest rate, in the metric Gamma^-1 of a matrix, that does not leave the box of the components from ``first``
    on.

    It is rate - Gamma g with g = sum of s_i lambda_i e_i over the faces on which theta_hat lies, with their outward sides s_i and
    lambda >= 0. With M = S Gamma S and b = S rate on these faces, M lambda >= b, and lambda_i = 0 where the inequality is strict.
    This makes lambda unique (Cottle, Pang and Stone, The Linear Complementarity Problem, 1992, section 3.1). For up to
    ``EXACT_FACES`` faces, all sets of faces with lambda > 0 are tried. For more faces, ``CONE_PASSES`` Gauss-Seidel passes
    approximate lambda >= 0, and the limit cuts off any remaining outward rate. A decrease of V is then not claimed.
    """
    if len(box.faces) <= 1 or len(box.faces) == 2 == rate.shape[0]:
        return _face_by_face(rate, theta_hat, box, gain, first)
    side, fixed = [], []
    for i in box.faces:
        above = np.where(theta_hat[first + i] >= box.upper[i], 1.0, 0.0)
        side.append(np.where(theta_hat[first + i] <= box.lower[i], -1.0, above))
        fixed.append(np.where(box.lower[i] >= box.upper[i], 1.0, 0.0))
    rows = [first + i for i in box.faces]
    scale = [s / np.sqrt(np.abs(gain[i, i])) for s, i in zip(side, rows, strict=True)]  # positive in every run
    b = [np.where(s == 0, -1.0, k * rate[i]) for s, k, i in zip(side, scale, rows, strict=True)]
    M = [
        [1.0 if i == j else k * gain[i, j] * m for j, m in zip(rows, scale, strict=True)]
        for i, k in zip(rows, scale, strict=True)
    ]
    solve = _by_all_sets if len(rows) <= EXACT_FACES else _by_sweeps
    for i, s, k, multiplier in zip(rows, side, scale, solve(M, b, fixed), strict=True):
        rate = rate - gain[:, i] * np.where(s == 0, 0.0, k * multiplier)
    return rate


def _face_by_face(rate: Value, theta_hat: Value, box: ParameterBox, gain: Value, first: int) -> Value:
    """Return the projection for one face, or for two faces of two parameters, rate - Gamma g max(0, g'rate)/(g'Gamma g) on each
    in turn.

    With one face no outward rate remains. In a corner of two faces the limit cuts off the remaining outward rate of the first,
    r > 0, without an increase of V. It remains only if Gamma_12 < 0 between the outward sides, and then Gamma^-1 (r, 0) >= 0. If
    there are further parameters, Gamma^-1 (r, 0) has components for them, which may have either sign.
    """
    for component in box.faces:
        i = first + component
        highest = np.where(theta_hat[i] >= box.upper[component], 0.0, np.inf)
        lowest = np.where(theta_hat[i] <= box.lower[component], 0.0, -np.inf)
        outward = rate[i] - np.maximum(np.minimum(rate[i], highest), lowest)
        rate = rate - gain[:, i] * (outward / gain[i, i])
    return rate


def nearest(theta_hat: Value, box: ParameterBox, gamma: Value) -> Value:
    """Project onto the box's half spaces in turn, each time orthogonally in the metric Gamma^-1. The limit cuts off the remainder
    outside. One projection reaches a single face."""
    for _ in range(CONE_PASSES if len(box.faces) > 1 else 1):
        for i in box.faces:
            excess = theta_hat[i] - np.clip(theta_hat[i], box.lower[i], box.upper[i])
            theta_hat = theta_hat - gamma[:, i] * (excess / gamma[i, i])
    return theta_hat


def _by_all_sets(M: list[list[Value]], b: list[Value], fixed: list[Value]) -> list[Value]:
    """Return lambda of the set of faces whose smallest multiplier or slack is largest. None is negative, up to rounding errors.

    A face whose two sides coincide (``fixed``) is always in the set, with a multiplier of either sign.
    """
    faces = range(len(b))
    best: Value = -np.inf
    found: list[Value] = [0.0 for _ in faces]
    for chosen in (subset for size in range(len(b) + 1) for subset in combinations(faces, size)):
        solved = _solve([[M[i][j] for j in chosen] for i in chosen], [b[i] for i in chosen])
        multipliers: list[Value] = [0.0 for _ in faces]
        for i, value in zip(chosen, solved, strict=True):
            multipliers[i] = value
        worst: Value = np.inf
        for i in faces:
            if i in chosen:
                margin = np.where(fixed[i] > 0, np.inf, multipliers[i])
            else:
                margin = np.where(fixed[i] > 0, -np.inf, sum((M[i][j] * multipliers[j] for j in chosen), -b[i]))
            worst = np.minimum(worst, margin)
        better = worst > best
        best = np.where(better, worst, best)
        found = [np.where(better, new, old) for new, old in zip(multipliers, found, strict=True)]
    return found


def _by_sweeps(M: list[list[Value]], b: list[Value], fixed: list[Value]) -> list[Value]:
    faces = range(len(b))
    found: list[Value] = [0.0 for _ in faces]
    for _ in range(CONE_PASSES):
        for i in faces:
            wanted = b[i] - sum((M[i][j] * found[j] for j in faces if j != i), 0.0 * b[i])
            found[i] = np.where(fixed[i] > 0, wanted, np.maximum(wanted, 0.0))
    return found


def _solve(A: list[list[Value]], b: list[Value]) -> list[Value]:
    """Return A^-1 b for a symmetric positive definite matrix of expressions, by elimination."""
    A, b = [list(row) for row in A], list(b)
    for k in range(len(b)):
        for i in range(k + 1, len(b)):
            factor = A[i][k] / A[k][k]
            b[i] = b[i] - factor * b[k]
            for j in range(k + 1, len(b)):
                A[i][j] = A[i][j] - factor * A[k][j]
    for i in reversed(range(len(b))):
        for j in range(i + 1, len(b)):
            b[i] = b[i] - A[i][j] * b[j]
        b[i] = b[i] / A[i][i]
    return b
