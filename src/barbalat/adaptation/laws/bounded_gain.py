"""Least squares with bounded-gain forgetting."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat import validate
from barbalat.adaptation import implicit
from barbalat.adaptation.guarantee import Guarantee, with_modifications
from barbalat.adaptation.law import Estimation, Moved, Rates, SampleData
from barbalat.adaptation.laws import covariance
from barbalat.adaptation.laws.covariance import Memory
from barbalat.adaptation.modifications import dead_zone as zone
from barbalat.adaptation.modifications import leakage as leak
from barbalat.problem.known_set import EstimateSet, Gain, gain
from barbalat.protocols import Value
from barbalat.validate import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class LeastSquaresBoundedGain:
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

    covariance0: float | Array
    forgetting: float
    covariance_bound: float
    leakage: leak.Leakage | None = None
    dead_zone: zone.DeadZone | None = None

    def __post_init__(self) -> None:
        validate.freeze(self, covariance0=gain.accept("law.covariance0", self.covariance0))
        validate.freeze(self, forgetting=validate.positive("law.forgetting", self.forgetting))
        validate.freeze(self, covariance_bound=validate.positive("law.covariance_bound", self.covariance_bound))
        leak.accept(self.leakage, "bounded-gain forgetting", leak.SWITCHING, covariance.NO_LOWER_BOUND)
        zone.accept(self.dead_zone)

    @property
    def metric(self) -> Gain:
        return covariance.A_MATRIX

    def initial(self, n: int) -> Memory:
        return covariance.initial(self.covariance0, n, self.covariance_bound)

    def rates(self, theta_hat: Value, memory: Memory, estimation: Estimation, known_set: EstimateSet | None) -> Rates:
        P = memory.covariance
        theta_hat_dot, taken = covariance.learn(theta_hat, P, estimation, known_set, self.leakage, self.dead_zone)
        beta = self.forgetting * (1 - np.sqrt(np.sum(P * P)) / self.covariance_bound)
        return Rates(theta_hat_dot, Memory(beta * P - taken))

    def limit(self, memory: Memory) -> Memory:
        return memory

    def sampled_step(self, theta_hat: Value, memory: Memory, data: SampleData, known_set: EstimateSet | None) -> Moved:
        weight = implicit.forgotten(self.forgetting, data.T)[1]
        full = np.sqrt(np.sum(memory.covariance * memory.covariance)) / self.covariance_bound
        P = memory.covariance / (full + (1 - full) * np.exp(-self.forgetting * data.T))  # |P|_F follows the logistic equation
        theta_next, P = covariance.correct(theta_hat, P, weight, data, self.leakage, self.dead_zone)
        return covariance.moved(theta_next, P, known_set)

    @property
    def fastest_rate(self) -> float | None:
        return None if self.leakage is not None else 2 * self.covariance_bound + self.forgetting

    def guarantee(self, known_set: EstimateSet | None) -> Guarantee:
        return with_modifications(self.metric, known_set, self.leakage, self.dead_zone)
