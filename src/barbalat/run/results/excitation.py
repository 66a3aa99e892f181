"""How much a recorded regressor excites: the least eigenvalue of its windowed correlation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from barbalat.validate import Array

WINDOWS_OF_A_RUN = 40
"""Windows that are laid over a run, overlapping."""


class Excitation(NamedTuple):
    """Persistent excitation: the least eigenvalue of 1/T times the integral of phi phi' over windows of length T.

    level        the least over all windows, in the regressor's units squared
    tail         that of the last quarter of the run
    conditioning the least eigenvalue in the tail when phi is scaled to unit mean square in each component: 0 ... 1
    fading       mean square of phi in the tail, relative to that of the window where it is largest
    window       T [s]
    sampling     how far the decimation of the record is felt: the relative change of ``tail`` when every second instant is left
                 out, or the mean square change of phi from instant to instant over its mean square, whichever is more
    """

    level: float
    tail: float
    conditioning: float
    fading: float
    window: float
    sampling: float


def excitation(t: Array, phi: Array) -> Excitation | None:
    """Of a regressor (K, p, m) at the instants t (K,); a window is a quarter of the run."""
    if phi.shape[1] == 0 or len(t) < 16 or not np.isfinite(phi).all():
        return None
    window = float(t[-1] - t[0]) / 4
    starts = np.linspace(t[0], t[-1] - window, WINDOWS_OF_A_RUN)
    spans = [slice(*np.searchsorted(t, (start - 1e-9 * window, start + window * (1 + 1e-9)))) for start in starts]
    grams = [_gram(t[span], phi[span]) for span in spans]
    last = spans[-1]
    scale = np.sqrt(np.diag(grams[-1]))
    tail, half = _least(grams[-1]), _least(_gram(t[last][::2], phi[last][::2]))
    correlation = grams[-1] / np.outer(scale, scale) if (scale > 0).all() else np.zeros_like(grams[-1])
    change = abs(half - tail) / max(tail, half) if max(tail, half) > 0 else 0.0
    square = float(np.mean(phi[last] ** 2))
    rough = float(np.mean(np.diff(phi[last], axis=0) ** 2)) / square if square > 0 else 0.0
    squares = [float(np.trace(gram)) for gram in grams]
    fading = squares[-1] / max(squares) if max(squares) > 0 else 0.0
    return Excitation(min(map(_least, grams)), tail, _least(correlation), fading, window, max(change, rough))


def _gram(t: Array, phi: Array) -> Array:
    """1/T times the integral of phi phi', by the trapezoidal rule."""
    steps = np.diff(t)
    weights = np.concatenate([[0.0], steps]) + np.concatenate([steps, [0.0]])
    columns = phi.transpose(1, 0, 2).reshape(phi.shape[1], -1)  # no outer product is made: a network's would fill the memory
    return np.asarray((columns * np.repeat(weights, phi.shape[2])) @ columns.T / (2 * (t[-1] - t[0])))


def _least(gram: Array) -> float:
    return max(float(np.linalg.eigvalsh(gram)[0]), 0.0)  # a rounding below zero is zero
