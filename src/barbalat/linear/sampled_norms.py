"""Bounds of what a stable system s[k+1] = M s[k] + N w[k], y[k] = C s[k] does at its samples: from above, by sums and tails.

With P - M'PM >= q I > 0, |M s|_P <= beta |s|_P, beta^2 = 1 - q/lambda_max(P): what is not summed is at most a geometric series.
P is solved for q = 1, and q then taken from the P that was found, less its roundings.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import numpy as np

from barbalat.linear.enclosure import OUTWARD_FACTOR
from barbalat.validate import Array, InputError

TAIL_SHARE = 1e-3
"""Of the sum: a bound need not be closer."""
MOST_SAMPLES = 4_000_000
"""Summed at most; a loop that forgets more slowly has no bound."""
BLOCK_SAMPLES = 64
"""Samples that are summed at once."""
TOO_CLOSE = "the loop is too close to losing stability from sample to sample, or its states are of too far sizes, for a bound"


@dataclass(frozen=True, eq=False)
class SampledNorms:
    """Norms of the sampled system with the matrices M (s, s) and C (p, s)."""

    M: Array
    C: Array

    def summed(self, s: Array) -> Array:
        """sum_k |C M^k s|, (p,), or (p, q) for q columns s: what an input of size 1 makes of y, with s = N."""
        return self._bounded(s, summed=True)

    def largest(self, s: Array) -> Array:
        """max_k |C M^k s|, of the shape of ``summed``."""
        return self._bounded(s, summed=False)

    def _bounded(self, s: Array, *, summed: bool) -> Array:
        from scipy.linalg import matrix_balance

        M, (scale, _) = matrix_balance(self.M, permute=False, separate=True)  # by powers of two: exact
        C, s = self.C * scale, (s.T / scale).T
        if not np.abs(np.linalg.eigvals(M)).max() < 1:
            raise InputError("the loop is unstable from sample to sample")
        root, lost = _contraction(M)
        reach = np.linalg.norm(np.linalg.solve(root.T, C.T), axis=0) / lost
        rows = [C]
        for _ in range(BLOCK_SAMPLES - 1):
            rows.append(rows[-1] @ M)
        block, jump = np.stack(rows), np.linalg.matrix_power(M, BLOCK_SAMPLES)
        found = np.zeros((len(C), *s.shape[1:]))
        for _ in range(MOST_SAMPLES // BLOCK_SAMPLES):
            seen = np.abs(block @ s)
            found = found + seen.sum(axis=0) if summed else np.maximum(found, seen.max(axis=0))
            s = jump @ s
            tail = np.multiply.outer(reach, np.linalg.norm(root @ s, axis=0))
            if (tail <= TAIL_SHARE * found.max(initial=0.0)).all():
                return np.asarray((found + tail) * OUTWARD_FACTOR)
        raise InputError("the loop forgets too slowly for a bound")


def _contraction(M: Array) -> tuple[Array, float]:
    """Root with root'root = P, and at most 1 - beta; InputError where the P that was found shows none."""
    from scipy.linalg import LinAlgError, LinAlgWarning, cholesky, solve_discrete_lyapunov

    try:
        with warnings.catch_warnings():  # of an ill-conditioned equation: its solution is judged here
            warnings.simplefilter("ignore", LinAlgWarning)
            root = cholesky(solve_discrete_lyapunov(M.T, np.eye(len(M))))
    except LinAlgError as error:
        raise InputError(TOO_CLOSE) from error
    P = root.T @ root
    roundings = 4 * len(M) * np.finfo(float).eps * (np.abs(root.T) @ np.abs(root) + np.abs(M.T) @ np.abs(P) @ np.abs(M))
    q = float(np.linalg.eigvalsh(P - M.T @ P @ M)[0]) - float(np.linalg.norm(roundings))
    if not q > 0:
        raise InputError(TOO_CLOSE)
    share = min(1.0, q / float(np.linalg.norm(root, 2)) ** 2)
    return root, share / (1 + math.sqrt(1 - share))


def grown(A: Array, T: float) -> Array:
    """e^(|A| T), which is at least |e^(A t)| in every entry for 0 <= t <= T."""
    from scipy.linalg import expm

    return np.asarray(expm(np.abs(A) * T)) * OUTWARD_FACTOR
