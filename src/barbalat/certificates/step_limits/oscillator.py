"""The largest gain and step for a solver, from the frozen, damped oscillation of adaptation and the solver's stability region.

With x frozen, x_tilde' = A_m x_tilde - b theta_tilde'x, theta_tilde' = Gamma (x_tilde'P b) x changes only along q =
theta_tilde'x. This gives x_tilde' = A_m x_tilde - b q, q' = g b'P x_tilde, so the modes depend only on g = Gamma |x|^2. With
several inputs q has an entry for each; for any phi(x), |phi|^2 replaces |x|^2.

If MRAC's law takes Euler steps while the plant moves with its input held, q and e at the samples satisfy

    e_next = e^(A_m T) e - integral_0^T e^(A_m s) ds b q,   q_next = q + T g b'P e,   g = Gamma |x|^2,

which is exact for the plant. The limits of a differential-equation solver are then irrelevant. Source: docs/numerics.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from barbalat.linear.largest import largest, largest_from
from barbalat.problem.state_feedback import Known
from barbalat.solvers import Tableau
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array


def largest_step(simulation: Simulation, modes: Array) -> float:
    """The largest step at which the solver does not amplify stable modes."""
    beyond = 2 * simulation.solver.reach / float(np.abs(modes).max())
    return largest(lambda h: not amplifies(simulation, h, modes), 0.0, beyond)


def amplifies(simulation: Simulation, h: float, modes: Array) -> bool:
    """Whether the method amplifies a mode: |R| exceeds max(1, |e^z|) by enough for growth by a factor of e over the run."""
    z = h * modes
    with np.errstate(divide="ignore"):
        spurious = np.log(np.abs(simulation.solver.amplification(z))) - np.maximum(z.real, 0)
    return bool((spurious * simulation.t_end / h > 1).any())


GAIN_FRACTIONS = np.geomspace(1e-16, 1.0, 600)
"""Fractions of the largest g that are checked in addition to g = 0: a mode of A_m may leave the region before the
oscillation."""


@dataclass(frozen=True, eq=False)
class FrozenErrorSystem:
    """The error system of a problem with frozen x, and so a frozen regressor."""

    known: Known

    @property
    def b(self) -> Array:
        """The matrix b, (n, m)."""
        return np.asarray(self.known.b.reshape(self.known.n, -1))

    @property
    def bPb(self) -> float:
        """b'P b; with several inputs, its largest eigenvalue, which belongs to the fastest direction."""
        return float(np.linalg.eigvalsh(self.b.T @ self.known.P @ self.b)[-1])


@dataclass(frozen=True, eq=False)
class Oscillator(FrozenErrorSystem):
    """The frozen error system of a problem under a solver.

    others   eigenvalues of the other integrated parts, such as the input filter and an actuator, which do not depend on g
    """

    solver: Tableau
    others: Array

    def modes(self, g: Array) -> Array:
        """Eigenvalues for g > 0, (K,) -> (K, n + m); q is scaled by sqrt(g), which balances the matrix."""
        n, m = self.b.shape
        root_g = np.sqrt(g)[:, None, None]
        matrices = np.zeros((len(g), n + m, n + m))
        matrices[:, :n, :n] = self.known.A_m
        matrices[:, :n, n:] = -root_g * self.b
        matrices[:, n:, :n] = root_g * (self.b.T @ self.known.P)
        return np.linalg.eigvals(matrices)

    @property
    def fixed(self) -> Array:
        """The eigenvalues that exist at g = 0: the modes of A_m and of the other parts."""
        return np.concatenate([np.linalg.eigvals(self.known.A_m), self.others])

    def largest_g(self, h: float) -> float:
        """The largest g up to which no mode is amplified at the step h; 0 if A_m or another part is already too fast.

        If the solver's region includes a piece of the imaginary axis, the oscillator's damping is neglected.
        """
        if self._amplified(h * self.fixed):
            return 0.0
        grid = 100 * (self.solver.reach / h) ** 2 / self.bPb * GAIN_FRACTIONS  # the last is beyond every explicit method's region
        first = int(np.argmax(self._amplified(h * self.modes(grid))))
        low = grid[first - 1] if first else 0.0
        found = largest(lambda g: not self._amplified(h * self.modes(np.array([g]))[0]), low, grid[first])
        undamped = (self.solver.imaginary_limit / h) ** 2 / self.bPb
        return min(found, undamped) if undamped > 0 else found

    def largest_step(self, g: float) -> float:
        """The largest step at which no mode is amplified for any frozen gain from 0 to g.

        Found by bisection, because along a ray into the left half plane the registered solvers leave their regions only once
        (tested).
        """
        modes = self.fixed if g == 0 else np.concatenate([self.fixed, self.modes(g * GAIN_FRACTIONS).ravel()])
        beyond = 2 * self.solver.reach / float(np.abs(modes).max())
        step = largest(lambda h: not self._amplified(h * modes), 0.0, beyond)
        limit = self.solver.imaginary_limit
        return min(step, limit / math.sqrt(g * self.bPb)) if limit > 0 and g > 0 else step

    def _amplified(self, z: Array) -> Array:
        """Whether a mode along the last axis grows by more than the rounding error of an eigenvalue."""
        rounding = 10 * z.shape[-1] * np.finfo(float).eps * np.abs(z).max(axis=-1, keepdims=True)
        return np.asarray((self.solver.growth(z) > rounding).any(axis=-1))


TRIAL_RATIO = 1.1
"""Ratio of successive gains or sample times, upwards from a value inside the region; the first exit counts."""
HELD_FRACTIONS = np.geomspace(1e-6, 1.0, 40)
"""Fractions of the largest g at which a sample time is checked."""


@dataclass(frozen=True, eq=False)
class HeldOscillator(FrozenErrorSystem):
    """The frozen error system in discrete time."""

    def largest_g(self, T: float) -> float:
        """The largest g up to which no mode grows at the sample time T [s]."""
        start = (1e-6 / T) ** 2 / self.bPb  # rotates q by 1e-6 in a sample
        return largest_from(lambda g: not self._grows(T, np.array([g])), start, factor=TRIAL_RATIO, least=start)

    def largest_step(self, g: float) -> float:
        """The largest sample time [s] up to which no mode grows for any gain from 0 to g > 0."""
        rate = float(np.abs(np.linalg.eigvals(self.known.A_m)).max()) + math.sqrt(g * self.bPb)
        start = 1e-6 / rate
        return largest_from(lambda T: not self._grows(T, g * HELD_FRACTIONS), start, factor=TRIAL_RATIO, least=start)

    def _grows(self, T: float, g: Array) -> bool:
        """Whether |1 + T mu|^2 - 1 = T (2 Re mu + T |mu|^2) > 0 for an eigenvalue mu of (map - I)/T, computed without
        cancellation."""
        from scipy.linalg import expm

        known, n, b = self.known, self.known.n, self.b
        size, eye = n + b.shape[1], np.eye(n)
        mean = expm(T * np.block([[known.A_m, eye], [0 * eye, 0 * eye]]))[:n, n:] / T  # of e^(A_m s) over a sample
        root_g = np.sqrt(g)[:, None, None]
        moves = np.zeros((len(g), size, size))
        moves[:, :n, :n] = known.A_m @ mean
        moves[:, :n, n:] = -root_g * (mean @ b)
        moves[:, n:, :n] = root_g * (b.T @ known.P)
        mu = np.linalg.eigvals(moves)
        rounding = 10 * size * np.finfo(float).eps * np.abs(mu).max(axis=1, keepdims=True)
        return bool((2 * mu.real + T * np.abs(mu) ** 2 > rounding).any())
