"""Vertical and lateral gusts: Dryden's spectrum, drawn by a seed, the same for every controller."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from barbalat.linear.zero_order_hold import HeldSystem
from barbalat.validate import Array

TURBULENCE_LENGTH = 1750.0
"""L [ft], above 2000 ft: MIL-F-8785C, section 3.7.2."""
SEED = 2013


def gusts_met(deviation: float, speed: float, T: float, samples: int, seed: int = SEED) -> Array:
    """(samples,) velocities T [s] apart with this standard deviation, in its unit, as met at so many ft/s.

    White noise of unit intensity through deviation sqrt(tau) (1 + sqrt(3) tau s)/(1 + tau s)^2 with tau = SCALE/speed: exact at
    the samples, and stationary from the first one on.
    """
    return deviation * _of_one(speed, T, samples, seed)


@lru_cache(maxsize=8)  # a draw's flights, of all controllers and through all failures, meet the same
def _of_one(speed: float, T: float, samples: int, seed: int) -> Array:
    """Of standard deviation 1."""
    tau = TURBULENCE_LENGTH / speed
    A = np.array([[0.0, 1.0], [-1 / tau**2, -2 / tau]])
    C = np.sqrt(tau) * np.array([1 / tau**2, np.sqrt(3) / tau])
    # Van Loan (1978): exp([[-A, b b'], [0, A']] T) has the covariance of what the noise adds in a sample
    whole = np.zeros((4, 4))
    whole[:2, :2], whole[2:, 2:], whole[1, 3] = -A, A.T, 1.0
    found = HeldSystem.of(whole, np.zeros(4), T).Phi
    Phi = found[2:, 2:].T
    added = Phi @ found[:2, 2:]
    random, root = np.random.default_rng(seed), np.linalg.cholesky(added)
    x = np.linalg.cholesky(solve_discrete_lyapunov(Phi, added)) @ random.standard_normal(2)
    gusts = np.empty(samples)
    for k in range(samples):
        gusts[k] = C @ x
        x = Phi @ x + root @ random.standard_normal(2)
    gusts.flags.writeable = False
    return gusts
