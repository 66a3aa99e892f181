"""Adaptive laws over one sample, such that the estimate's Lyapunov function never grows: docs/sampled.md has the proofs.

Each solves its law for the end of the sample with regressor and normalising signal taken in the middle, in closed form.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from barbalat.adaptation import gain
from barbalat.adaptation.covariance import Memory
from barbalat.adaptation.laws import AdaptiveLaw, Gradient, LeastSquares, Rates
from barbalat.adaptation.projection import limit
from barbalat.known_set import EstimateSet, KnownSet, ParameterBall, ParameterBox, ParameterProduct
from barbalat.protocols import Value
from barbalat.validate import InputError

SWEEPS = 3
"""Passes over the faces of the box for a matrix gain; what is left outside after them is cut off."""


def require_implicit(law: AdaptiveLaw, known_set: KnownSet | None) -> None:
    """InputError for a law for which no decreasing step is known."""
    if not isinstance(law, (Gradient, LeastSquares)):
        raise InputError(
            f"discretization = 'midpoint' is proven for the gradient and the pure least-squares law, not for {type(law).__name__}"
        )
    if law.leakage is not None or law.dead_zone is not None:
        raise InputError("discretization = 'midpoint' is proven for laws without leakage and dead zone; 'euler' takes all")
    require_projectable(law.gamma if isinstance(law, Gradient) else np.eye(1), known_set)


def require_projectable(gamma: Any, known_set: EstimateSet | None) -> None:
    """InputError for a ball and a gain other than a number: the nearest point in that metric has no closed form."""
    if isinstance(known_set, ParameterProduct) and np.ndim(gamma) == 2:
        raise InputError(
            "discretization = 'midpoint' takes a gain matrix and an unknown input gain together only with a box: give "
            "uncertainty.lower and .upper, a diagonal gain, or discretization = 'euler'"
        )
    ball = known_set.theta if isinstance(known_set, ParameterProduct) else known_set
    if isinstance(ball, ParameterBall) and np.ndim(gamma) > 0:
        raise InputError(
            "discretization = 'midpoint' projects onto a ball for a scalar gain only (not for a matrix or least squares); "
            "give a box, projection = false, or discretization = 'euler'"
        )


def step(
    law: AdaptiveLaw,
    T: float,
    theta_hat: Value,
    memory: Any,
    z: Value,
    phi: Value,
    m_s_squared: Value,
    known_set: KnownSet | None,
) -> Rates:
    """The estimate and the law's memory one sample of length T [s] later (not their rates)."""
    innovation = z - theta_hat @ phi
    if isinstance(law, Gradient):
        gamma_phi = gain.times(law.gamma, phi)
        moved = theta_hat + T * gamma_phi * innovation / (m_s_squared + T / 2 * (phi @ gamma_phi))  # implicit midpoint
        return Rates(into(moved, known_set, law.gamma), memory)
    P = memory.covariance
    P_phi = P @ phi
    scale = m_s_squared + T * (phi @ P_phi)
    following = P - T / scale * np.outer(P_phi, P_phi)  # P^-1 grows by T phi phi'/m_s^2, exactly
    return Rates(into(theta_hat + T / scale * P_phi * innovation, known_set, following), Memory(following))


def into(theta_hat: Value, known_set: EstimateSet | None, gamma: Value) -> Value:
    """The estimate brought into the set without taking V = theta_tilde'Gamma^-1 theta_tilde up.

    For a matrix and a box by projections onto its half spaces, each orthogonal in the metric Gamma^-1.
    """
    if not gain.is_matrix(gamma) or not isinstance(known_set, ParameterBox):
        return limit(theta_hat, known_set)
    for _ in range(SWEEPS if known_set.size > 1 else 1):
        for i in range(known_set.size):
            excess = theta_hat[i] - np.clip(theta_hat[i], known_set.lower[i], known_set.upper[i])
            theta_hat = theta_hat - gamma[:, i] * (excess / gamma[i, i])
    return limit(theta_hat, known_set)
