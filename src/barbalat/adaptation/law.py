"""The protocols of adaptive laws for the linear parametric model z = theta'phi. The registry is ``laws``.

Every law implements ``AdaptiveLaw``. Further properties are separate protocols, which a user-defined law may omit:
``SampledLaw``, ``RatedLaw``, ``GainLimitedLaw``, ``GuaranteedLaw``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from barbalat import budget, validate
from barbalat.adaptation.guarantee import Guarantee
from barbalat.adaptation.modifications import Leakage
from barbalat.problem.known_set import EstimateSet, Gain
from barbalat.protocols import Value
from barbalat.settings import Settings
from barbalat.validate import Array, InputError


class Estimation(NamedTuple):
    """The linear parametric model z = theta'phi, (13), at one instant; all of it is measured.

    With m equations, one for each input of a plant, z = phi'theta and epsilon are (m,).
    """

    phi: Value  # (n,) regressor, (n, m)
    m_s_squared: Value  # normalising signal
    epsilon: Value  # estimation error (z - theta_hat'phi)/m_s^2

    @property
    def squared_error(self) -> Value:
        """(epsilon m_s)^2, for each equation."""
        epsilon, m_s_squared = self.epsilon, self.m_s_squared
        return epsilon * epsilon * m_s_squared if self.phi.ndim == 1 else (epsilon @ epsilon) * m_s_squared

    def descent(self, gain: Gain) -> Value:
        """The direction Gamma phi epsilon in which the squared estimation error falls fastest."""
        return gain.scaled(self.epsilon, self.phi) if self.phi.ndim == 1 else gain.times(self.phi @ self.epsilon)


def gram(phi: Value) -> Value:
    """phi phi', (n, n)."""
    return np.outer(phi, phi) if phi.ndim == 1 else phi @ phi.T


class Rates(NamedTuple):
    """Time derivatives of a law's state."""

    theta_hat: Value  # (n,)
    memory: Any  # in the form of ``AdaptiveLaw.initial``


class SampleData(NamedTuple):
    """The parametric model over one sample, taken at its middle; all of it is measured."""

    T: float  # length of the sample [s]
    z: Value
    phi: Value  # (n,)
    m_s_squared: Value


class Moved(NamedTuple):
    """The state of a law one sample later."""

    theta_hat: Value  # (n,)
    memory: Any


@runtime_checkable
class AdaptiveLaw(Protocol):
    """A law gives the rates of the estimate and of its memory. The memory is a NamedTuple of arrays, or () for a law without
    memory."""

    def initial(self, n: int) -> Any:
        """The memory at t = 0 for n parameters; raises InputError if the settings don't fit n."""
        ...

    def rates(self, theta_hat: Value, memory: Any, estimation: Estimation, known_set: EstimateSet | None) -> Rates: ...

    def limit(self, memory: Any) -> Any:
        """The memory as used at every stage of every solver, after resets and bounds."""
        ...


@runtime_checkable
class OutputErrorLaw(Protocol):
    """A law of an output-feedback scheme that is driven by the tracking error itself and needs no parametric model."""

    def require_size(self, n: int) -> None:
        """Raise InputError if the settings don't fit n parameters."""
        ...

    def rate(self, theta_hat: Value, omega: Value, e: Value, sign: float, estimate_set: EstimateSet | None) -> Value:
        """theta_hat'; ``sign`` is that of k_p/k_m."""
        ...


@runtime_checkable
class FreezableLaw(OutputErrorLaw, Protocol):
    """An output-feedback law with known modifications, so that its loop can be analysed with a frozen regressor."""

    @property
    def gamma(self) -> float | Array:
        """Gamma: a number, a diagonal or a matrix."""
        ...

    @property
    def leakage(self) -> Leakage | None: ...

    @property
    def plain(self) -> OutputErrorLaw:
        """The law without its modifications."""
        ...

    @property
    def drifts(self) -> bool:
        """Whether the estimates may drift without bound under a modelling error."""
        ...


@runtime_checkable
class SampledLaw(Protocol):
    """A law with an implicit step over a sample, in which V never grows (see ``adaptation.implicit``)."""

    @property
    def metric(self) -> Gain:
        """Gamma in V = theta_tilde'Gamma^-1 theta_tilde. For a covariance, only the fact that it is a matrix is used."""
        ...

    def sampled_step(self, theta_hat: Value, memory: Any, data: SampleData, known_set: EstimateSet | None) -> Moved:
        """The estimate and the memory at the end of the sample."""
        ...


@runtime_checkable
class RatedLaw(Protocol):
    """A law with a known bound on its rate."""

    @property
    def fastest_rate(self) -> float | None:
        """The largest rate [1/s] at which estimates and memory decay, derived from |phi|^2 < m_s^2; None without a bound."""
        ...


@runtime_checkable
class GainLimitedLaw(Protocol):
    """A law that can compute the gain for a given rate."""

    def gain_of_rate(self, rate: float) -> float | None:
        """The gain, a number, for which ``fastest_rate`` would be ``rate`` [1/s]; None if there is no such number."""
        ...


@runtime_checkable
class GuaranteedLaw(Protocol):
    """A law that declares what a normalised scheme with this law guarantees."""

    def guarantee(self, known_set: EstimateSet | None) -> Guarantee:
        """The guarantee with projection onto ``known_set``, on the plant without modelling error."""
        ...


def require_room(n: int) -> None:
    """Raise InputError if a law's matrix for n parameters exceeds the budget: each of its entries is a state of the loop."""
    budget.require(
        "law", n, lambda parameters: budget.of_kernel(parameters**2), given=f"has a matrix for "
        f"{validate.counted(n, 'parameter')}, which",
        fits=lambda most: f"at most {validate.counted(most, 'parameter')}", what=f"a law with a matrix for "
        f"{validate.counted(n, 'parameter')}",
    )  # fmt: skip


def require_law(law: object) -> None:
    """Raise InputError for an object that is not a law."""
    if not isinstance(law, AdaptiveLaw) or isinstance(law, type):
        raise InputError(
            f"law must be a law for the parametric model (Gradient, LeastSquares, ... of adaptation.laws, or a class with "
            f"initial, rates and limit), got {validate.show(law)}"
        )


@dataclass(frozen=True, kw_only=True)
class Normalization(Settings):
    """m_s^2 = 1 + phi'phi + alpha_0 n_d, n_d' = -delta_0 n_d + u^2, n_d(0) = 0.

    alpha_0  weight of the dynamic part; 0 is sufficient without modelling error
    delta_0  its forgetting rate [1/s], > 0: Delta(s) must be analytic in Re s >= -delta_0/2
    """

    alpha_0: float = 0.0
    delta_0: float = 0.1

    def __post_init__(self) -> None:
        validate.freeze(self, alpha_0=validate.not_negative("normalization.alpha_0", self.alpha_0))
        validate.freeze(self, delta_0=validate.positive("normalization.delta_0", self.delta_0))

    def m_s_squared(self, phi: Value, n_d: Value) -> Value:
        """Return m_s^2, which is at least 1 even if a bit flip has hit the memory of n_d, so divisions in flight stay finite."""
        return np.maximum(1 + phi @ phi + self.alpha_0 * n_d, 1)  # (16)

    def n_d_dot(self, n_d: Value, u: Value) -> Value:
        return self.driven(n_d, u * u)

    def driven(self, n_d: Value, squared: Value) -> Value:
        """n_d' for u^2, or for |u|^2 for several inputs."""
        return -self.delta_0 * n_d + squared  # (16)
