"""Guarantees of a scheme with an adaptive law, as data; the certificates turn them into sentences."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from enum import Enum

from barbalat.adaptation.modifications import DeadZone, Leakage
from barbalat.problem.known_set import EstimateSet, Gain
from barbalat.problem.known_set.cone import EXACT_FACES


class Estimates(Enum):
    """The behaviour of the estimates."""

    SETTLE = "V of the law never grows"
    PULLED = "a leakage pulls them towards zero"
    UNKNOWN = "nothing is guaranteed for them"


@dataclass(frozen=True, kw_only=True)
class Guarantee:
    """Guarantees of a scheme with a law on the plant without modelling error.

    bounded        all signals, theta_hat and epsilon m_s among them
    error_to_zero  the tracking error converges to zero
    estimates      the behaviour of the estimates
    leaks          whether a leakage keeps the estimates bounded even under a modelling error
    why            if not ``bounded``, the sentence that says so; if not ``error_to_zero``, the reason why the error does not
                   converge to zero
    M_0            the bound on |theta| that the user supplies; None if none is needed
    """

    bounded: bool = True
    error_to_zero: bool = True
    estimates: Estimates = Estimates.SETTLE
    leaks: bool = False
    why: str = ""
    M_0: float | None = None


SMALL_ENOUGH = "with a normalised law, x stays bounded if {} is small enough; the limit is not known"
CORNERS = "nothing is guaranteed if the projection cuts corners"


def nothing(why: str, *, leaks: bool = False) -> Guarantee:
    """The guarantee of a law that guarantees nothing, with the reason."""
    return Guarantee(bounded=False, error_to_zero=False, estimates=Estimates.UNKNOWN, leaks=leaks, why=why)


class ModifiedLaw(ABC):
    """The guarantee of a law for which V' <= 0 holds without its modifications."""

    leakage: Leakage | None
    dead_zone: DeadZone | None

    @property
    @abstractmethod
    def metric(self) -> Gain:
        """Gamma in V. For a covariance, only the fact that it is a matrix is used."""

    def guarantee(self, known_set: EstimateSet | None) -> Guarantee:
        return with_modifications(self.metric, known_set, self.leakage, self.dead_zone)


def with_modifications(
    metric: Gain, known_set: EstimateSet | None, leakage: Leakage | None, dead_zone: DeadZone | None
) -> Guarantee:
    """The guarantee of a normalised scheme whose law has V' <= 0 without leakage and dead zone.

    With a leakage or a dead zone, epsilon m_s is not square integrable, only small in the mean. The proof that x stays bounded
    then requires it to be small enough, but no threshold is known. For example, with a dead zone wider than the largest epsilon
    m_s nothing is learnt, and an unstable loop stays unstable. Source: Ioannou and Sun, section 9.3.
    """
    leaks = leakage is not None
    if metric.is_matrix and known_set is not None and known_set.cuts_corners:
        return nothing(f"{CORNERS}: a gain matrix in a box of more than {EXACT_FACES} parameters", leaks=leaks)
    if leakage is not None and leakage.harmless_within is None:
        why = SMALL_ENOUGH.format(type(leakage).__name__)
        return Guarantee(bounded=False, error_to_zero=False, estimates=Estimates.PULLED, leaks=True, why=why)
    M_0 = None if leakage is None else leakage.harmless_within
    if dead_zone is not None:
        return Guarantee(bounded=False, error_to_zero=False, leaks=leaks, why=SMALL_ENOUGH.format("a dead zone"), M_0=M_0)
    return Guarantee(leaks=leaks, M_0=M_0)
