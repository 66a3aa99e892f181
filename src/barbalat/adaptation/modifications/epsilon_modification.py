"""Epsilon-modification (e1-modification)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from barbalat import validate
from barbalat.protocols import Value
from barbalat.settings import Settings


@dataclass(frozen=True, eq=False)
class EpsilonModification(Settings):
    """w = nu |error|, error = epsilon m_s, or e'P b for the Lyapunov laws: the leakage fades with the error, nu > 0.

    nu  the leakage for an error of one

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
        """The largest w: nothing bounds it."""
        return math.inf

    @property
    def per_error(self) -> float | None:
        """The leakage nu for each unit of the error."""
        return self.nu

    @property
    def harmless_within(self) -> float | None:
        """It takes convergence to zero for every theta."""
        return None

    def over_sample(self, theta_hat: Value, error: Value, solve: Callable[[Value], Value]) -> Value:
        """w for a sample, held: that before the estimates move."""
        return self.coefficient(theta_hat, error)
