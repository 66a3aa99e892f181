"""Margins of many loops at once, on one grid of frequencies: good enough to say which of them to look at exactly.

Each loop is given by two responses, L = N/D, that have no poles on the grid: where L has one beside the axis, D only comes close
to zero. So every sign change between two frequencies is a crossing, and N and D are interpolated, never L.
"""

from __future__ import annotations

import numpy as np

from barbalat.validate import Array


def screen(N: Array, D: Array, w: Array, delay: float = 0.0) -> dict[str, Array]:
    """Each (M,): what is smallest where the margin is worst, from responses (M, K) over w (K,), N with the delay in it.

    By the names of ``Margins``; 1 - gain_down stands for gain_down: all four are then to be made small. "delay" is what is borne
    with the delay that is there already.
    """
    count = len(N)
    at, N_at, D_at, rows = _crossings(np.abs(N) - np.abs(D), N, D, w)
    lag = np.angle(-N_at * D_at.conj()) % (2 * np.pi)
    borne = (lag + at * delay) % (2 * np.pi) / at
    at, N_at, D_at, crossed = _crossings(N.imag * D.real - N.real * D.imag, N, D, w)
    real = (N_at * D_at.conj()).real
    start = (N[:, 0] * D[:, 0].conj()).real  # zero frequency, nearly
    flat = np.abs((N[:, 0] * D[:, 0].conj()).imag) < 1e-2 * np.abs(start)
    real, crossed = np.concatenate([real, start[flat]]), np.concatenate([crossed, np.flatnonzero(flat)])
    size = np.concatenate([np.abs(D_at) ** 2, np.abs(D[flat, 0]) ** 2])
    negative = real < 0
    factors, crossed = -size[negative] / real[negative], crossed[negative]
    up = factors > 1
    return {
        "delay": _least(count, rows, borne),
        "phase": _least(count, rows, np.minimum(lag, 2 * np.pi - lag)),
        "gain_up": _least(count, crossed[up], factors[up]),
        "gain_down": np.minimum(1.0, _least(count, crossed[~up], 1 - factors[~up])),
    }


def _crossings(values: Array, N: Array, D: Array, w: Array) -> tuple[Array, Array, Array, Array]:
    """Where values (M, K) change their sign along w: frequencies, N and D there, and the rows; each (crossings,)."""
    rows, k = np.nonzero(values[:, :-1] * values[:, 1:] < 0)
    left, right = values[rows, k], values[rows, k + 1]
    t = left / (left - right)
    between = [X[rows, k] + t * (X[rows, k + 1] - X[rows, k]) for X in (N, D)]
    return w[k] * (w[k + 1] / w[k]) ** t, *between, rows


def _least(count: int, rows: Array, values: Array) -> Array:
    """(count,) the smallest value of each row; infinite where it has none."""
    found = np.full(count, np.inf)
    np.minimum.at(found, rows, values)
    return found
