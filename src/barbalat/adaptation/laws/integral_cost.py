"""The gradient law for the integral cost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from barbalat import validate
from barbalat.adaptation import implicit
from barbalat.adaptation.guarantee import Guarantee, with_modifications
from barbalat.adaptation.law import Estimation, Moved, Rates, SampleData, gram, require_room
from barbalat.adaptation.modifications import Leakage, Tolerated, accept_leakage
from barbalat.problem.known_set import EstimateSet, Gain, gain, project
from barbalat.protocols import Value
from barbalat.roles import Role
from barbalat.settings import Settings
from barbalat.validate import Array


class Memory(NamedTuple):
    """The data seen so far, forgotten at the rate beta."""

    R: Value  # (n, n)
    Q: Value  # (n,)


@dataclass(frozen=True, eq=False)
class IntegralCost(Settings):
    """theta_hat' = proj(Gamma (Q - R theta_hat - w theta_hat)): steepest descent of the integral
    of e^{-beta(t-s)} (z(s) - theta_hat(t)'phi(s))^2/(2 m_s^2(s)).

    R' = -beta R + phi phi'/m_s^2, Q' = -beta Q + z phi/m_s^2, both from zero (in the source, Q has the opposite sign).

    gamma       Gamma > 0: a number, a diagonal (n,) or an s.p.d. matrix (n, n)
    forgetting  beta > 0 [1/s]; |R| stays below 1/beta
    leakage     FixedSigma or SwitchingSigma; none by default

    Without modelling error Q = R theta, and V = theta_tilde'Gamma^-1 theta_tilde/2 has V' = -theta_tilde'R theta_tilde <= 0.
    Under persistent excitation the rate of convergence grows with Gamma without bound, unlike the rate for the instantaneous
    cost.

    The law uses an integral of past errors. A dead zone therefore has no single error on which to act, and V' is not proportional
    to the present error, as the epsilon-modification requires. Both are rejected.

    Source: Ioannou and Sun, section 4.3.5; Ioannou and Fidan, section 3.6.2; Kreisselmeier (1977).
    """

    gamma: float | Array
    _: KW_ONLY
    forgetting: float
    leakage: Leakage | None = None

    roles: ClassVar[Mapping[str, Role]] = {
        "R": Role.memory("information matrix in the law's memory"),
        "Q": Role.memory("the rest of the law's memory"),
    }

    def __post_init__(self) -> None:
        validate.freeze(self, gamma=gain.accept("law.gamma", self.gamma))
        validate.freeze(self, forgetting=validate.positive("law.forgetting", self.forgetting))
        accept_leakage(
            self.leakage, "the integral-cost law", Tolerated.BOUNDED, "its V' is not proportional to the current error"
        )

    @property
    def metric(self) -> Gain:
        return Gain(self.gamma)

    def initial(self, n: int) -> Memory:
        self.metric.require_size("law.gamma", n)
        require_room(n)
        return Memory(np.zeros((n, n)), np.zeros(n))

    def rates(self, theta_hat: Value, memory: Memory, estimation: Estimation, known_set: EstimateSet | None) -> Rates:
        phi, m_s_squared, epsilon = estimation
        R, Q = memory
        one = phi.ndim == 1
        z = epsilon * m_s_squared + (theta_hat @ phi if one else phi.T @ theta_hat)
        seen = phi * (z / m_s_squared) if one else phi @ z / m_s_squared
        gamma = self.metric
        rate = gamma.times(Q - R @ theta_hat)
        if self.leakage is not None:
            rate = rate - gamma.times(self.leakage.coefficient(theta_hat, 0.0) * theta_hat)
        return Rates(
            project(rate, theta_hat, known_set, gamma),
            Memory(gram(phi) / m_s_squared - self.forgetting * R, seen - self.forgetting * Q),
        )

    def limit(self, memory: Memory) -> Memory:
        return memory

    def sampled_step(self, theta_hat: Value, memory: Memory, data: SampleData, known_set: EstimateSet | None) -> Moved:
        T, z, phi, m_s_squared = data
        kept, weight = implicit.forgotten(self.forgetting, T)
        R = kept * memory.R + weight * np.outer(phi, phi) / m_s_squared
        Q = kept * memory.Q + weight * z * phi / m_s_squared
        following = implicit.with_leakage(
            self.leakage, theta_hat, 0.0, lambda w: implicit.at_rest(self.metric, theta_hat, T, w, R, Q)[1]
        )
        return Moved(implicit.into(following, known_set, self.metric), Memory(R, Q))

    @property
    def fastest_rate(self) -> float | None:
        """Gamma/beta, since |R| <= 1/beta, or the rate of forgetting if it is larger."""
        return None if self.leakage is not None else max(self.forgetting, self.metric.largest / self.forgetting)

    def guarantee(self, known_set: EstimateSet | None) -> Guarantee:
        return with_modifications(self.metric, known_set, self.leakage, None)
