"""The reference model (2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat import validate
from barbalat.protocols import Value
from barbalat.settings import Settings
from barbalat.validate import Array, Matrix, freeze


@dataclass(frozen=True, eq=False)
class Model:
    """The reference model as a system of its own, which the loop integrates beside the plant."""

    A_m: Array
    b: Array
    k_0: Array | float
    x0: Array

    def derivative(self, x_m: Value, r: Value) -> Value:
        return self.A_m @ x_m + np.dot(self.b, np.dot(self.k_0, r))  # (2)

    def output(self, x_m: Value) -> Value:
        """What the plant's output is to follow."""
        return x_m

    def remedy(self, gain: float) -> str | None:
        """The k_0 with which it would settle at a command of which it settles at ``gain`` times."""
        return None if gain == 0 or np.ndim(self.k_0) > 0 else f"k_0 = {self.k_0 / gain:.6g}"

    @property
    def matrices(self) -> tuple[Array, Array, Array]:
        """A, B, C with x_m' = A x_m + B r and the output C x_m."""
        n = len(self.b)
        return self.A_m, self.b.reshape(n, -1) @ np.atleast_2d(self.k_0), np.eye(n)


@dataclass(frozen=True, eq=False)
class ReferenceModel(Settings):
    """x_m' = A_m x_m + b k_0 r, x_m(0) = x(0): eq. (2); A_m and b are the plant's.

    k_0  a number; with m inputs a matrix (m, q) for q commands
    """

    k_0: float | Matrix = 1.0

    def __post_init__(self) -> None:
        name = "reference_model.k_0"
        matrix = isinstance(self.k_0, (list, tuple)) or validate.dimensions(self.k_0) > 0
        freeze(self, k_0=validate.array(name, self.k_0, (None, None)) if matrix else validate.number(name, self.k_0))
