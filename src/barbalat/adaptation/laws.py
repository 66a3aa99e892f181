"""Adaptive laws for the linear parametric model z = theta'phi, driven by the estimation error epsilon."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from barbalat import validate
from barbalat.adaptation.projection import project, project_with_gain
from barbalat.problem import ParameterBox
from barbalat.protocols import Value
from barbalat.validate import Array


class Rates(NamedTuple):
    """Time derivatives of what a law integrates."""

    theta_hat: Value  # (n,)
    covariance: Value  # (n, n), or (0, 0) for a law without one


class AdaptiveLaw(Protocol):
    """A law gives the rates of the estimate and of its own memory, the covariance."""

    def initial_covariance(self, n: int) -> Array: ...

    def rates(
        self, theta_hat: Value, covariance: Value, epsilon: Value, phi: Value, m_s_squared: Value, box: ParameterBox | None
    ) -> Rates: ...


@dataclass(frozen=True, kw_only=True)
class Gradient:
    """theta_hat' = proj(Gamma epsilon phi), with a scalar gain Gamma > 0. Source: Ioannou and Fidan, section 3.6."""

    gamma: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "gamma", validate.positive("law.gamma", self.gamma))

    def initial_covariance(self, n: int) -> Array:
        return np.zeros((0, 0))

    def rates(
        self, theta_hat: Value, covariance: Value, epsilon: Value, phi: Value, m_s_squared: Value, box: ParameterBox | None
    ) -> Rates:
        return Rates(project(self.gamma * epsilon * phi, theta_hat, box), covariance)


@dataclass(frozen=True, kw_only=True)
class LeastSquares:
    """Pure least squares: theta_hat' = proj(P epsilon phi), P' = -P phi phi'P / m_s^2, P(0) = covariance0 I: eq. (15)."""

    covariance0: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "covariance0", validate.positive("law.covariance0", self.covariance0))

    def initial_covariance(self, n: int) -> Array:
        return self.covariance0 * np.eye(n)

    def rates(
        self, theta_hat: Value, covariance: Value, epsilon: Value, phi: Value, m_s_squared: Value, box: ParameterBox | None
    ) -> Rates:
        P_phi = covariance @ phi
        theta_hat_dot = project_with_gain(P_phi * epsilon, theta_hat, box, covariance)  # (15)
        covariance_dot = -np.outer(P_phi, P_phi) / m_s_squared  # (15)
        return Rates(theta_hat_dot, covariance_dot)
