"""The dead zone: what is smaller than the known bound of the modelling error teaches nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from barbalat import validate
from barbalat.protocols import Value
from barbalat.settings import Settings


@dataclass(frozen=True, eq=False)
class DeadZone(Settings):
    """Continuous dead zone of half-width g_0 > 0: an error of size E counts as E - g_0, and as nothing inside.

    g_0  half-width of the zone: a bound of the modelling error

    For the laws on the parametric model E = |epsilon m_s|, so that epsilon becomes epsilon + g with g = -g_0/m_s for
    epsilon m_s > g_0, g_0/m_s for epsilon m_s < -g_0, -epsilon between. With |eta|/m_s <= g_0 for the modelling error eta,
    V = theta_tilde'Gamma^-1 theta_tilde does not grow. The price: the error converges to the zone, not to zero.

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
        """max(0, E - g_0)/E from E^2: in [0, 1), the share of the error that counts."""
        return 1 - self.g_0 / np.sqrt(np.maximum(squared_error, self.g_0 * self.g_0))

    def share(self, squared_error: Value, speed: Value) -> Value:
        """a = 1 - g_0/|E_next| of the error E_next = E/(1 + a speed) that an implicit step leaves: linear in a, so solved."""
        E = np.sqrt(np.maximum(squared_error, self.g_0 * self.g_0))
        return (E - self.g_0) / (E + speed * self.g_0)


def accept(dead_zone: DeadZone | None) -> None:
    """InputError for what is no dead zone."""
    if dead_zone is not None:
        validate.instance("dead_zone", dead_zone, DeadZone)
