"""Pure least squares: the law (15) of the paper."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

from barbalat import validate
from barbalat.adaptation.laws import covariance
from barbalat.adaptation.laws.covariance import CovarianceLaw, Memory
from barbalat.adaptation.modifications import dead_zone as zone
from barbalat.adaptation.modifications import leakage as leak
from barbalat.problem.known_set import Gain, gain
from barbalat.protocols import Value
from barbalat.settings import Settings
from barbalat.validate import Array


@dataclass(frozen=True, eq=False)
class LeastSquares(CovarianceLaw, Settings):
    """theta_hat' = proj(P epsilon phi), P' = -P phi phi'P/m_s^2, P(0) = covariance0: eq. (15).

    covariance0  P(0): a number (times I), a diagonal (n,) or an s.p.d. matrix (n, n)
    leakage      SwitchingSigma; none by default
    dead_zone    on epsilon m_s, for the estimate and the covariance; none by default

    P only decreases: (P^-1)' = phi phi'/m_s^2. Under persistent excitation theta_tilde goes to zero like 1/t. A fixed sigma and
    the epsilon-modification are refused: their proof of boundedness needs V <= c |theta_tilde|^2 for some c, and P^-1 has no
    upper bound here.

    Source: Ioannou and Sun, section 4.3.6; Ioannou and Fidan, section 3.7.2.
    """

    covariance0: float | Array
    _: KW_ONLY
    leakage: leak.Leakage | None = None
    dead_zone: zone.DeadZone | None = None

    def __post_init__(self) -> None:
        validate.freeze(self, covariance0=gain.accept("law.covariance0", self.covariance0))
        leak.accept(self.leakage, "pure least squares", leak.Borne.HARMLESS, covariance.NO_LOWER_BOUND)
        zone.accept(self.dead_zone)

    def initial(self, n: int) -> Memory:
        return covariance.initial(self.covariance0, n)

    def covariance_rate(self, P: Value, taken: Value) -> Value:
        return -taken  # (15)

    @property
    def fastest_rate(self) -> float | None:
        """2 P(0): a covariance's rate is the slope 2 P of P^2, likewise in the other least-squares laws."""
        return None if self.leakage is not None else 2 * Gain(self.covariance0).largest
