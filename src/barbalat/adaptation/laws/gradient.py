"""The gradient law for the instantaneous cost."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

import numpy as np

from barbalat import validate
from barbalat.adaptation import implicit
from barbalat.adaptation.guarantee import ModifiedLaw
from barbalat.adaptation.law import Estimation, Moved, Rates, SampleData
from barbalat.adaptation.modifications import DeadZone, Leakage, accept_dead_zone, accept_leakage
from barbalat.problem.known_set import EstimateSet, Gain, gain, project
from barbalat.protocols import Value
from barbalat.settings import Settings
from barbalat.validate import Array


@dataclass(frozen=True, eq=False)
class Gradient(ModifiedLaw, Settings):
    """theta_hat' = proj(Gamma (epsilon phi - w theta_hat)): steepest descent of (z - theta_hat'phi)^2/(2 m_s^2).

    gamma      Gamma > 0: a number, a diagonal (n,) or an s.p.d. matrix (n, n)
    leakage    the leakage w; none by default
    dead_zone  acts on epsilon m_s; none by default

    V = theta_tilde'Gamma^-1 theta_tilde/2: V' = -epsilon^2 m_s^2, or less with projection. Convergence is exponential if phi/m_s
    is persistently exciting. Source: Ioannou and Sun, sections 4.3.5 and 8.5.2; Ioannou and Fidan, section 3.6.1.
    """

    gamma: float | Array
    _: KW_ONLY
    leakage: Leakage | None = None
    dead_zone: DeadZone | None = None

    def __post_init__(self) -> None:
        validate.freeze(self, gamma=gain.accept("law.gamma", self.gamma))
        accept_leakage(self.leakage, "the gradient law")
        accept_dead_zone(self.dead_zone)

    @property
    def metric(self) -> Gain:
        return Gain(self.gamma)

    def initial(self, n: int) -> tuple[()]:
        self.metric.require_size("law.gamma", n)
        return ()

    def rates(self, theta_hat: Value, memory: tuple[()], estimation: Estimation, known_set: EstimateSet | None) -> Rates:
        if self.dead_zone is not None:
            share = self.dead_zone.weight(estimation.squared_error)
            estimation = estimation._replace(epsilon=share * estimation.epsilon)
        gamma = self.metric
        rate = estimation.descent(gamma)
        if self.leakage is not None:
            w = self.leakage.coefficient(theta_hat, estimation.epsilon * np.sqrt(estimation.m_s_squared))
            rate = rate - gamma.times(w * theta_hat)
        return Rates(project(rate, theta_hat, known_set, gamma), memory)

    def limit(self, memory: tuple[()]) -> tuple[()]:
        return memory

    def sampled_step(self, theta_hat: Value, memory: tuple[()], data: SampleData, known_set: EstimateSet | None) -> Moved:
        theta_hat, _ = implicit.correct(self.metric, data.T, theta_hat, data, self.leakage, self.dead_zone)
        return Moved(implicit.into(theta_hat, known_set, self.metric), memory)

    @property
    def fastest_rate(self) -> float | None:
        """Gamma; None with a leakage, which adds another rate, as in the other laws."""
        return None if self.leakage is not None else self.metric.largest

    def gain_of_rate(self, rate: float) -> float | None:
        return None if self.leakage is not None or self.metric.dimensions else rate
