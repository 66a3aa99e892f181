"""Least squares with covariance resetting."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from barbalat import validate
from barbalat.adaptation.laws import covariance
from barbalat.adaptation.laws.covariance import CovarianceLaw, Memory
from barbalat.adaptation.modifications import dead_zone as zone
from barbalat.adaptation.modifications import leakage as leak
from barbalat.protocols import Value
from barbalat.settings import Settings
from barbalat.validate import InputError


@dataclass(frozen=True, eq=False, kw_only=True)
class LeastSquaresResetting(CovarianceLaw, Settings):
    """theta_hat' = proj(P (epsilon phi - w theta_hat)), P' = -P phi phi'P/m_s^2, P(0) = rho_0 I, and P(t+) = rho_0 I wherever
    lambda_min(P(t)) <= rho_1.

    rho_0, rho_1  0 < rho_1 < rho_0
    leakage       FixedSigma or SwitchingSigma; none by default
    dead_zone     on epsilon m_s, for the estimate and the covariance; none by default

    rho_1 I <= P <= rho_0 I. A reset lowers V, since P(t) <= rho_0 I before it. The test is the textbook's, exactly and without
    eigenvalues: all pivots of P - rho_1 I are positive where lambda_min(P) > rho_1 and only there. It stands in ``limit``, so
    that no stage of a solver sees a smaller covariance; the time of a reset is resolved to a stage.

    The epsilon-modification is refused: V' = -((epsilon m_s)^2 - (eta/m_s)^2)/2 - w theta_tilde'theta_hat is positive where
    epsilon = 0 and eta is not, and there that leakage is off.

    Source: Ioannou and Sun, section 4.3.6; Ioannou and Fidan, section 3.7.3; Goodwin and Mayne (1987).
    """

    rho_0: float
    rho_1: float
    leakage: leak.Leakage | None = None
    dead_zone: zone.DeadZone | None = None

    jump: ClassVar[str] = "a reset of the covariance"

    def __post_init__(self) -> None:
        for name in ("rho_0", "rho_1"):
            validate.freeze(self, **{name: validate.positive(f"law.{name}", getattr(self, name))})
        leak.accept(self.leakage, "least squares", leak.Borne.BOUNDED, covariance.NOT_PROPORTIONAL)
        if not self.rho_1 < self.rho_0:
            raise InputError.of("law.rho_1", f"must be below law.rho_0 = {self.rho_0:g}, got {self.rho_1:g}")
        zone.accept(self.dead_zone)

    def initial(self, n: int) -> Memory:
        return covariance.initial(self.rho_0, n)

    def covariance_rate(self, P: Value, taken: Value) -> Value:
        return -taken

    def limit(self, memory: Memory) -> Memory:
        P = memory.covariance
        fresh = self.rho_0 * np.eye(P.shape[0])
        return Memory(np.where(covariance.smallest_pivot(P, self.rho_1) <= 0, fresh, P))

    @property
    def fastest_rate(self) -> float | None:
        return None if self.leakage is not None else 2 * self.rho_0
