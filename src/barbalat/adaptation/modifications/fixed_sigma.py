"""Fixed sigma-modification."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from barbalat import validate
from barbalat.protocols import Value
from barbalat.settings import Settings


@dataclass(frozen=True, eq=False)
class FixedSigma(Settings):
    """w = sigma > 0: the estimates stay bounded under bounded modelling errors without a known set.

    sigma  the leakage

    The price: V' = ... - sigma theta_tilde'theta_hat may be positive, so also without modelling error the tracking error does
    not converge to zero, only to a set of the order of sqrt(sigma) |theta|.

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
        """The largest leakage w: sigma, always."""
        return self.sigma

    @property
    def harmless_within(self) -> float | None:
        """It takes convergence to zero for every theta."""
        return None

    def over_sample(self, theta_hat: Value, error: Value, solve: Callable[[Value], Value]) -> Value:
        """w for a sample, held: that before the estimates move."""
        return self.coefficient(theta_hat, error)
