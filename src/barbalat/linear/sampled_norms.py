"""Upper bounds on the response of a stable system s[k+1] = M s[k] + N w[k], y[k] = C s[k] at its samples, by sums and tails.

With P - M'PM >= q I > 0, |M s|_P <= beta |s|_P, beta^2 = 1 - q/lambda_max(P): the part that is not summed is at most a
geometric series. P is the solution for q = 1, and q is then computed from this P, minus its rounding errors.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from barbalat.linear.enclosure import OUTWARD_FACTOR
from barbalat.validate import Array, InputError

TAIL_SHARE = 2e-4
"""Fraction of the sum below which the tail is negligible for a bound."""
MOST_SAMPLES = 4_000_000
"""Largest number of summed samples; a loop that decays more slowly has no bound."""
CERTAIN_SHARE = 0.999
"""Fraction of the decay that a proof uses."""
MOST_PROVEN = 24_000
"""Largest number of samples that ``barbalat-check`` follows."""
BLOCK_SAMPLES = 64
"""Number of samples that are summed together."""
UNSTABLE = "the sampled-data loop is unstable"
TOO_SLOW = "the loop's transients decay too slowly for a bound"
TOO_CLOSE = "the sampled-data loop is too close to instability, or its states differ too much in size, for a bound"


@dataclass(frozen=True, eq=False)
class SampledNorms:
    """Norms of the sampled system with the matrices M (s, s) and C (p, s).

    proven  the number of samples that a proof follows, a multiple of ``BLOCK_SAMPLES``; by default as many as are needed for a
            tail of at most ``TAIL_SHARE`` of the largest norm
    """

    M: Array
    C: Array
    proven: int | None = None

    def summed(self, s: Array) -> Array:
        """sum_k |C M^k s|, (p,), or (p, q) for q columns s: the largest effect of an input of size 1 on y, with s = N."""
        return self._bounded(s, 1)[0]

    def largest(self, s: Array) -> Array:
        """max_k |C M^k s|, in the shape of ``summed``."""
        return self._bounded(s, np.inf)[0]

    def deviation(self, s: Array, first: Array) -> Array:
        """max_k (sum_(j < k) |C M^j s|^2 + |C M^k first|^2)^(1/2), (p, q): the standard deviation of y for independent inputs of
        deviation 1 whose first one has the effect ``first``."""
        count = s.shape[1]
        every, found = np.zeros((len(self.C), count)), np.zeros((len(self.C), count))
        for seen, tail in self._followed(np.hstack([s, first])):
            before = np.cumsum(np.concatenate([every[None], seen[:, :, :count] ** 2]), axis=0)
            found = np.maximum(found, (before[:-1] + seen[:, :, count:] ** 2).max(axis=0))
            every = before[-1]
            left = tail[:, :count] ** 2 + tail[:, count:] ** 2
            if (left <= TAIL_SHARE**2 * found.max(initial=0.0)).all():
                return np.asarray(np.sqrt(np.maximum(found, every + left)) * OUTWARD_FACTOR)
        raise InputError(TOO_SLOW)

    def samples(self, s: Array) -> int:
        """The number of samples that are summed before the rest is negligible."""
        return self._bounded(s, 1)[1]

    def _bounded(self, s: Array, order: float) -> tuple[Array, int]:
        """The norm of this order of the sequence C M^k s, and the number of samples followed. The sum of a tail bounds all its
        norms."""
        found, followed = np.zeros((len(self.C), *s.shape[1:])), 0
        for seen, tail in self._followed(s):
            followed += BLOCK_SAMPLES
            found = np.linalg.norm([found, np.linalg.norm(seen, order, axis=0)], order, axis=0)
            short = (tail <= TAIL_SHARE * found.max(initial=0.0)).all()
            if short if self.proven is None else followed == self.proven:
                return np.asarray((found + tail) * OUTWARD_FACTOR), followed
        raise InputError(TOO_SLOW)

    def _followed(self, s: Array) -> Iterator[tuple[Array, Array]]:
        """C M^k s for the samples of each block, and a bound on the sum of |C M^k s| over all later samples."""
        from scipy.linalg import matrix_balance

        M, (scale, _) = matrix_balance(self.M, permute=False, separate=True)  # by powers of two: exact
        C, s = self.C * scale, (s.T / scale).T
        if not np.abs(np.linalg.eigvals(M)).max() < 1:
            raise InputError(UNSTABLE)
        root, lost = _contraction(M)
        if self.proven is not None:
            lost = _of_share(_share(lost) * CERTAIN_SHARE)
        reach = np.linalg.norm(np.linalg.solve(root.T, C.T), axis=0) / lost
        rows = [C]
        for _ in range(BLOCK_SAMPLES - 1):
            rows.append(rows[-1] @ M)
        block, jump = np.stack(rows), np.linalg.matrix_power(M, BLOCK_SAMPLES)
        for _ in range(MOST_SAMPLES // BLOCK_SAMPLES):
            seen, s = block @ s, jump @ s
            yield seen, np.multiply.outer(reach, np.linalg.norm(root @ s, axis=0))


def _contraction(M: Array) -> tuple[Array, float]:
    """A root with root'root = P, and a lower bound on 1 - beta; raises InputError if this P shows none."""
    from scipy.linalg import LinAlgError, LinAlgWarning, cholesky, solve_discrete_lyapunov

    try:
        with warnings.catch_warnings():  # SciPy warns of an ill-conditioned equation; its solution is verified here
            warnings.simplefilter("ignore", LinAlgWarning)
            root = cholesky(solve_discrete_lyapunov(M.T, np.eye(len(M))))
    except LinAlgError as error:
        raise InputError(TOO_CLOSE) from error
    P = root.T @ root
    roundings = 4 * len(M) * np.finfo(float).eps * (np.abs(root.T) @ np.abs(root) + np.abs(M.T) @ np.abs(P) @ np.abs(M))
    q = float(np.linalg.eigvalsh(P - M.T @ P @ M)[0]) - float(np.linalg.norm(roundings))
    if not q > 0:
        raise InputError(TOO_CLOSE)
    return root, _of_share(min(1.0, q / float(np.linalg.norm(root, 2)) ** 2))


def _of_share(share: float) -> float:
    """1 - beta for beta^2 = 1 - share."""
    return share / (1 + math.sqrt(1 - share))


def _share(lost: float) -> float:
    return lost * (2 - lost)


def contraction_witness(M: Array) -> dict[str, Any]:
    """P and a share with M'PM < (1 - share) P; raises InputError if there are none."""
    from scipy.linalg import matrix_balance

    balanced, (scale, _) = matrix_balance(M, permute=False, separate=True)
    root, lost = _contraction(balanced)
    P = (root.T @ root) / np.outer(scale, scale)
    return {"P": ((P + P.T) / 2).tolist(), "share": _share(lost) * CERTAIN_SHARE}


def grown(A: Array, T: float) -> Array:
    """e^(|A| T), which is at least |e^(A t)| in every entry for 0 <= t <= T."""
    from scipy.linalg import expm

    return np.asarray(expm(np.abs(A) * T)) * OUTWARD_FACTOR
