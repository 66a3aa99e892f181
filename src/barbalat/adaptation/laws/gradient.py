"""The gradient law for the instantaneous cost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.adaptation import gain
from barbalat.adaptation.law import Estimation, Rates
from barbalat.adaptation.modifications import dead_zone as zone
from barbalat.adaptation.modifications import leakage as leak
from barbalat.adaptation.projection import project
from barbalat.problem.known_set import KnownSet
from barbalat.protocols import Value
from barbalat.validate import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Gradient:
    """theta_hat' = proj(Gamma (epsilon phi - w theta_hat)): steepest descent of (z - theta_hat'phi)^2/(2 m_s^2).

    gamma      Gamma > 0: a number, a diagonal (n,) or an s.p.d. matrix (n, n)
    leakage    w; none by default
    dead_zone  on epsilon m_s; none by default

    V = theta_tilde'Gamma^-1 theta_tilde/2: V' = -epsilon^2 m_s^2, less still by projection. Exponential with phi/m_s
    persistently exciting. Source: Ioannou and Sun, sections 4.3.5 and 8.5.2; Ioannou and Fidan, section 3.6.1.
    """

    gamma: float | Array
    leakage: leak.Leakage | None = None
    dead_zone: zone.DeadZone | None = None

    def __post_init__(self) -> None:
        validate.freeze(self, gamma=gain.accept("law.gamma", self.gamma))
        leak.accept(self.leakage, "the gradient law")
        zone.accept(self.dead_zone)

    def initial(self, n: int) -> Any:
        gain.require_size("law.gamma", self.gamma, n)
        return ()

    def rates(self, theta_hat: Value, memory: Any, estimation: Estimation, known_set: KnownSet | None) -> Rates:
        phi, m_s_squared, epsilon = estimation
        if self.dead_zone is not None:
            epsilon = self.dead_zone.weight(epsilon * epsilon * m_s_squared) * epsilon
        rate = gain.scaled(self.gamma, epsilon, phi)
        if self.leakage is not None:
            w = self.leakage.coefficient(theta_hat, epsilon * np.sqrt(m_s_squared))
            rate = rate - gain.times(self.gamma, w * theta_hat)
        return Rates(project(rate, theta_hat, known_set, self.gamma), memory)

    def limit(self, memory: Any) -> Any:
        return memory
