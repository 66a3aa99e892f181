"""Adaptive laws over one sample, such that the estimate's Lyapunov function never grows: docs/sampled.md has the proofs.

Each is solved for the end of the sample, in closed form, with regressor and normalising signal taken in the sample's middle.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from barbalat.adaptation import gain
from barbalat.adaptation.laws import AdaptiveLaw, Gradient, Rates
from barbalat.adaptation.laws.bounded_covariance import LeastSquaresBounded
from barbalat.adaptation.laws.bounded_gain import LeastSquaresBoundedGain
from barbalat.adaptation.laws.covariance import Memory
from barbalat.adaptation.laws.forgetting import LeastSquaresForgetting
from barbalat.adaptation.laws.integral_cost import IntegralCost
from barbalat.adaptation.laws.integral_cost import Memory as Data
from barbalat.adaptation.modifications.dead_zone import DeadZone
from barbalat.adaptation.modifications.leakage import Leakage
from barbalat.adaptation.modifications.switching_sigma import SwitchingSigma
from barbalat.adaptation.projection import limit
from barbalat.problem.known_set import EstimateSet, KnownSet, ParameterBall, ParameterBox, ParameterProduct
from barbalat.protocols import Value
from barbalat.validate import InputError

TINY = 1e-150
"""A rate of forgetting [1/s] that stands for none where it is divided by."""

SWEEPS = 3
"""Passes over the faces of the box for a matrix gain; what is left outside after them is cut off."""


def require_implicit(law: AdaptiveLaw, known_set: KnownSet | None) -> None:
    """InputError for a law and a set for which no decreasing step is known."""
    require_projectable(law.gamma if isinstance(law, (Gradient, IntegralCost)) else np.eye(1), known_set)


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
    settings: Any = law
    if isinstance(law, Gradient):
        theta_hat, _ = _correct(law, law.gamma, T, theta_hat, z, phi, m_s_squared)
        return Rates(into(theta_hat, known_set, law.gamma), memory)
    if isinstance(law, IntegralCost):
        kept, weight = forgotten(law.forgetting, T)
        R = kept * memory.R + weight * np.outer(phi, phi) / m_s_squared
        Q = kept * memory.Q + weight * z * phi / m_s_squared
        start = theta_hat
        theta_hat = with_leakage(law.leakage, start, 0.0, lambda w: at_rest(law.gamma, start, T, w, R, Q)[1])
        return Rates(into(theta_hat, known_set, law.gamma), Data(R, Q))
    weight = forgotten(settings.forgetting, T)[1] if hasattr(law, "forgetting") else T
    P = _forget(law, T, memory.covariance)
    theta_next, share = _correct(settings, P, weight, theta_hat, z, phi, m_s_squared)
    P_phi = P @ phi
    taken = weight * share
    P = P - taken / (m_s_squared + taken * (phi @ P_phi)) * np.outer(P_phi, P_phi)  # P^-1 grows by taken phi phi'/m_s^2
    if isinstance(law, LeastSquaresBounded):
        grown = np.sum(P * P) > law.covariance_bound * law.covariance_bound
        at_bound, _ = _correct(settings, memory.covariance, T, theta_hat, z, phi, m_s_squared)
        theta_next, P = np.where(grown, at_bound, theta_next), np.where(grown, memory.covariance, P)
    return Rates(into(theta_next, known_set, P), law.limit(Memory(P)))


def forgotten(beta: Value, T: float) -> tuple[Value, Value]:
    """What is kept after T, and the weight of what came in meanwhile: exp(-beta T) and its integral over [0, T]; beta >= 0."""
    half = np.tanh(np.maximum(beta, TINY) * T / 2)  # 1 - exp(-a) = 2 tanh(a/2)/(1 + tanh(a/2)), without cancellation
    return np.exp(-beta * T), 2 * half / (1 + half) / np.maximum(beta, TINY)


def _forget(law: AdaptiveLaw, T: float, P: Value) -> Value:
    """The covariance before the sample's data: P' = beta P over T, exactly."""
    if isinstance(law, (LeastSquaresForgetting, LeastSquaresBounded)):
        return P * np.exp(law.forgetting * T)
    if isinstance(law, LeastSquaresBoundedGain):
        full = np.sqrt(np.sum(P * P)) / law.covariance_bound
        return P / (full + (1 - full) * np.exp(-law.forgetting * T))  # |P|_F follows the logistic equation
    return P


def _correct(law: Any, gamma: Value, T: Value, theta_hat: Value, z: Value, phi: Value, m_s_squared: Value) -> tuple[Value, Value]:
    """theta_next with Gamma^-1 (theta_next - theta_hat) = T (a epsilon_next phi - w theta_next), and the dead zone's share a."""

    def solve(w: Value) -> tuple[Value, Value]:
        gain_w, rest = at_rest(gamma, theta_hat, T, w)
        gain_phi = gain.times(gain_w, phi)
        innovation = z - rest @ phi
        speed = T * (phi @ gain_phi) / m_s_squared
        a = _share(law.dead_zone, innovation * innovation / m_s_squared, speed)
        return rest + gain_phi * (T * a * innovation / (m_s_squared * (1 + a * speed))), a

    error = (z - theta_hat @ phi) / np.sqrt(m_s_squared)
    w = leakage_weight(law.leakage, theta_hat, error, lambda w: solve(w)[0])
    return solve(w)


def _share(dead_zone: DeadZone | None, squared_error: Value, speed: Value) -> Value:
    """a = 1 - g_0/|E_next| of the error E_next = E/(1 + a speed) that the step leaves: linear in a, so solved."""
    if dead_zone is None:
        return 1.0
    E = np.sqrt(np.maximum(squared_error, dead_zone.g_0 * dead_zone.g_0))
    return (E - dead_zone.g_0) / (E + speed * dead_zone.g_0)


def leakage_weight(leakage: Leakage | None, theta_hat: Value, error: Value, solve: Callable[[Value], Value]) -> Value:
    """w for this sample, held; ``error`` is that before the estimates move, ``solve(w)`` the estimate at the end.

    The switching one is evaluated where the full sigma would lead: a larger leakage leaves a smaller estimate, so that w never
    exceeds what it is at the end, and is zero where the estimate ends below M_0.
    """
    if leakage is None:
        return 0.0
    if isinstance(leakage, SwitchingSigma):
        return leakage.coefficient(solve(leakage.sigma), error)
    return leakage.coefficient(theta_hat, error)


def with_leakage(leakage: Leakage | None, theta_hat: Value, error: Value, solve: Callable[[Value], Value]) -> Value:
    """The estimate at the end of the sample."""
    return solve(leakage_weight(leakage, theta_hat, error, solve))


def at_rest(
    gamma: Value, theta_hat: Value, T: Value, w: Value, R: Value | None = None, Q: Value | None = None
) -> tuple[Value, Value]:
    """G = (Gamma^-1 + T (w I + R))^-1 and G (Gamma^-1 theta_hat + T Q).

    The second is where leakage and memory alone lead within T; what else moves the estimates does it with the gain G.
    """
    if R is None and not gain.is_matrix(gamma):
        shrink = 1 / (1 + T * w * gamma)
        return gamma * shrink, theta_hat * shrink
    if R is None and isinstance(w, float) and w == 0:
        return gamma, theta_hat
    p = theta_hat.shape[0]
    Gamma = gamma if gain.is_matrix(gamma) else gain.as_matrix(gamma, p)
    if R is None:
        system, start = np.eye(p) + T * w * Gamma, theta_hat
    else:
        system, start = np.eye(p) + T * (Gamma @ (w * np.eye(p) + R)), theta_hat + T * (Gamma @ Q)
    solved = np.linalg.solve(system, np.concatenate([Gamma, start.reshape(p, 1)], axis=1))
    return solved[:, :p], solved[:, p]


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
