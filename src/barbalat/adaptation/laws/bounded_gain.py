"""Least squares with bounded-gain forgetting."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.adaptation import implicit
from barbalat.adaptation.laws import covariance
from barbalat.adaptation.laws.covariance import BoundedCovarianceLaw
from barbalat.adaptation.modifications import leakage as leak
from barbalat.protocols import Value
from barbalat.settings import Settings


@dataclass(frozen=True, eq=False)
class LeastSquaresBoundedGain(BoundedCovarianceLaw, Settings):
    """theta_hat' = proj(P epsilon phi), P' = beta(t) P - P phi phi'P/m_s^2, beta(t) = beta_0 (1 - |P|_F/k_0).

    covariance0       P(0), |P(0)|_F <= k_0: a number (times I), a diagonal (n,) or an s.p.d. matrix (n, n)
    forgetting        beta_0 > 0 [1/s]
    covariance_bound  k_0 > 0
    leakage           SwitchingSigma; none by default
    dead_zone         on epsilon m_s, for the estimate and the covariance; none by default

    The norm is Frobenius', so that P <= k_0 I: d|P|_F/dt <= beta_0 (1 - |P|_F/k_0) |P|_F, which vanishes at k_0. Exponential
    under persistent excitation, and no windup without: the forgetting fades. V' = -epsilon^2 m_s^2/2 - beta(t) V.

    A fixed sigma and the epsilon-modification are refused: while one direction rests at k_0 nothing is forgotten, and P
    decreases in the others as in pure least squares, without a lower bound.

    Source: Slotine and Li, Applied Nonlinear Control, section 8.7.5.
    """

    def accept_leakage(self) -> None:
        leak.accept(self.leakage, "bounded-gain forgetting", leak.Borne.HARMLESS, covariance.NO_LOWER_BOUND)

    def covariance_rate(self, P: Value, taken: Value) -> Value:
        beta = self.forgetting * (1 - np.sqrt(np.sum(P * P)) / self.covariance_bound)
        return beta * P - taken

    def forgotten(self, P: Value, T: float) -> tuple[Value, Value]:
        full = np.sqrt(np.sum(P * P)) / self.covariance_bound
        kept = P / (full + (1 - full) * np.exp(-self.forgetting * T))  # |P|_F follows the logistic equation
        return kept, implicit.forgotten(self.forgetting, T)[1]
