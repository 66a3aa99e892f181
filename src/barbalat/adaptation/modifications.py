"""Modifications of a law: leakage terms -Gamma w theta_hat and dead zones, and the errors raised for modifications that a law
does not admit."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np

from barbalat import validate
from barbalat.protocols import Value
from barbalat.settings import Settings
from barbalat.validate import InputError, show


@dataclass(frozen=True, eq=False)
class DeadZone(Settings):
    """A continuous dead zone of half-width g_0 > 0: an error of size E counts as E - g_0 outside the zone and as zero inside it.

    g_0  half-width of the zone: a bound on the modelling error

    For the laws on the parametric model E = |epsilon m_s|, so epsilon becomes epsilon + g with g = -g_0/m_s for epsilon m_s >
    g_0, g_0/m_s for epsilon m_s < -g_0, -epsilon between. With |eta|/m_s <= g_0 for the modelling error eta, V =
    theta_tilde'Gamma^-1 theta_tilde does not grow. The price is that the error converges to the zone and not to zero.

    For the Lyapunov laws of MRAC and L1-AC E = sqrt(e'P e). With a matched disturbance |d| <= d_0,
    g_0 >= 2 d_0 |P b| sqrt(lambda_max(P)) makes V = max(0, E - g_0)^2 + theta_tilde'Gamma^-1 theta_tilde non-increasing:
    outside the zone V' = (1 - g_0/E)(-|e|^2 + 2 e'P b d) and |e| >= g_0/sqrt(lambda_max(P)) >= 2 |P b| d_0.

    Source: Ioannou and Sun, section 8.4.3; Peterson and Narendra (1982), IEEE TAC 27(6).
    """

    g_0: float

    bend: ClassVar[str] = "the dead zone's edge"

    def __post_init__(self) -> None:
        validate.freeze(self, g_0=validate.positive("g_0", self.g_0))

    def weight(self, squared_error: Value) -> Value:
        """Return max(0, E - g_0)/E, computed from E^2: the fraction of the error that counts, in [0, 1)."""
        return 1 - self.g_0 / np.sqrt(np.maximum(squared_error, self.g_0 * self.g_0))

    def share(self, squared_error: Value, speed: Value) -> Value:
        """Return a = 1 - g_0/|E_next|, where an implicit step leaves the error E_next = E/(1 + a speed). This is a linear
        equation in a."""
        E = np.sqrt(np.maximum(squared_error, self.g_0 * self.g_0))
        return (E - self.g_0) / (E + speed * self.g_0)


def accept_dead_zone(dead_zone: DeadZone | None) -> None:
    """Raise InputError for an object that is not a dead zone."""
    if dead_zone is not None:
        validate.instance("dead_zone", dead_zone, DeadZone)


@runtime_checkable
class Leakage(Protocol):
    """A leakage w >= 0; the law becomes theta_hat' = proj(Gamma (epsilon phi - w theta_hat))."""

    def coefficient(self, theta_hat: Value, error: Value) -> Value:
        """w; ``error`` is the scalar that drives the law: epsilon m_s, or e'P b."""
        ...

    @property
    def largest(self) -> float:
        """The largest possible w [1/s per unit of gain]; infinite without a bound."""
        ...

    @property
    def per_error(self) -> float | None:
        """nu of a leakage w = nu |error|, which bounds the estimates whatever drives the law; None for any other leakage."""
        ...

    @property
    def harmless_within(self) -> float | None:
        """The bound on |theta|_2 up to which the leakage never increases V'; None if the leakage prevents convergence to zero."""
        ...

    @property
    def one_input_only(self) -> bool:
        """Whether the error must be a scalar."""
        ...

    def over_sample(self, theta_hat: Value, error: Value, solve: Callable[[Value], Value]) -> Value:
        """w, held for one sample; ``error`` is taken before the estimates move, and ``solve(w)`` is the estimate at the end."""
        ...


class Tolerated(Enum):
    """The leakages that a law admits, with the package's leakages of that kind."""

    ALL = "FixedSigma, SwitchingSigma or EpsilonModification"
    BOUNDED = "FixedSigma or SwitchingSigma"
    HARMLESS = "SwitchingSigma"

    def includes(self, leakage: Leakage) -> bool:
        bounded, harmless = math.isfinite(leakage.largest), leakage.harmless_within is not None
        return {Tolerated.ALL: True, Tolerated.BOUNDED: bounded, Tolerated.HARMLESS: bounded and harmless}[self]


def accept_leakage(leakage: Leakage | None, law: str, tolerated: Tolerated = Tolerated.ALL, reason: str = "") -> None:
    """Raise InputError for an object that is not a leakage, and for a leakage that the law does not admit; the message then gives
    the reason."""
    if leakage is None:
        return
    if not isinstance(leakage, Leakage) or isinstance(leakage, type):  # type: ignore[redundant-expr]
        raise InputError(f"leakage must be a {Tolerated.ALL.value}, got {show(leakage)}")
    if not tolerated.includes(leakage):
        raise InputError(f"{type(leakage).__name__} cannot be combined with {law}: {reason}; use {tolerated.value} instead")


class PullingLeakage(ABC):
    """A leakage that prevents convergence to zero for every theta; over a sample it is held at the value that it has before the
    estimates move."""

    harmless_within: ClassVar[float | None] = None

    @abstractmethod
    def coefficient(self, theta_hat: Value, error: Value) -> Value:
        """w, as defined in ``Leakage``."""

    def over_sample(self, theta_hat: Value, error: Value, solve: Callable[[Value], Value]) -> Value:
        return self.coefficient(theta_hat, error)


@dataclass(frozen=True, eq=False)
class FixedSigma(PullingLeakage, Settings):
    """w = sigma > 0: the estimates stay bounded under bounded modelling errors without a known set.

    sigma  the leakage

    The drawback: V' = ... - sigma theta_tilde'theta_hat may be positive, so even without modelling error the tracking error
    converges only to a set of the order of sqrt(sigma) |theta|.

    Source: Ioannou and Kokotovic (1983); Ioannou and Sun, section 8.4.1.
    """

    sigma: float

    one_input_only: ClassVar[bool] = False
    per_error: ClassVar[float | None] = None

    def __post_init__(self) -> None:
        validate.freeze(self, sigma=validate.positive("sigma", self.sigma))

    def coefficient(self, theta_hat: Value, error: Value) -> Value:
        return self.sigma

    @property
    def largest(self) -> float:
        """The largest leakage w, which is always sigma."""
        return self.sigma


LEAST_M_0 = 1e-15
"""Smallest M_0 of a switching sigma. The square of a much smaller one is zero in 32 bits, which reverses the leakage's sign."""


@dataclass(frozen=True, eq=False)
class SwitchingSigma(Settings):
    """w = 0 for |theta_hat| <= M_0, sigma (|theta_hat|/M_0 - 1) up to 2 M_0, sigma beyond; Euclidean norm.

    sigma  the leakage for large estimates
    M_0    the norm at which the leakage begins: a bound on |theta|

    For |theta| <= M_0, w theta_tilde'theta_hat >= w |theta_hat| (|theta_hat| - M_0) >= 0: every guarantee without modelling error
    also holds with this leakage, for every law. M_0 must be a bound on |theta|.

    Source: Ioannou and Tsakalis (1986); Ioannou and Sun, section 8.4.1, with q_0 = 1.
    """

    sigma: float
    M_0: float

    one_input_only: ClassVar[bool] = False
    per_error: ClassVar[float | None] = None
    bend: ClassVar[str] = "an edge of the leakage's switching"

    def __post_init__(self) -> None:
        validate.freeze(self, sigma=validate.positive("sigma", self.sigma))
        validate.freeze(self, M_0=validate.positive("M_0", self.M_0))
        if self.M_0 < LEAST_M_0:
            raise validate.InputError.of("M_0", f"must be at least {LEAST_M_0:g}, got {validate.show(self.M_0)}")

    def coefficient(self, theta_hat: Value, error: Value) -> Value:
        size = np.sqrt(np.maximum(theta_hat @ theta_hat, self.M_0 * self.M_0))
        return self.sigma * np.minimum(size / self.M_0 - 1, 1.0)

    @property
    def largest(self) -> float:
        """sigma, the largest leakage w, which acts on large estimates."""
        return self.sigma

    @property
    def harmless_within(self) -> float | None:
        """The norm M_0 of the estimate below which there is no leakage."""
        return self.M_0

    def over_sample(self, theta_hat: Value, error: Value, solve: Callable[[Value], Value]) -> Value:
        """w, held for a sample and evaluated at the estimate to which the full sigma would lead.

        A larger leakage leaves a smaller estimate, so w never exceeds its value for the final estimate, and w is zero if the
        final estimate is below M_0.
        """
        return self.coefficient(solve(self.sigma), error)


@dataclass(frozen=True, eq=False)
class EpsilonModification(PullingLeakage, Settings):
    """w = nu |error|, error = epsilon m_s, or e'P b for the Lyapunov laws: the leakage fades with the error, nu > 0.

    nu  the leakage for an error of size one

    Its proof needs a V' that is proportional to |error|: V' <= |error| (d_0 + ... - nu theta_tilde'theta_hat).

    Source: Narendra and Annaswamy (1987), IEEE TAC 32(2); Ioannou and Sun, section 8.4.1.
    """

    nu: float

    one_input_only: ClassVar[bool] = True
    bend: ClassVar[str] = "the zero of the error, where its leakage has a corner,"

    def __post_init__(self) -> None:
        validate.freeze(self, nu=validate.positive("nu", self.nu))

    def coefficient(self, theta_hat: Value, error: Value) -> Value:
        return self.nu * np.abs(error)

    @property
    def largest(self) -> float:
        """The largest w, which is unbounded."""
        return math.inf

    @property
    def per_error(self) -> float | None:
        return self.nu


LEAKAGES = (FixedSigma, SwitchingSigma, EpsilonModification)
"""The modifications that case files can select."""
