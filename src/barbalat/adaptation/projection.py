"""Projection of an adaptive law onto the known set: the estimate never leaves it, and the Lyapunov function still decreases.

Every projection subtracts Gamma g lambda from the rate with the outward normal g of a face or sphere and lambda >= 0. Since
theta_tilde'Gamma^-1 Gamma g = (theta_hat - theta)'g >= 0 for every theta in a convex set, V = theta_tilde'Gamma^-1 theta_tilde
never grows by it.

Source: Ioannou and Fidan, Adaptive Control Tutorial, section 3.10; Ioannou and Sun, Robust Adaptive Control, section 4.4.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from barbalat.adaptation.gain import is_matrix, times
from barbalat.problem.known_set import EstimateSet, ParameterBall, ParameterBox, ParameterProduct
from barbalat.protocols import Value

ON_THE_SPHERE = 2.0**-46
"""An estimate this near to the sphere counts as on it: a few dozen roundings, relative to |center| + radius."""

INSIDE_THE_SPHERE = 2.0**-50
"""How far inside the sphere the limit puts an estimate: its roundings then can't bring it out."""

EXACTLY = 4
"""Faces up to which the projection for a gain matrix is exact: it tries the 2^n sets of them."""
SWEEPS = 3
"""Passes over more faces than that."""


def project(rate: Value, theta_hat: Value, known_set: EstimateSet | None, gain: Value = 1.0) -> Value:
    """proj(.) of (4), (7) and (15).

    rate, theta_hat  (n,); ``None`` for the set means no projection
    gain             that of the law: a number, a diagonal (n,) or a matrix (n, n), such as a covariance P(t)
    """
    if known_set is None:
        return rate
    if isinstance(known_set, ParameterProduct):
        return _one_by_one(rate, theta_hat, known_set, gain)
    if isinstance(known_set, ParameterBall):
        return _along_the_sphere(rate, theta_hat, known_set, gain)
    if is_matrix(gain):
        return _onto_the_cone(rate, theta_hat, known_set, gain)
    return _componentwise(rate, theta_hat, known_set)


def _componentwise(rate: Value, theta_hat: Value, box: ParameterBox) -> Value:
    """For a diagonal gain: a component on a face does not move outward."""
    highest = np.where(theta_hat >= box.upper, 0.0, np.inf)
    lowest = np.where(theta_hat <= box.lower, 0.0, -np.inf)
    return np.maximum(np.minimum(rate, highest), lowest)


def _one_by_one(rate: Value, theta_hat: Value, product: ParameterProduct, gain: Value) -> Value:
    """Sphere and intervals. A scalar or diagonal gain does not couple them; with a matrix the intervals follow the sphere."""
    first = rate.shape[0] - product.gains.size
    if is_matrix(gain):
        along = rate if product.theta is None else _along_the_sphere(rate, theta_hat, product.theta, gain)
        return _onto_the_cone(along, theta_hat, product.gains, gain, first)
    own = gain if len(getattr(gain, "shape", ())) == 0 else gain[:first]
    theta = project(rate[:first], theta_hat[:first], product.theta, own)
    return np.concatenate([theta, _componentwise(rate[first:], theta_hat[first:], product.gains)])


def _onto_the_cone(rate: Value, theta_hat: Value, box: ParameterBox, gain: Value, first: int = 0) -> Value:
    """For a gain matrix: the nearest rate in the metric of Gamma^-1 that does not leave the box of the components from ``first``.

    That is rate - Gamma g, g = sum of s_i lambda_i e_i over the faces that theta_hat is on, s_i their outward sides, lambda >= 0,
    and with M = S Gamma S and b = S rate on these faces M lambda >= b, lambda_i = 0 where that is strict, which makes it unique
    (Cottle, Pang and Stone, The Linear Complementarity Problem, 1992, section 3.1). Of up to ``EXACTLY`` faces the set with
    lambda > 0 is found by trying all of them; of more, ``SWEEPS`` passes of Gauss and Seidel come near it with lambda >= 0, and
    what still points outward is cut off by the limit, for which the decrease of V is not claimed.
    """
    if len(box.faces) <= 2:
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
    solve = _by_all_sets if len(rows) <= EXACTLY else _by_sweeps
    for i, s, k, multiplier in zip(rows, side, scale, solve(M, b, fixed), strict=True):
        rate = rate - gain[:, i] * np.where(s == 0, 0.0, k * multiplier)
    return rate


def _face_by_face(rate: Value, theta_hat: Value, box: ParameterBox, gain: Value, first: int) -> Value:
    """For one or two faces: rate - Gamma g max(0, g'rate)/(g'Gamma g) on each in turn.

    On one face nothing is left that points outward. In a corner of two what is left of the first, r > 0, is cut off by the limit,
    without harm to V: it is left only if Gamma_12 < 0 between the outward sides, so that Gamma^-1 (r, 0) >= 0.
    """
    for component in box.faces:
        i = first + component
        highest = np.where(theta_hat[i] >= box.upper[component], 0.0, np.inf)
        lowest = np.where(theta_hat[i] <= box.lower[component], 0.0, -np.inf)
        outward = rate[i] - np.maximum(np.minimum(rate[i], highest), lowest)
        rate = rate - gain[:, i] * (outward / gain[i, i])
    return rate


def _by_all_sets(M: list[list[Value]], b: list[Value], fixed: list[Value]) -> list[Value]:
    """lambda of the set of faces whose least multiplier and least slack are greatest: none is negative but for roundings.

    A face that is both sides at once (``fixed``) is always in it, with a multiplier of either sign.
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
    for _ in range(SWEEPS):
        for i in faces:
            wanted = b[i] - sum((M[i][j] * found[j] for j in faces if j != i), 0.0 * b[i])
            found[i] = np.where(fixed[i] > 0, wanted, np.maximum(wanted, 0.0))
    return found


def _solve(A: list[list[Value]], b: list[Value]) -> list[Value]:
    """A^-1 b of a symmetric positive definite matrix of expressions, by elimination."""
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


def _along_the_sphere(rate: Value, theta_hat: Value, ball: ParameterBall, gain: Value) -> Value:
    """rate - Gamma g g'rate/(g'Gamma g), g = theta_hat - center, on the sphere where g'rate > 0.

    The ball may be of the first components only; g is then zero in the others.
    """
    g = theta_hat[: ball.size] - ball.center
    if others := rate.shape[0] - ball.size:
        g = np.concatenate([g, np.zeros(others)])
    reach = _reach(ball, ON_THE_SPHERE)
    on_it = g @ g >= reach * reach
    gain_g = times(gain, g)
    outward = np.maximum(g @ rate, 0.0) / np.where(on_it, g @ gain_g, 1.0)
    return rate - gain_g * np.where(on_it, outward, 0.0)


def limit(theta_hat: Value, known_set: EstimateSet | None) -> Value:
    """The stage value of the estimate, limited to the set (a limited integrator); ``None`` means no limit.

    To the nearest point of the set, up to the last few bits for a ball.
    """
    if known_set is None:
        return theta_hat
    if isinstance(known_set, ParameterBox):
        return np.clip(theta_hat, known_set.lower, known_set.upper)
    if isinstance(known_set, ParameterProduct):
        theta, gains = known_set.parts(theta_hat)
        return np.concatenate([limit(theta, known_set.theta), limit(gains, known_set.gains)])
    g = theta_hat - known_set.center
    reach = _reach(known_set, INSIDE_THE_SPHERE)
    outside = g @ g > reach * reach
    return np.where(outside, known_set.center + g * (reach / np.sqrt(np.where(outside, g @ g, 1.0))), theta_hat)


def _reach(ball: ParameterBall, slack: float) -> Value:
    """The radius less ``slack``, relative to the size of the numbers that are subtracted on the way."""
    return ball.radius - slack * (ball.radius + np.sqrt(ball.center @ ball.center))
