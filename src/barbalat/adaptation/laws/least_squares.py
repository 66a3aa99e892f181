"""The least-squares laws: the paper's (15), and laws that forget, reset or bound the covariance. The covariance is the memory of
all these laws.

V = theta_tilde'P^-1 theta_tilde/2. With P' = beta P - P phi phi'P/m_s^2, (P^-1)' = -beta P^-1 + phi phi'/m_s^2, and so V' =
-epsilon^2 m_s^2/2 - beta V without modelling error. With a dead zone of weight a on both the estimate and the data's effect on P,
and |eta|/m_s <= g_0: V' = -a ((epsilon m_s)^2 - (eta/m_s)^2)/2 - beta V, which is not positive either. Source: Ioannou and Sun,
section 4.3.6.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np

from barbalat import validate
from barbalat.adaptation import implicit
from barbalat.adaptation.guarantee import Guarantee, ModifiedLaw
from barbalat.adaptation.law import Estimation, Moved, Rates, SampleData, gram, require_room
from barbalat.adaptation.modifications import DeadZone, Leakage, Tolerated, accept_dead_zone, accept_leakage
from barbalat.problem.known_set import EstimateSet, Gain, gain, project
from barbalat.protocols import Value
from barbalat.roles import Role
from barbalat.settings import Settings
from barbalat.validate import Array, InputError

NORM_TOLERANCE = 2.0**-46
"""A norm within this relative distance of its bound counts as equal to it; ``bounded`` leaves the norm within 1/16 of this
distance."""

COVARIANCE_METRIC = Gain(np.eye(1))
"""The metric of any covariance law, whatever its initial covariance."""

NO_LOWER_BOUND = "its covariance has no lower bound, which the proof of bounded theta_hat requires"
NOT_PROPORTIONAL = "its V' is not proportional to the current error"


class Memory(NamedTuple):
    """The memory of a least-squares law."""

    covariance: Value  # (n, n) P(t)


class CovarianceLaw(ModifiedLaw):
    """The parts that all least-squares laws share. The fields of a subclass are its settings."""

    roles: ClassVar[Mapping[str, Role]] = {"covariance": Role.memory("covariance P of the least squares (15)", symbol="P")}

    @abstractmethod
    def covariance_rate(self, P: Value, taken: Value) -> Value:
        """P'; ``taken`` is the reduction due to the data."""

    def forgotten(self, P: Value, T: float) -> tuple[Value, Value]:
        """P after T [s] without data, and the weight of the data from that time."""
        return P, T

    @property
    def metric(self) -> Gain:
        return COVARIANCE_METRIC

    def rates(self, theta_hat: Value, memory: Memory, estimation: Estimation, known_set: EstimateSet | None) -> Rates:
        P = memory.covariance
        theta_hat_dot, taken = learn(theta_hat, P, estimation, known_set, self.leakage, self.dead_zone)
        return Rates(theta_hat_dot, Memory(self.covariance_rate(P, taken)))

    def limit(self, memory: Memory) -> Memory:
        return memory

    def sampled_step(self, theta_hat: Value, memory: Memory, data: SampleData, known_set: EstimateSet | None) -> Moved:
        P, weight = self.forgotten(memory.covariance, data.T)
        theta_next, P = correct(theta_hat, P, weight, data, self.leakage, self.dead_zone)
        return Moved(implicit.into(theta_next, known_set, Gain(P)), self.limit(Memory(P)))  # in the metric of the new P


@dataclass(frozen=True, eq=False)
class BoundedCovarianceLaw(CovarianceLaw):
    """A least-squares law that forgets and keeps |P|_F below a bound."""

    covariance0: float | Array
    _: KW_ONLY
    forgetting: float
    covariance_bound: float
    leakage: Leakage | None = None
    dead_zone: DeadZone | None = None

    jump: ClassVar[str] = "the bound of the covariance"
    tolerates: ClassVar[tuple[str, Tolerated, str]]
    """The law's name in messages, the leakages that it accepts, and why it accepts no others."""

    def __post_init__(self) -> None:
        validate.freeze(self, covariance0=gain.accept("law.covariance0", self.covariance0))
        validate.freeze(self, forgetting=validate.positive("law.forgetting", self.forgetting))
        validate.freeze(self, covariance_bound=validate.positive("law.covariance_bound", self.covariance_bound))
        accept_leakage(self.leakage, *self.tolerates)
        accept_dead_zone(self.dead_zone)

    def initial(self, n: int) -> Memory:
        return initial_covariance(self.covariance0, n, self.covariance_bound)

    @property
    def fastest_rate(self) -> float | None:
        return None if self.leakage is not None else 2 * self.covariance_bound + self.forgetting


def initial_covariance(covariance0: float | Array, n: int, bound: float | None = None) -> Memory:
    """P(0) from a number, a diagonal or a matrix; raises InputError if it doesn't fit n or exceeds ``bound`` in the Frobenius
    norm."""
    Gain(covariance0).require_size("law.covariance0", n)
    require_room(n)
    P = Gain(covariance0).as_matrix(n)
    exceeds = bound is not None and np.linalg.norm(P) > bound
    if isinstance(exceeds, (bool, np.bool_)) and exceeds:  # type: ignore[redundant-expr]  # no number where an ensemble varies it
        raise InputError.of(
            "law.covariance0",
            f"must not exceed law.covariance_bound = {bound:g} in the Frobenius norm, but {validate.show(P)} "
            f"has the norm {np.linalg.norm(P):.6g} (the norm of a multiple of I is that multiple times the square root of n)",
        )
    return Memory(P)


def learn(
    theta_hat: Value,
    P: Value,
    estimation: Estimation,
    known_set: EstimateSet | None,
    leakage: Leakage | None,
    dead_zone: DeadZone | None,
) -> tuple[Value, Value]:
    """theta_hat' = proj(P (epsilon phi - w theta_hat)), and the reduction of the covariance by the data: P phi phi'P/m_s^2."""
    phi, m_s_squared, epsilon = estimation
    P_phi = P @ phi
    taken = gram(P_phi) / m_s_squared
    if dead_zone is not None:
        a = dead_zone.weight(estimation.squared_error)
        epsilon, taken = a * epsilon, a * taken
    rate = P_phi * epsilon if phi.ndim == 1 else P_phi @ epsilon
    if leakage is not None:
        rate = rate - P @ (leakage.coefficient(theta_hat, epsilon * np.sqrt(m_s_squared)) * theta_hat)
    return project(rate, theta_hat, known_set, Gain(P)), taken


def correct(
    theta_hat: Value, P: Value, weight: Value, data: SampleData, leakage: Leakage | None, dead_zone: DeadZone | None
) -> tuple[Value, Value]:
    """Estimate and covariance after one sample's data, from P after forgetting; ``weight`` is the weight of the data."""
    theta_next, share = implicit.correct(Gain(P), weight, theta_hat, data, leakage, dead_zone)
    _, _, phi, m_s_squared = data
    P_phi = P @ phi
    taken = weight * share
    shrink = taken / (m_s_squared + taken * gain.quadratic(phi, P_phi))
    P = P - shrink * np.outer(P_phi, P_phi)  # P^-1 grows by taken phi phi'/m_s^2
    return theta_next, P


def held(P: Value, P_dot: Value, bound: float) -> Value:
    """P' = 0 if |P|_F is at its bound and would grow, P_dot otherwise."""
    reach = bound * (1 - NORM_TOLERANCE)
    stops = np.where(np.sum(P * P) >= reach * reach, 1.0, 0.0) * np.where(np.sum(P * P_dot) > 0, 1.0, 0.0)
    return P_dot * (1 - stops)


def bounded(P: Value, bound: float) -> Value:
    """P scaled back to |P|_F <= bound if a stage has overshot it."""
    reach = bound * (1 - NORM_TOLERANCE / 16)
    squared = np.sum(P * P)
    outside = squared > reach * reach
    return np.where(outside, P * (reach / np.sqrt(np.where(outside, squared, 1.0))), P)


def smallest_pivot(P: Value, shift: Value) -> Value:
    """The smallest pivot of the elimination of P - shift I, up to the first that is not positive.

    Positive exactly where lambda_min(P) > shift. A symmetric matrix is positive definite if and only if all its pivots are
    positive (Sylvester's criterion). Up to the first pivot that is not positive, the computed pivots are those of exact
    elimination.
    """
    n = P.shape[0]
    rest = [[P[i, j] - shift if i == j else P[i, j] for j in range(n)] for i in range(n)]
    smallest = rest[0][0]
    for k in range(n):
        pivot = rest[k][k]
        smallest = np.minimum(pivot, smallest)
        inverse = 1 / np.where(pivot > 0, pivot, 1.0)  # after a pivot that is not positive, the others do not matter
        for i in range(k + 1, n):
            factor = rest[i][k] * inverse
            for j in range(k + 1, n):
                rest[i][j] = rest[i][j] - factor * rest[k][j]
    return smallest


@dataclass(frozen=True, eq=False)
class LeastSquares(CovarianceLaw, Settings):
    """theta_hat' = proj(P epsilon phi), P' = -P phi phi'P/m_s^2, P(0) = covariance0: eq. (15).

    covariance0  P(0): a number (times I), a diagonal (n,) or an s.p.d. matrix (n, n)
    leakage      SwitchingSigma; none by default
    dead_zone    acts on epsilon m_s, for the estimate and the covariance; none by default

    P only decreases: (P^-1)' = phi phi'/m_s^2. Under persistent excitation theta_tilde goes to zero like 1/t. A fixed sigma and
    the epsilon-modification are rejected: their proof of boundedness needs V <= c |theta_tilde|^2 for some c, and P^-1 has no
    upper bound here.

    Source: Ioannou and Sun, section 4.3.6; Ioannou and Fidan, section 3.7.2.
    """

    covariance0: float | Array
    _: KW_ONLY
    leakage: Leakage | None = None
    dead_zone: DeadZone | None = None

    def __post_init__(self) -> None:
        validate.freeze(self, covariance0=gain.accept("law.covariance0", self.covariance0))
        accept_leakage(self.leakage, "pure least squares", Tolerated.HARMLESS, NO_LOWER_BOUND)
        accept_dead_zone(self.dead_zone)

    def initial(self, n: int) -> Memory:
        return initial_covariance(self.covariance0, n)

    def covariance_rate(self, P: Value, taken: Value) -> Value:
        return -taken  # (15)

    @property
    def fastest_rate(self) -> float | None:
        """2 P(0): the rate of a covariance is 2 P, the slope of P^2, as in the other least-squares laws."""
        return None if self.leakage is not None else 2 * Gain(self.covariance0).largest


UNEXCITED_REASON = "with unbounded forgetting nothing is guaranteed unless phi/m_s is persistently exciting"


@dataclass(frozen=True, eq=False)
class LeastSquaresForgetting(CovarianceLaw, Settings):
    """theta_hat' = proj(P epsilon phi), P' = beta P - P phi phi'P/m_s^2.

    covariance0  P(0): a number (times I), a diagonal (n,) or an s.p.d. matrix (n, n)
    forgetting   beta > 0 [1/s]
    leakage      SwitchingSigma; none by default

    V' = -epsilon^2 m_s^2/2 - beta V: convergence is exponential under persistent excitation. Without it P grows like e^(beta t)
    (covariance windup), so use a bounded variant. A dead zone is rejected, because P would grow without bound inside it.

    Source: Ioannou and Sun, section 4.3.6; Ioannou and Fidan, section 3.7.1.
    """

    covariance0: float | Array
    _: KW_ONLY
    forgetting: float
    leakage: Leakage | None = None
    dead_zone: DeadZone | None = None

    def __post_init__(self) -> None:
        validate.freeze(self, covariance0=gain.accept("law.covariance0", self.covariance0))
        validate.freeze(self, forgetting=validate.positive("law.forgetting", self.forgetting))
        accept_leakage(self.leakage, "least squares with forgetting", Tolerated.HARMLESS, "its covariance has no bounds")
        if self.dead_zone is not None:
            raise InputError(
                "a dead zone cannot be combined with unbounded forgetting: inside the zone the estimates do not change and "
                "the covariance grows like exp(beta t); use a law with bounded covariance or bounded gain"
            )

    def initial(self, n: int) -> Memory:
        return initial_covariance(self.covariance0, n)

    def covariance_rate(self, P: Value, taken: Value) -> Value:
        return self.forgetting * P - taken

    def forgotten(self, P: Value, T: float) -> tuple[Value, Value]:
        return P * np.exp(self.forgetting * T), implicit.forgotten(self.forgetting, T)[1]

    @property
    def fastest_rate(self) -> float | None:
        """None: nothing bounds the covariance."""
        return None

    def guarantee(self, known_set: EstimateSet | None) -> Guarantee:
        found = super().guarantee(known_set)
        return replace(found, bounded=False, error_to_zero=False, why=UNEXCITED_REASON) if found.bounded else found


@dataclass(frozen=True, eq=False, kw_only=True)
class LeastSquaresResetting(CovarianceLaw, Settings):
    """theta_hat' = proj(P (epsilon phi - w theta_hat)), P' = -P phi phi'P/m_s^2, P(0) = rho_0 I, and P(t+) = rho_0 I wherever
    lambda_min(P(t)) <= rho_1.

    rho_0, rho_1  0 < rho_1 < rho_0
    leakage       FixedSigma or SwitchingSigma; none by default
    dead_zone     acts on epsilon m_s, for the estimate and the covariance; none by default

    rho_1 I <= P <= rho_0 I. A reset lowers V, since P(t) <= rho_0 I before it. The test is exactly the textbook's, without
    eigenvalues: all pivots of P - rho_1 I are positive if and only if lambda_min(P) > rho_1. It is part of ``limit``, so no stage
    of a solver uses a smaller covariance; the time of a reset is resolved to a stage.

    The epsilon-modification is rejected: V' = -((epsilon m_s)^2 - (eta/m_s)^2)/2 - w theta_tilde'theta_hat is positive if epsilon
    = 0 and eta is not, although that leakage is then zero.

    Source: Ioannou and Sun, section 4.3.6; Ioannou and Fidan, section 3.7.3; Goodwin and Mayne (1987).
    """

    rho_0: float
    rho_1: float
    leakage: Leakage | None = None
    dead_zone: DeadZone | None = None

    jump: ClassVar[str] = "a reset of the covariance"

    def __post_init__(self) -> None:
        for name in ("rho_0", "rho_1"):
            validate.freeze(self, **{name: validate.positive(f"law.{name}", getattr(self, name))})
        accept_leakage(self.leakage, "least squares", Tolerated.BOUNDED, NOT_PROPORTIONAL)
        if not self.rho_1 < self.rho_0:
            raise InputError.of("law.rho_1", f"must be below law.rho_0 = {self.rho_0:g}, got {self.rho_1:g}")
        accept_dead_zone(self.dead_zone)

    def initial(self, n: int) -> Memory:
        return initial_covariance(self.rho_0, n)

    def covariance_rate(self, P: Value, taken: Value) -> Value:
        return -taken

    def limit(self, memory: Memory) -> Memory:
        P = memory.covariance
        fresh = self.rho_0 * np.eye(P.shape[0])
        return Memory(np.where(smallest_pivot(P, self.rho_1) <= 0, fresh, P))

    @property
    def fastest_rate(self) -> float | None:
        return None if self.leakage is not None else 2 * self.rho_0


@dataclass(frozen=True, eq=False)
class LeastSquaresBounded(BoundedCovarianceLaw, Settings):
    """theta_hat' = proj(P (epsilon phi - w theta_hat)), P' = beta P - P phi phi'P/m_s^2, but P' = 0 where |P|_F = R_0 would grow.

    covariance0       P(0), |P(0)|_F <= R_0: a number (times I), a diagonal (n,) or an s.p.d. matrix (n, n)
    forgetting        beta > 0 [1/s]
    covariance_bound  R_0 > 0
    leakage           FixedSigma or SwitchingSigma; none by default
    dead_zone         acts on epsilon m_s, for the estimate and the covariance; none by default

    The norm is the Frobenius norm, so P <= R_0 I, and the test needs only arithmetic. P^-1 stays bounded as well, since (P^-1)'
    is zero or -beta P^-1 + phi phi'/m_s^2. In the source P stays constant forever once it is at the bound; here it changes again
    as soon as it would shrink. V' <= 0 in both cases. In a fixed-step solver P is scaled back at every stage that overshoots.

    The epsilon-modification is rejected for the reason given at LeastSquaresResetting.

    Source: Ioannou and Sun, section 4.3.6; Ioannou and Fidan, section 3.7.3.
    """

    tolerates: ClassVar[tuple[str, Tolerated, str]] = ("least squares", Tolerated.BOUNDED, NOT_PROPORTIONAL)

    def covariance_rate(self, P: Value, taken: Value) -> Value:
        return held(P, self.forgetting * P - taken, self.covariance_bound)

    def limit(self, memory: Memory) -> Memory:
        return Memory(bounded(memory.covariance, self.covariance_bound))

    def sampled_step(self, theta_hat: Value, memory: Memory, data: SampleData, known_set: EstimateSet | None) -> Moved:
        given, T = memory.covariance, data.T
        weight, forgotten = implicit.forgotten(self.forgetting, T)[1], given * np.exp(self.forgetting * T)
        theta_next, P = correct(theta_hat, forgotten, weight, data, self.leakage, self.dead_zone)
        grown = np.sum(P * P) > self.covariance_bound * self.covariance_bound
        at_bound, _ = implicit.correct(Gain(given), T, theta_hat, data, self.leakage, self.dead_zone)
        theta_next, P = np.where(grown, at_bound, theta_next), np.where(grown, given, P)
        return Moved(implicit.into(theta_next, known_set, Gain(P)), self.limit(Memory(P)))


@dataclass(frozen=True, eq=False)
class LeastSquaresBoundedGain(BoundedCovarianceLaw, Settings):
    """theta_hat' = proj(P epsilon phi), P' = beta(t) P - P phi phi'P/m_s^2, beta(t) = beta_0 (1 - |P|_F/k_0).

    covariance0       P(0), |P(0)|_F <= k_0: a number (times I), a diagonal (n,) or an s.p.d. matrix (n, n)
    forgetting        beta_0 > 0 [1/s]
    covariance_bound  k_0 > 0
    leakage           SwitchingSigma; none by default
    dead_zone         acts on epsilon m_s, for the estimate and the covariance; none by default

    The norm is the Frobenius norm, so P <= k_0 I: d|P|_F/dt <= beta_0 (1 - |P|_F/k_0) |P|_F, which vanishes at k_0. Convergence
    is exponential under persistent excitation, and there is no windup without it, because the forgetting fades. V' = -epsilon^2
    m_s^2/2 - beta(t) V.

    A fixed sigma and the epsilon-modification are rejected: while one direction stays at k_0 nothing is forgotten, and P
    decreases in the other directions as in pure least squares, without a lower bound.

    Source: Slotine and Li, Applied Nonlinear Control, section 8.7.5.
    """

    tolerates: ClassVar[tuple[str, Tolerated, str]] = ("bounded-gain forgetting", Tolerated.HARMLESS, NO_LOWER_BOUND)

    def covariance_rate(self, P: Value, taken: Value) -> Value:
        beta = self.forgetting * (1 - np.sqrt(np.sum(P * P)) / self.covariance_bound)
        return beta * P - taken

    def forgotten(self, P: Value, T: float) -> tuple[Value, Value]:
        full = np.sqrt(np.sum(P * P)) / self.covariance_bound
        kept = P / (full + (1 - full) * np.exp(-self.forgetting * T))  # |P|_F follows the logistic equation
        return kept, implicit.forgotten(self.forgetting, T)[1]
