"""The Lyapunov laws of MRAC (4), L1-AC (7) and output feedback, with their modifications."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from typing import Any, Protocol

from barbalat import validate
from barbalat.adaptation.guarantee import CORNERS, Estimates, Guarantee, nothing
from barbalat.adaptation.learning import CompositeLearning
from barbalat.adaptation.modifications import DeadZone, Leakage, Tolerated, accept_dead_zone, accept_leakage
from barbalat.problem.known_set import EstimateSet, Gain, gain, project
from barbalat.protocols import Value
from barbalat.roles import Role
from barbalat.settings import Settings
from barbalat.validate import Array, InputError


class ModifiedSettings(Protocol):
    """Settings of a scheme whose law may be modified."""

    @property
    def leakage(self) -> Leakage | None: ...

    @property
    def dead_zone(self) -> DeadZone | None: ...

    @property
    def learning(self) -> CompositeLearning | None: ...


@dataclass(frozen=True, eq=False, kw_only=True)
class Modifications:
    """theta_hat' = proj(Gamma (a Phi(x) b'P e + gamma_c (Q - R theta_hat) - w theta_hat)); each part is off unless given.

    leakage    w, with error = a e'P b
    dead_zone  the dead zone, with the factor a; it acts on sqrt(e'P e)
    learning   the memory Q, R of composite learning
    """

    leakage: Leakage | None = None
    dead_zone: DeadZone | None = None
    learning: CompositeLearning | None = None

    def __post_init__(self) -> None:
        accept_dead_zone(self.dead_zone)
        if self.learning is None:
            accept_leakage(self.leakage, "the Lyapunov law")
            return
        validate.instance("learning", self.learning, CompositeLearning)
        accept_leakage(self.leakage, "composite learning", Tolerated.BOUNDED, "its V' is not proportional to the current error")
        if self.dead_zone is not None:
            raise InputError(
                "a dead zone cannot be combined with composite learning: the memory keeps adapting inside the zone, on data "
                "that the zone should exclude"
            )

    @classmethod
    def of(cls, settings: ModifiedSettings) -> Modifications:
        """Raise InputError for parts that can't be combined."""
        return cls(leakage=settings.leakage, dead_zone=settings.dead_zone, learning=settings.learning)

    @property
    def roles(self) -> Mapping[str, Role]:
        """Roles of the memory of composite learning."""
        return {} if self.learning is None else self.learning.roles

    def initial(self, b: Array, x0: Array, parameters: int) -> Any:
        """The memory at t = 0: () without learning."""
        return () if self.learning is None else self.learning.initial(b, x0, parameters)

    def memory_rates(self, memory: Any, A_m: Array, b: Array, x: Value, phi: Value, u: Value) -> Any:
        """The memory's derivative; ``u`` is the input, to which theta'phi is added."""
        return memory if self.learning is None else self.learning.rates(memory, A_m, b, x, phi, u)

    def require_fit(self, inputs: int) -> None:
        """Raise InputError for a modification that is defined for one input only."""
        leakage = self.leakage if self.leakage is not None and self.leakage.one_input_only else None
        for part in (self.learning, leakage):
            if inputs > 1 and part is not None:
                raise InputError(f"{type(part).__name__} supports only plants with one input, got {inputs}")

    def rate(
        self, gamma: Gain, e: Value, P: Array, b: Array, phi: Value, theta_hat: Value, memory: Any, known_set: EstimateSet | None
    ) -> Value:
        """theta_hat' for the error ``e``: the tracking error of MRAC, the prediction error of L1-AC."""
        error = e @ (P @ b)
        if self.dead_zone is not None:
            error = error * self.dead_zone.weight(e @ (P @ e))
        rate = gamma.scaled(error, phi) if len(phi.shape) == 1 else gamma.times(phi @ error)
        if self.learning is not None:
            rate = rate + gamma.times(self.learning.pull(memory, theta_hat))
        if self.leakage is not None:
            rate = rate - gamma.times(self.leakage.coefficient(theta_hat, error) * theta_hat)
        return project(rate, theta_hat, known_set, gamma)


ON_THE_OUTPUT = (
    "a dead zone on the output error guarantees nothing: V depends on the error of the whole state and may grow inside the zone"
)


@dataclass(frozen=True, eq=False)
class LyapunovLaw(Settings):
    """theta_hat' = proj(-Gamma (e omega sgn(k_p/k_m) + w theta_hat)), e = y - y_m.

    gamma      Gamma > 0: a number, a diagonal (2 n,) or an s.p.d. matrix (2 n, 2 n)
    leakage    the leakage w; none by default
    dead_zone  acts on |e|; none by default

    Without modelling error, e converges to zero if W_m is strictly positive real. With modelling error and without a
    modification, the estimates may drift until the loop bursts (Rohrs et al.). Source: Ioannou and Sun, section 6.4.1; Narendra
    and Annaswamy, section 5.3; with sigma: Ioannou and Kokotovic (1983).
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
        """The guarantee on a plant of the assumed class."""
        leaks = self.leakage is not None
        if Gain(self.gamma).is_matrix and known_set is not None and known_set.cuts_corners:
            return nothing(CORNERS, leaks=leaks)
        if self.dead_zone is not None:
            return nothing(ON_THE_OUTPUT, leaks=leaks)
        if self.leakage is None or self.leakage.harmless_within is not None:
            return Guarantee(leaks=leaks, M_0=None if self.leakage is None else self.leakage.harmless_within)
        kind = type(self.leakage).__name__
        return Guarantee(error_to_zero=False, estimates=Estimates.PULLED, leaks=True, why=kind)
