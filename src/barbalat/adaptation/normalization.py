"""The normalising signal m_s^2: eq. (16)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat import validate
from barbalat.protocols import Value
from barbalat.settings import Settings


@dataclass(frozen=True, kw_only=True)
class Normalization(Settings):
    """m_s^2 = 1 + phi'phi + alpha_0 n_d, n_d' = -delta_0 n_d + u^2, n_d(0) = 0.

    alpha_0  weight of the dynamic part; 0 is enough without modelling error
    delta_0  its forgetting rate [1/s], > 0: Delta(s) must be analytic in Re s >= -delta_0/2
    """

    alpha_0: float = 0.0
    delta_0: float = 0.1

    def __post_init__(self) -> None:
        validate.freeze(self, alpha_0=validate.not_negative("normalization.alpha_0", self.alpha_0))
        validate.freeze(self, delta_0=validate.positive("normalization.delta_0", self.delta_0))

    def m_s_squared(self, phi: Value, n_d: Value) -> Value:
        """At least 1, also where n_d comes from a memory that was hit: what is divided by it in flight stays finite."""
        return np.maximum(1 + phi @ phi + self.alpha_0 * n_d, 1)  # (16)

    def n_d_dot(self, n_d: Value, u: Value) -> Value:
        return self.driven(n_d, u * u)

    def driven(self, n_d: Value, squared: Value) -> Value:
        """n_d' for u^2, or |u|^2 of several inputs."""
        return -self.delta_0 * n_d + squared  # (16)
