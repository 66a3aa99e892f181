"""The largest gain and step that a solver bears: the frozen, damped oscillator of adaptation against its region of stability.

With x frozen, x_tilde' = A_m x_tilde - b theta_tilde'x, theta_tilde' = Gamma (x_tilde'P b) x moves along q = theta_tilde'x only:
x_tilde' = A_m x_tilde - b q, q' = g b'P x_tilde, so that its modes depend on g = Gamma |x|^2 alone. With several inputs q has an
entry for each, with any phi(x) its square takes the place of |x|^2. Source: docs/numerics.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from barbalat.linear.largest import largest
from barbalat.problem.state_feedback import Known
from barbalat.solvers import Tableau
from barbalat.validate import Array

GAIN_FRACTIONS = np.geomspace(1e-16, 1.0, 600)
"""Fractions of the largest g that are looked at beside g = 0: a mode of A_m may leave the region before the oscillation does."""


@dataclass(frozen=True, eq=False)
class Oscillator:
    """The frozen error system of a problem under a solver.

    beside   eigenvalues of what else is integrated and does not depend on g: the input filter, an actuator
    """

    known: Known
    solver: Tableau
    beside: Array

    @property
    def bPb(self) -> float:
        """b'P b; with several inputs its largest eigenvalue, which is the fastest direction's."""
        b = self._b
        return float(np.linalg.eigvalsh(b.T @ self.known.P @ b)[-1])

    @property
    def _b(self) -> Array:
        """(n, m)."""
        return np.asarray(self.known.b.reshape(self.known.n, -1))

    def modes(self, g: Array) -> Array:
        """Eigenvalues for g > 0, (K,) -> (K, n + m); q is scaled by sqrt(g), which keeps the matrix of one size."""
        n, m = self._b.shape
        root_g = np.sqrt(g)[:, None, None]
        matrices = np.zeros((len(g), n + m, n + m))
        matrices[:, :n, :n] = self.known.A_m
        matrices[:, :n, n:] = -root_g * self._b
        matrices[:, n:, :n] = root_g * (self._b.T @ self.known.P)
        return np.linalg.eigvals(matrices)

    @property
    def fixed(self) -> Array:
        """What is there at g = 0 already: A_m's own modes, and those beside it."""
        return np.concatenate([np.linalg.eigvals(self.known.A_m), self.beside])

    def largest_g(self, h: float) -> float:
        """The largest g up to which no mode is amplified at the step h; 0 where A_m or what is beside it is too fast already.

        On the imaginary axis, where the solver has a piece of it, the oscillator's damping is not counted on.
        """
        if self._amplified(h * self.fixed):
            return 0.0
        grid = 100 * (self.solver.reach / h) ** 2 / self.bPb * GAIN_FRACTIONS  # the last is beyond every explicit method's reach
        first = int(np.argmax(self._amplified(h * self.modes(grid))))
        low = grid[first - 1] if first else 0.0
        found = largest(lambda g: not self._amplified(h * self.modes(np.array([g]))[0]), low, grid[first])
        undamped = (self.solver.imaginary_limit / h) ** 2 / self.bPb
        return min(found, undamped) if undamped > 0 else found

    def largest_step(self, g: float) -> float:
        """The largest step at which no mode is amplified for any frozen gain from 0 to g.

        By bisection: along a ray into the left half plane the registered solvers leave their regions once (tested).
        """
        modes = self.fixed if g == 0 else np.concatenate([self.fixed, self.modes(g * GAIN_FRACTIONS).ravel()])
        beyond = 2 * self.solver.reach / float(np.abs(modes).max())
        step = largest(lambda h: not self._amplified(h * modes), 0.0, beyond)
        limit = self.solver.imaginary_limit
        return min(step, limit / math.sqrt(g * self.bPb)) if limit > 0 and g > 0 else step

    def _amplified(self, z: Array) -> Array:
        """Whether a mode along the last axis grows, by more than an eigenvalue's rounding."""
        rounding = 10 * z.shape[-1] * np.finfo(float).eps * np.abs(z).max(axis=-1, keepdims=True)
        return np.asarray((self.solver.growth(z) > rounding).any(axis=-1))
