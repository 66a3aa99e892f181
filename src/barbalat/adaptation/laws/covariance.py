"""What the least-squares laws share: the covariance as their memory, and the step that the data take.

V = theta_tilde'P^-1 theta_tilde/2. With P' = beta P - P phi phi'P/m_s^2, (P^-1)' = -beta P^-1 + phi phi'/m_s^2, and so
V' = -epsilon^2 m_s^2/2 - beta V without modelling error. With a dead zone of weight a, on the estimate and on what the data
take from P alike, and |eta|/m_s <= g_0: V' = -a ((epsilon m_s)^2 - (eta/m_s)^2)/2 - beta V, which is not positive either.
Source: Ioannou and Sun, section 4.3.6.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from barbalat import validate
from barbalat.adaptation import implicit
from barbalat.adaptation.guarantee import ModifiedLaw
from barbalat.adaptation.law import Estimation, Moved, Rates, SampleData, gram, require_room
from barbalat.adaptation.modifications import dead_zone as zone
from barbalat.adaptation.modifications import leakage as leak
from barbalat.adaptation.modifications.dead_zone import DeadZone
from barbalat.problem.known_set import EstimateSet, Gain, gain, project
from barbalat.protocols import Value
from barbalat.roles import Role
from barbalat.validate import Array, InputError

NORM_TOLERANCE = 2.0**-46
"""A norm this near to its bound, relatively, counts as at it; ``bounded`` leaves it within a sixteenth of that."""

COVARIANCE_METRIC = Gain(np.eye(1))
"""What a covariance is, whatever it starts as."""

NO_LOWER_BOUND = "its covariance has no lower bound, which the proof that theta_hat stays bounded needs"
NOT_PROPORTIONAL = "its V' is not proportional to the present error"


class Memory(NamedTuple):
    """The memory of a least-squares law."""

    covariance: Value  # (n, n) P(t)


class CovarianceLaw(ModifiedLaw):
    """A least-squares law: what all of them do alike. Its fields are the law's own."""

    roles: ClassVar[Mapping[str, Role]] = {"covariance": Role.memory("covariance P of the least squares (15)", symbol="P")}

    @abstractmethod
    def covariance_rate(self, P: Value, taken: Value) -> Value:
        """P', of which the data take ``taken``."""

    def forgotten(self, P: Value, T: float) -> tuple[Value, Value]:
        """P after T [s] without data, and the weight of the data of that time."""
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
    """One that forgets, and keeps |P|_F below a bound."""

    covariance0: float | Array
    _: KW_ONLY
    forgetting: float
    covariance_bound: float
    leakage: leak.Leakage | None = None
    dead_zone: DeadZone | None = None

    jump: ClassVar[str] = "the bound of the covariance"

    def __post_init__(self) -> None:
        validate.freeze(self, covariance0=gain.accept("law.covariance0", self.covariance0))
        validate.freeze(self, forgetting=validate.positive("law.forgetting", self.forgetting))
        validate.freeze(self, covariance_bound=validate.positive("law.covariance_bound", self.covariance_bound))
        self.accept_leakage()
        zone.accept(self.dead_zone)

    @abstractmethod
    def accept_leakage(self) -> None:
        """InputError for a leakage that the law does not bear."""

    def initial(self, n: int) -> Memory:
        return initial(self.covariance0, n, self.covariance_bound)

    @property
    def fastest_rate(self) -> float | None:
        return None if self.leakage is not None else 2 * self.covariance_bound + self.forgetting


def initial(covariance0: float | Array, n: int, bound: float | None = None) -> Memory:
    """P(0) of a number, a diagonal or a matrix; InputError where it doesn't fit n or exceeds ``bound`` in the Frobenius norm."""
    Gain(covariance0).require_size("law.covariance0", n)
    require_room(n)
    P = Gain(covariance0).as_matrix(n)
    exceeds = bound is not None and np.linalg.norm(P) > bound
    if isinstance(exceeds, (bool, np.bool_)) and exceeds:  # no number where an ensemble varies it; its members were checked  # type: ignore[redundant-expr]
        raise InputError.of(
            "law.covariance0",
            f"must not exceed law.covariance_bound = {bound:g} in the Frobenius norm, but {validate.show(P)} "
            f"has the norm {np.linalg.norm(P):.6g} (a multiple of I has that times the square root of n)",
        )
    return Memory(P)


def learn(
    theta_hat: Value,
    P: Value,
    estimation: Estimation,
    known_set: EstimateSet | None,
    leakage: leak.Leakage | None,
    dead_zone: DeadZone | None,
) -> tuple[Value, Value]:
    """theta_hat' = proj(P (epsilon phi - w theta_hat)), and what the data take from the covariance: P phi phi'P/m_s^2."""
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
    theta_hat: Value, P: Value, weight: Value, data: SampleData, leakage: leak.Leakage | None, dead_zone: DeadZone | None
) -> tuple[Value, Value]:
    """Estimate and covariance after one sample's data, from P as forgetting leaves it; ``weight`` is the data's."""
    theta_next, share = implicit.correct(Gain(P), weight, theta_hat, data, leakage, dead_zone)
    _, _, phi, m_s_squared = data
    P_phi = P @ phi
    taken = weight * share
    shrink = taken / (m_s_squared + taken * gain.quadratic(phi, P_phi))
    P = P - shrink * np.outer(P_phi, P_phi)  # P^-1 grows by taken phi phi'/m_s^2
    return theta_next, P


def held(P: Value, P_dot: Value, bound: float) -> Value:
    """P' = 0 where |P|_F is at its bound and would grow, P_dot elsewhere."""
    reach = bound * (1 - NORM_TOLERANCE)
    stops = np.where(np.sum(P * P) >= reach * reach, 1.0, 0.0) * np.where(np.sum(P * P_dot) > 0, 1.0, 0.0)
    return P_dot * (1 - stops)


def bounded(P: Value, bound: float) -> Value:
    """P scaled back to |P|_F <= bound, where a stage has overshot it."""
    reach = bound * (1 - NORM_TOLERANCE / 16)
    squared = np.sum(P * P)
    outside = squared > reach * reach
    return np.where(outside, P * (reach / np.sqrt(np.where(outside, squared, 1.0))), P)


def smallest_pivot(P: Value, shift: Value) -> Value:
    """The smallest pivot of the elimination of P - shift I, up to the first that is not positive.

    Positive exactly where lambda_min(P) > shift: a symmetric matrix is positive definite if and only if all its pivots are
    positive (Sylvester's criterion), and up to the first that is not, they are those of exact elimination.
    """
    n = P.shape[0]
    rest = [[P[i, j] - shift if i == j else P[i, j] for j in range(n)] for i in range(n)]
    smallest = rest[0][0]
    for k in range(n):
        pivot = rest[k][k]
        smallest = np.minimum(pivot, smallest)
        inverse = 1 / np.where(pivot > 0, pivot, 1.0)  # behind a pivot that is not positive nothing counts any more
        for i in range(k + 1, n):
            factor = rest[i][k] * inverse
            for j in range(k + 1, n):
                rest[i][j] = rest[i][j] - factor * rest[k][j]
    return smallest
