"""The classical unnormalised law of output-feedback MRAC for relative degree one."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

from barbalat import validate
from barbalat.adaptation.guarantee import CORNERS, Estimates, Guarantee, nothing
from barbalat.adaptation.modifications import DeadZone, Leakage, accept_dead_zone, accept_leakage
from barbalat.problem.known_set import EstimateSet, Gain, gain, project
from barbalat.protocols import Value
from barbalat.settings import Settings
from barbalat.validate import Array

ON_THE_OUTPUT = "a dead zone on the output's error guarantees nothing: V is of the whole state's, and may grow inside"


@dataclass(frozen=True, eq=False)
class LyapunovLaw(Settings):
    """theta_hat' = proj(-Gamma (e omega sgn(k_p/k_m) + w theta_hat)), e = y - y_m.

    gamma      Gamma > 0: a number, a diagonal (2 n,) or an s.p.d. matrix (2 n, 2 n)
    leakage    w; none by default
    dead_zone  on |e|; none by default

    Without modelling error e converges to zero for a strictly positive real W_m; with it, and without a modification, the
    estimates may drift until the loop bursts (Rohrs et al.). Source: Ioannou and Sun, section 6.4.1; Narendra and Annaswamy,
    section 5.3; with sigma: Ioannou and Kokotovic (1983).
    """

    gamma: float | Array
    _: KW_ONLY
    leakage: Leakage | None = None
    dead_zone: DeadZone | None = None

    def __post_init__(self) -> None:
        validate.freeze(self, gamma=gain.accept("law.gamma", self.gamma))
        accept_leakage(self.leakage, "the Lyapunov law")
        accept_dead_zone(self.dead_zone)

    def require_size(self, n: int) -> None:
        Gain(self.gamma).require_size("law.gamma", n)

    def rate(self, theta_hat: Value, omega: Value, e: Value, sign: float, estimate_set: EstimateSet | None) -> Value:
        """theta_hat'; ``sign`` is that of k_p/k_m."""
        if self.dead_zone is not None:
            e = self.dead_zone.weight(e * e) * e
        gamma = Gain(self.gamma)
        rate = -gamma.scaled(sign * e, omega)
        if self.leakage is not None:
            rate = rate - gamma.times(self.leakage.coefficient(theta_hat, e) * theta_hat)
        return project(rate, theta_hat, estimate_set, gamma)

    @property
    def plain(self) -> LyapunovLaw:
        return LyapunovLaw(gamma=self.gamma)

    @property
    def drifts(self) -> bool:
        return self.leakage is None and self.dead_zone is None

    def guarantee(self, known_set: EstimateSet | None) -> Guarantee:
        """On a plant of the assumed class."""
        leaks = self.leakage is not None
        if Gain(self.gamma).is_matrix and known_set is not None and known_set.cuts_corners:
            return nothing(CORNERS, leaks=leaks)
        if self.dead_zone is not None:
            return nothing(ON_THE_OUTPUT, leaks=leaks)
        if self.leakage is None or self.leakage.harmless_within is not None:
            return Guarantee(leaks=leaks, M_0=None if self.leakage is None else self.leakage.harmless_within)
        kind = type(self.leakage).__name__
        return Guarantee(error_to_zero=False, estimates=Estimates.PULLED, leaks=True, why=kind)
