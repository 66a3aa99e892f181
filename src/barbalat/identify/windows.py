"""Windows of a recording: the integral form of x' = A x + B u over sequences of samples, with error bounds, and its least-squares
solution."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from barbalat.identify.known_set import EPS, Windows
from barbalat.identify.recording import Recording
from barbalat.validate import Array

MOST_WINDOWS = 400
"""Largest number of windows of each length: more windows hardly narrow the set, and they enlarge the linear programmes."""
LEAST_ROWS = 4
"""Least number of rows of least squares for each coefficient."""
STILL = 1e-10
"""Singular value of the regressors, relative to the largest, below which they are taken not to move in its direction."""
BLIND = 1e-6
"""A coefficient belongs to an unexcited direction if its entry in the direction is above this; smaller entries are rounding
errors."""


def windows_of(recording: Recording, i: int, noise: Mapping[str, float], slope: Mapping[str, float]) -> Windows:
    """Windows of 1, 2, 4, ... steps for the row of state i, with error bounds."""
    names = recording.output_names
    nu, L = (np.array([bounds[name] for name in names]) for bounds in (noise, slope))
    t, x, u = recording.times, recording.outputs, recording.inputs
    h = np.diff(t)[:, None]
    terms = np.column_stack([h * (x[:-1] / 2 + x[1:] / 2), h * u[:-1]])
    errors = np.column_stack([h * nu + L * h**2 / 4, np.zeros_like(u[:-1])])
    sums, error_sums = (np.vstack([np.zeros(part.shape[1]), np.cumsum(part, axis=0)]) for part in (terms, errors))
    N = len(h)
    size = np.abs(np.column_stack([x, u])).max(axis=0)
    rounding = (N + 16) * EPS * (np.abs(terms) + errors).sum(axis=0) + 4 * EPS * float(np.abs(t).max()) * N * size
    left, Q, Q_error = [], [], []
    for steps in _lengths(N):
        start = np.unique(np.linspace(0, N - steps, min(MOST_WINDOWS, N - steps + 1)).astype(int))
        left.append(x[start + steps, i] - x[start, i])
        Q.append(sums[start + steps] - sums[start])
        Q_error.append(error_sums[start + steps] - error_sums[start] + rounding)
    whole = np.concatenate(left)
    left_error = np.full(len(whole), 2 * nu[i] * (1 + 4 * EPS) + 4 * EPS * float(np.abs(x[:, i]).max()))
    return Windows(whole, np.vstack(Q), left_error, np.vstack(Q_error))


def _lengths(steps: int) -> list[int]:
    return [2**k for k in range(max(steps // 2, 1).bit_length())]


def first_guess(train: Recording, i: int, start: Array, free: Array) -> Array:
    """The row of state i by least squares on the integral form, over consecutive windows of the length with the narrowest
    intervals; coefficients that are not ``free`` keep their value. The trapezoidal rule and noise bias the result."""
    t, x, u = train.times, train.outputs, train.inputs
    h = np.diff(t)[:, None]
    terms = np.column_stack([h * (x[:-1] + x[1:]) / 2, h * u[:-1]])
    sums = np.vstack([np.zeros(terms.shape[1]), np.cumsum(terms, axis=0)])
    size, best, narrowest = np.abs(np.column_stack([x, u])).max(axis=0), start, np.inf
    for steps in _lengths(len(h)):
        ends = np.arange(0, len(t), steps)
        Q, left = np.diff(sums[ends], axis=0), np.diff(x[ends, i])
        if len(Q) < LEAST_ROWS * terms.shape[1]:
            break
        a = start.copy()
        a[free] = np.linalg.lstsq(Q[:, free], left - Q @ np.where(free, 0.0, start), rcond=None)[0]
        variance = np.diag(np.linalg.pinv(Q[:, free].T @ Q[:, free])) * float(np.mean((left - Q @ a) ** 2))
        width = float(np.sum(variance * size[free] ** 2))
        if width < narrowest:
            best, narrowest = a, width
    return best


def blind(Q: Array) -> tuple[tuple[Array, ...], Array]:
    """Directions in which regressors do not move at all, up to rounding, and the coefficients that occur in one of them."""
    size = np.maximum(np.abs(Q).max(axis=0, initial=0.0), 1e-300)
    _, values, rows = np.linalg.svd(Q / size, full_matrices=False)
    still = rows[values <= STILL * values.max(initial=0.0)]
    return tuple(row / size / np.abs(row / size).max() for row in still), (np.abs(still) > BLIND).any(axis=0)


def unexcited(windows: Windows) -> tuple[Array, ...]:
    """Directions whose regressor stays within its error in every window."""
    size = np.maximum(np.abs(windows.Q).max(axis=0), 1e-300)
    _, _, directions = np.linalg.svd(windows.Q / size, full_matrices=False)
    found = [row / size / np.abs(row / size).max() for row in directions]
    return tuple(row for row in found if (np.abs(windows.Q @ row) <= windows.Q_error @ np.abs(row) + EPS).all())
