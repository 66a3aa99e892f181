"""Projection of an adaptive law onto the known set: the estimate never leaves it, and the Lyapunov function still decreases.

Every projection subtracts Gamma g lambda from the rate with the outward normal g of a face or sphere and lambda >= 0. Since
theta_tilde'Gamma^-1 Gamma g = (theta_hat - theta)'g >= 0 for every theta in a convex set, V = theta_tilde'Gamma^-1 theta_tilde
never grows by it.

Source: Ioannou and Fidan, Adaptive Control Tutorial, section 3.10; Ioannou and Sun, Robust Adaptive Control, section 4.4.
"""

from __future__ import annotations

import numpy as np

from barbalat.adaptation.gain import is_matrix, times
from barbalat.known_set import EstimateSet, ParameterBall, ParameterBox, ParameterProduct
from barbalat.protocols import Value

ON_THE_SPHERE = 2.0**-46
"""An estimate this near to the sphere counts as on it: a few dozen roundings, relative to |center| + radius."""

INSIDE_THE_SPHERE = 2.0**-50
"""How far inside the sphere the limit puts an estimate: its roundings then can't bring it out."""


def project(rate: Value, theta_hat: Value, known_set: EstimateSet | None, gain: Value = 1.0) -> Value:
    """proj(.) of (4), (7) and (15).

    rate, theta_hat  (n,); ``None`` for the set means no projection
    gain             that of the law: a number, a diagonal (n,) or a matrix (n, n), such as a covariance P(t)
    """
    if known_set is None:
        return rate
    if isinstance(known_set, ParameterProduct):
        return _one_by_one(rate, theta_hat, known_set, gain)
    if isinstance(known_set, ParameterBall):
        return _along_the_sphere(rate, theta_hat, known_set, gain)
    if is_matrix(gain):
        return _face_by_face(rate, theta_hat, known_set, gain)
    return _componentwise(rate, theta_hat, known_set)


def _componentwise(rate: Value, theta_hat: Value, box: ParameterBox) -> Value:
    """For a diagonal gain: a component on a face does not move outward."""
    highest = np.where(theta_hat >= box.upper, 0.0, np.inf)
    lowest = np.where(theta_hat <= box.lower, 0.0, -np.inf)
    return np.maximum(np.minimum(rate, highest), lowest)


def _one_by_one(rate: Value, theta_hat: Value, product: ParameterProduct, gain: Value) -> Value:
    """Sphere and intervals. A scalar or diagonal gain does not couple them; with a matrix they follow one another like faces."""
    first = rate.shape[0] - product.gains.size
    if is_matrix(gain):
        along = rate if product.theta is None else _along_the_sphere(rate, theta_hat, product.theta, gain)
        return _face_by_face(along, theta_hat, product.gains, gain, first)
    own = gain if len(getattr(gain, "shape", ())) == 0 else gain[:first]
    theta = project(rate[:first], theta_hat[:first], product.theta, own)
    return np.concatenate([theta, _componentwise(rate[first:], theta_hat[first:], product.gains)])


def _face_by_face(rate: Value, theta_hat: Value, box: ParameterBox, gain: Value, first: int = 0) -> Value:
    """For a gain matrix: rate - Gamma g max(0, g'rate)/(g'Gamma g) on a face with normal g.

    On one face nothing is left that points outward, and with two parameters what is left in a corner is cut off by the limit
    without harm. In a corner of three and more faces the corrections follow one another once. What may still point outward
    is cut off by the limit at every stage, for which the decrease of V is not claimed. (The exact projection there is a
    quadratic programme: passes over the faces only converge to it, and its active faces are found by trying all 2^n sets.
    A ball has no corners: for it the projection is exact.)
    """
    for i, (low, high) in enumerate(zip(box.lower, box.upper, strict=True), start=first):
        highest = np.where(theta_hat[i] >= high, 0.0, np.inf)
        lowest = np.where(theta_hat[i] <= low, 0.0, -np.inf)
        outward = rate[i] - np.maximum(np.minimum(rate[i], highest), lowest)
        rate = rate - gain[:, i] * (outward / gain[i, i])
    return rate


def _along_the_sphere(rate: Value, theta_hat: Value, ball: ParameterBall, gain: Value) -> Value:
    """rate - Gamma g g'rate/(g'Gamma g), g = theta_hat - center, on the sphere where g'rate > 0.

    The ball may be of the first components only; g is then zero in the others.
    """
    g = theta_hat[: ball.size] - ball.center
    if others := rate.shape[0] - ball.size:
        g = np.concatenate([g, np.zeros(others)])
    reach = _reach(ball, ON_THE_SPHERE)
    on_it = g @ g >= reach * reach
    gain_g = times(gain, g)
    outward = np.maximum(g @ rate, 0.0) / np.where(on_it, g @ gain_g, 1.0)
    return rate - gain_g * np.where(on_it, outward, 0.0)


def limit(theta_hat: Value, known_set: EstimateSet | None) -> Value:
    """The stage value of the estimate, limited to the set (a limited integrator); ``None`` means no limit.

    To the nearest point of the set, up to the last few bits for a ball.
    """
    if known_set is None:
        return theta_hat
    if isinstance(known_set, ParameterBox):
        return np.clip(theta_hat, known_set.lower, known_set.upper)
    if isinstance(known_set, ParameterProduct):
        theta, gains = known_set.parts(theta_hat)
        return np.concatenate([limit(theta, known_set.theta), limit(gains, known_set.gains)])
    g = theta_hat - known_set.center
    reach = _reach(known_set, INSIDE_THE_SPHERE)
    outside = g @ g > reach * reach
    return np.where(outside, known_set.center + g * (reach / np.sqrt(np.where(outside, g @ g, 1.0))), theta_hat)


def _reach(ball: ParameterBall, slack: float) -> Value:
    """The radius less ``slack``, relative to the size of the numbers that are subtracted on the way."""
    return ball.radius - slack * (ball.radius + np.sqrt(ball.center @ ball.center))
