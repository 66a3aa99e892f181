"""The largest gain and sample time of MRAC whose law takes Euler steps while the plant moves on, its input held between them.

With x frozen, q = theta_tilde'x and e go from sample to sample as

    e_next = e^(A_m T) e - integral_0^T e^(A_m s) ds b q,   q_next = q + T g b'P e,   g = Gamma |x|^2,

which is exact for the plant. What a solver of differential equations would bear plays no part. Source: docs/numerics.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from barbalat.linear.largest import largest_from
from barbalat.problem.state_feedback import Known
from barbalat.validate import Array

TRIAL_RATIO = 1.1
"""Between two gains or sample times that are tried, upward from one that must be borne: the first exit counts."""
GAIN_FRACTIONS = np.geomspace(1e-6, 1.0, 40)
"""Of the largest g, at all of which a sample time is tried."""


@dataclass(frozen=True, eq=False)
class HeldOscillator:
    """The frozen error system from sample to sample."""

    known: Known

    def largest_g(self, T: float) -> float:
        """The largest g up to which no mode grows at the sample time T [s]."""
        start = (1e-6 / T) ** 2 / self.bPb  # turns q by 1e-6 in a sample
        return largest_from(lambda g: not self._grows(T, np.array([g])), start, factor=TRIAL_RATIO, least=start)

    def largest_step(self, g: float) -> float:
        """The largest sample time [s] up to which no mode grows for any gain from 0 to g > 0."""
        rate = float(np.abs(np.linalg.eigvals(self.known.A_m)).max()) + math.sqrt(g * self.bPb)
        start = 1e-6 / rate
        return largest_from(lambda T: not self._grows(T, g * GAIN_FRACTIONS), start, factor=TRIAL_RATIO, least=start)

    @property
    def bPb(self) -> float:
        """b'P b, its largest eigenvalue where b is a matrix."""
        b = self.known.b.reshape(self.known.n, -1)
        return float(np.linalg.eigvalsh(b.T @ self.known.P @ b)[-1])

    def _grows(self, T: float, g: Array) -> bool:
        """If |1 + T mu|^2 - 1 = T (2 Re mu + T |mu|^2) > 0 for an eigenvalue mu of (map - I)/T: nothing cancels against 1."""
        from scipy.linalg import expm

        known, n = self.known, self.known.n
        b = known.b.reshape(n, -1)
        size, eye = n + b.shape[1], np.eye(n)
        mean = expm(T * np.block([[known.A_m, eye], [0 * eye, 0 * eye]]))[:n, n:] / T  # of e^(A_m s) over a sample
        root_g = np.sqrt(g)[:, None, None]
        moves = np.zeros((len(g), size, size))
        moves[:, :n, :n] = known.A_m @ mean
        moves[:, :n, n:] = -root_g * (mean @ b)
        moves[:, n:, :n] = root_g * (b.T @ known.P)
        mu = np.linalg.eigvals(moves)
        rounding = 10 * size * np.finfo(float).eps * np.abs(mu).max(axis=1, keepdims=True)
        return bool((2 * mu.real + T * np.abs(mu) ** 2 > rounding).any())
