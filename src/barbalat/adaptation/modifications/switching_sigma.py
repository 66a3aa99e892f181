"""Switching sigma-modification."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from barbalat import validate
from barbalat.protocols import Value
from barbalat.settings import Settings


@dataclass(frozen=True, eq=False)
class SwitchingSigma(Settings):
    """w = 0 for |theta_hat| <= M_0, sigma (|theta_hat|/M_0 - 1) up to 2 M_0, sigma beyond; Euclidean norm.

    sigma  the leakage far out
    M_0    where it begins: a bound of |theta|

    Where |theta| <= M_0, w theta_tilde'theta_hat >= w |theta_hat| (|theta_hat| - M_0) >= 0: what holds without modelling error
    holds with it as well, for every law. M_0 must be a bound of |theta|.

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

    def coefficient(self, theta_hat: Value, error: Value) -> Value:
        size = np.sqrt(np.maximum(theta_hat @ theta_hat, self.M_0 * self.M_0))
        return self.sigma * np.minimum(size / self.M_0 - 1, 1.0)

    @property
    def largest(self) -> float:
        """The largest leakage w: sigma, once the estimate is large."""
        return self.sigma

    @property
    def harmless_within(self) -> float | None:
        """The norm M_0 of the estimate below which nothing leaks."""
        return self.M_0

    def over_sample(self, theta_hat: Value, error: Value, solve: Callable[[Value], Value]) -> Value:
        """w for a sample, held: evaluated where the full sigma would lead.

        A larger leakage leaves a smaller estimate, so that w never exceeds what it is at the end, and is zero where the
        estimate ends below M_0.
        """
        return self.coefficient(solve(self.sigma), error)
