"""Least squares with forgetting."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, replace

import numpy as np

from barbalat import validate
from barbalat.adaptation import implicit
from barbalat.adaptation.guarantee import Guarantee
from barbalat.adaptation.laws import covariance
from barbalat.adaptation.laws.covariance import CovarianceLaw, Memory
from barbalat.adaptation.modifications import dead_zone as zone
from barbalat.adaptation.modifications import leakage as leak
from barbalat.problem.known_set import EstimateSet, gain
from barbalat.protocols import Value
from barbalat.settings import Settings
from barbalat.validate import Array, InputError

UNEXCITED_REASON = "with unbounded forgetting nothing is guaranteed unless phi/m_s is persistently exciting"


@dataclass(frozen=True, eq=False)
class LeastSquaresForgetting(CovarianceLaw, Settings):
    """theta_hat' = proj(P epsilon phi), P' = beta P - P phi phi'P/m_s^2.

    covariance0  P(0): a number (times I), a diagonal (n,) or an s.p.d. matrix (n, n)
    forgetting   beta > 0 [1/s]
    leakage      SwitchingSigma; none by default

    V' = -epsilon^2 m_s^2/2 - beta V: exponential under persistent excitation. Without it P grows like e^(beta t) (covariance
    windup): use a bounded variant. A dead zone is refused, for inside it nothing keeps P from growing.

    Source: Ioannou and Sun, section 4.3.6; Ioannou and Fidan, section 3.7.1.
    """

    covariance0: float | Array
    _: KW_ONLY
    forgetting: float
    leakage: leak.Leakage | None = None
    dead_zone: zone.DeadZone | None = None

    def __post_init__(self) -> None:
        validate.freeze(self, covariance0=gain.accept("law.covariance0", self.covariance0))
        validate.freeze(self, forgetting=validate.positive("law.forgetting", self.forgetting))
        leak.accept(self.leakage, "least squares with forgetting", leak.Borne.HARMLESS, "its covariance has no bounds")
        if self.dead_zone is not None:
            raise InputError(
                "a dead zone can't go with unbounded forgetting: inside the zone nothing is learnt and the covariance grows like "
                "exp(beta t); take a law with bounded covariance or bounded gain"
            )

    def initial(self, n: int) -> Memory:
        return covariance.initial(self.covariance0, n)

    def covariance_rate(self, P: Value, taken: Value) -> Value:
        return self.forgetting * P - taken

    def forgotten(self, P: Value, T: float) -> tuple[Value, Value]:
        return P * np.exp(self.forgetting * T), implicit.forgotten(self.forgetting, T)[1]

    @property
    def fastest_rate(self) -> float | None:
        """Nothing bounds the covariance."""
        return None

    def guarantee(self, known_set: EstimateSet | None) -> Guarantee:
        found = super().guarantee(known_set)
        return replace(found, bounded=False, error_to_zero=False, why=UNEXCITED_REASON) if found.bounded else found
