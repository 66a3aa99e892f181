"""Section V's robust MRAC from the paper's equations in plain NumPy, with the corrected sign of (14), for integration with SciPy.

There is no projection, but the modelling error -mu s/(T s + 1) and a matched disturbance. Nothing from the package is used.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

A_M, B, K_0, THETA = np.array([[0.0, 1.0], [-0.3, -1.0]]), np.array([0.0, 1.0]), 4.0, np.array([4.0, -3.0])
C_0, X_0, P_0 = np.ones(2), np.ones(2), 500.0


def robust_mrac(
    r: Callable[[float], float],
    t: np.ndarray,
    *,
    tau: float,
    alpha_0: float = 0.0,
    delta_0: float = 0.5,
    mu: float = 0.0,
    T: float = 2e-3,
    d: Callable[[float], float] = lambda _: 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """e (K, 2) and theta_hat (K, 2) at the instants t."""
    # Q = (s^2 + s + 0.3)/((s + 1)(tau s + 1)), W_m = (s + 1)/(s^2 + s + 0.3)
    a_1, a_0 = 1 + 1 / tau, 1 / tau

    def derivative(time: float, state: np.ndarray) -> np.ndarray:
        x, x_m, theta_hat, xi, swap, q = (state[2 * i : 2 * i + 2] for i in range(6))
        P, Xi, n_d, z = state[12:16].reshape(2, 2), state[16:20].reshape(2, 2), state[20], state[21]
        phi = C_0 @ Xi
        m_squared = 1 + phi @ phi + alpha_0 * n_d
        epsilon = (C_0 @ (x - xi) - theta_hat @ phi) / m_squared
        w = epsilon * m_squared + C_0 @ swap
        u_a = -(w + (1 - a_1) * q[0] + (0.3 - a_0) * q[1]) / tau
        u = -theta_hat @ x + K_0 * r(time) + u_a
        theta_dot = P @ phi * epsilon
        parts = (
            A_M @ x + B * (THETA @ x + u - mu / T * (u - z) + d(time)),
            A_M @ x_m + B * K_0 * r(time),
            theta_dot,
            A_M @ xi + B * u,
            A_M @ swap + Xi @ theta_dot,
            np.array([-a_1 * q[0] - a_0 * q[1] + w, q[0]]),
            (-P @ np.outer(phi, phi) @ P / m_squared).ravel(),
            (A_M @ Xi + np.outer(B, x)).ravel(),
            np.array([-delta_0 * n_d + u**2, (u - z) / T]),
        )
        return np.concatenate(parts)

    start = np.concatenate([X_0, X_0, np.zeros(2), X_0, np.zeros(4), (P_0 * np.eye(2)).ravel(), np.zeros(6)])
    found = solve_ivp(derivative, (0.0, float(t[-1])), start, method="LSODA", t_eval=t, rtol=1e-9, atol=1e-9)
    assert found.success
    return (found.y[:2] - found.y[2:4]).T, found.y[4:6].T
