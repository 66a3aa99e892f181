"""Modified least squares: forgetting with a bounded covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.adaptation import implicit
from barbalat.adaptation.law import Moved, SampleData
from barbalat.adaptation.laws import covariance
from barbalat.adaptation.laws.covariance import BoundedCovarianceLaw, Memory
from barbalat.adaptation.modifications import leakage as leak
from barbalat.problem.known_set import EstimateSet, Gain
from barbalat.protocols import Value
from barbalat.settings import Settings


@dataclass(frozen=True, eq=False)
class LeastSquaresBounded(BoundedCovarianceLaw, Settings):
    """theta_hat' = proj(P (epsilon phi - w theta_hat)), P' = beta P - P phi phi'P/m_s^2, but P' = 0 where |P|_F = R_0 would grow.

    covariance0       P(0), |P(0)|_F <= R_0: a number (times I), a diagonal (n,) or an s.p.d. matrix (n, n)
    forgetting        beta > 0 [1/s]
    covariance_bound  R_0 > 0
    leakage           FixedSigma or SwitchingSigma; none by default
    dead_zone         on epsilon m_s, for the estimate and the covariance; none by default

    The norm is Frobenius', so that P <= R_0 I and the test is plain arithmetic. P^-1 stays bounded as well, since (P^-1)' is
    zero or -beta P^-1 + phi phi'/m_s^2. The source leaves P at rest for good once it is at the bound; here it moves on
    as soon as it would shrink. V' <= 0 either way. In a fixed-step solver P is scaled back at every stage that overshoots.

    The epsilon-modification is refused for the reason given at LeastSquaresResetting.

    Source: Ioannou and Sun, section 4.3.6; Ioannou and Fidan, section 3.7.3.
    """

    def accept_leakage(self) -> None:
        leak.accept(self.leakage, "least squares", leak.Borne.BOUNDED, covariance.NOT_PROPORTIONAL)

    def covariance_rate(self, P: Value, taken: Value) -> Value:
        return covariance.held(P, self.forgetting * P - taken, self.covariance_bound)

    def limit(self, memory: Memory) -> Memory:
        return Memory(covariance.bounded(memory.covariance, self.covariance_bound))

    def sampled_step(self, theta_hat: Value, memory: Memory, data: SampleData, known_set: EstimateSet | None) -> Moved:
        given, T = memory.covariance, data.T
        weight, forgotten = implicit.forgotten(self.forgetting, T)[1], given * np.exp(self.forgetting * T)
        theta_next, P = covariance.correct(theta_hat, forgotten, weight, data, self.leakage, self.dead_zone)
        grown = np.sum(P * P) > self.covariance_bound * self.covariance_bound
        at_bound, _ = implicit.correct(Gain(given), T, theta_hat, data, self.leakage, self.dead_zone)
        theta_next, P = np.where(grown, at_bound, theta_next), np.where(grown, given, P)
        return Moved(implicit.into(theta_next, known_set, Gain(P)), self.limit(Memory(P)))
