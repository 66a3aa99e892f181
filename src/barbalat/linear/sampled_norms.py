"""Bounds of what a stable system s[k+1] = M s[k] + N w[k], y[k] = C s[k] does at its samples: from above, by sums and tails.

With P - M'PM = I, |M s|_P <= beta |s|_P, beta^2 = 1 - 1/lambda_max(P): what is not summed is at most a geometric series.
"""

from __future__ import annotations

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


@dataclass(frozen=True, eq=False)
class SampledNorms:
    """Of M (s, s) and C (p, s)."""

    M: Array
    C: Array

    def summed(self, s: Array) -> Array:
        """sum_k |C M^k s|, (p,), or (p, q) for q columns s: what an input of size 1 makes of y, with s = N."""
        return self._bounded(s, summed=True)

    def largest(self, s: Array) -> Array:
        """max_k |C M^k s|, of the same shape."""
        return self._bounded(s, summed=False)

    def _bounded(self, s: Array, *, summed: bool) -> Array:
        from scipy.linalg import cholesky, solve_discrete_lyapunov

        M, C = self.M, self.C
        if not np.abs(np.linalg.eigvals(M)).max() < 1:
            raise InputError("the loop is unstable from sample to sample")
        root = cholesky(solve_discrete_lyapunov(M.T, np.eye(len(M))))  # root'root = P
        beta = np.sqrt(max(1 - 1 / float(np.linalg.norm(root, 2)) ** 2, 0.0))
        reach = np.linalg.norm(np.linalg.solve(root.T, C.T), axis=0) / (1 - beta)
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
