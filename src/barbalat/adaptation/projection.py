"""Projection of an adaptive law onto the known box: the estimate never leaves it, and the Lyapunov function still decreases.

Source: Ioannou and Fidan, Adaptive Control Tutorial, section 3.10 (gradient projection).
"""

from __future__ import annotations

import numpy as np

from barbalat.problem import ParameterBox
from barbalat.protocols import Value


def project(rate: Value, theta_hat: Value, box: ParameterBox | None) -> Value:
    """proj(.) of (4) and (7) for a diagonal gain: a component on a face does not move outward.

    rate, theta_hat  (n,); ``None`` for the box means no projection.
    """
    if box is None:
        return rate
    highest = np.where(theta_hat >= box.upper, 0.0, np.inf)
    lowest = np.where(theta_hat <= box.lower, 0.0, -np.inf)
    return np.maximum(np.minimum(rate, highest), lowest)


def project_with_gain(rate: Value, theta_hat: Value, box: ParameterBox | None, gain: Value) -> Value:
    """proj(.) of (15) for the gain matrix ``gain`` = P(t), (n, n): rate - P g max(0, g'rate)/(g'P g) on a face with normal g.

    Every correction is -P g times something that is not negative, and theta_tilde'P^-1 P g = theta_tilde'g >= 0 for an
    outward normal g, so V = theta_tilde'P^-1 theta_tilde never grows by it. On one face, and for a diagonal gain, nothing is
    left that points outward. In a corner of several faces the corrections follow one another once; what may still point
    outward is cut off by the limit at every stage, for which that inequality is not claimed.
    """
    if box is None:
        return rate
    for i in range(len(box.lower)):
        highest = np.where(theta_hat[i] >= box.upper[i], 0.0, np.inf)
        lowest = np.where(theta_hat[i] <= box.lower[i], 0.0, -np.inf)
        outward = rate[i] - np.maximum(np.minimum(rate[i], highest), lowest)
        rate = rate - gain[:, i] * (outward / gain[i, i])
    return rate


def limit(theta_hat: Value, box: ParameterBox | None) -> Value:
    """The stage value of the estimate, limited to the box (a limited integrator); ``None`` means no limit."""
    return theta_hat if box is None else np.clip(theta_hat, box.lower, box.upper)
