"""Adaptive laws over one sample, such that the estimate's Lyapunov function never grows: docs/sampled.md has the proofs.

Each solves its law for the end of the sample with regressor and normalising signal taken in the middle, in closed form.
"""

from __future__ import annotations

import numpy as np

from barbalat.adaptation.laws import AdaptiveLaw, Gradient, LeastSquares, Rates
from barbalat.adaptation.projection import limit
from barbalat.problem import ParameterBox
from barbalat.protocols import Value
from barbalat.validate import InputError

SWEEPS = 3
"""Passes over the faces of the box for a matrix gain; what is left outside after them is cut off."""


def require_implicit(law: AdaptiveLaw) -> None:
    """InputError for a law for which no decreasing step is known."""
    if not isinstance(law, (Gradient, LeastSquares)):
        raise InputError(f"discretization = 'midpoint' is proven for the gradient and the pure least-squares law, not for {law}")


def step(
    law: AdaptiveLaw,
    T: float,
    theta_hat: Value,
    covariance: Value,
    z: Value,
    phi: Value,
    m_s_squared: Value,
    box: ParameterBox | None,
) -> Rates:
    """The estimate and the covariance one sample of length T [s] later (not their rates)."""
    innovation = z - theta_hat @ phi
    if isinstance(law, Gradient):
        gain = law.gamma * phi
        moved = theta_hat + T * gain * innovation / (m_s_squared + T / 2 * (phi @ gain))  # implicit midpoint
        return Rates(limit(moved, box), covariance)
    gain = covariance @ phi
    scale = m_s_squared + T * (phi @ gain)
    following = covariance - T / scale * np.outer(gain, gain)  # P^-1 grows by T phi phi'/m_s^2, exactly
    return Rates(_into(theta_hat + T / scale * gain * innovation, box, following), following)


def _into(theta_hat: Value, box: ParameterBox | None, covariance: Value) -> Value:
    """Towards the box by projections onto its half spaces, each orthogonal in the metric P^-1, which takes no V up."""
    if box is None:
        return theta_hat
    for _ in range(SWEEPS if len(box.lower) > 1 else 1):
        for i in range(len(box.lower)):
            excess = theta_hat[i] - np.clip(theta_hat[i], box.lower[i], box.upper[i])
            theta_hat = theta_hat - covariance[:, i] * (excess / covariance[i, i])
    return limit(theta_hat, box)
