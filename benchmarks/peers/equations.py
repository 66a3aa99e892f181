"""Section V's loops on arrays of NumPy or JAX: ``xp`` is one of these two libraries.

A state is one vector with x, x_m, theta_hat and then the other states of the scheme. The last entries belong to a filter, in
coordinates that differ from the kernel's. All others are compared.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import solve_continuous_lyapunov
from scipy.signal import tf2ss

A_M = np.array([[0.0, 1.0], [-0.3, -1.0]])
B = np.array([0.0, 1.0])
THETA = np.array([4.0, -3.0])
K_0 = 4.0
BOUND = 5.0
AMPLITUDE, FREQUENCY = 50.0, 0.5
STEP = 1e-4

GAMMA = 1e4
P_B = solve_continuous_lyapunov(A_M.T, -np.eye(2)) @ B
KAPPA = 0.02

C_0 = np.array([1.0, 1.0])
TAU = 0.5
DELTA_0 = 0.1
# W_m = c_0'(sI - A_m)^-1 b = (s + 1)/(s^2 + s + 0.3), Q = 1/(W_m (tau s + 1))
Q_A, Q_B, Q_C, Q_D = tf2ss([1.0, 1.0, 0.3], np.polymul([1.0, 1.0], [TAU, 1.0]))

Derivative = Callable[[Any, Any, Any, Any], Any]
"""``derivative(xp, y, r, parameters)``."""


@dataclass(frozen=True)
class Written:
    """A loop in the forms in which a user would write it. The last form compiles fastest. The first ``compared`` entries of its
    state are the kernel's.
    """

    forms: dict[str, Derivative]
    compared: int


def l1(xp: Any, y: Any, r: Any, parameters: Any) -> Any:
    """Eqs (5)-(8). The parameter of an ensemble is the adaptive gain."""
    x, x_m, theta_hat, x_hat, u = y[0:2], y[2:4], y[4:6], y[6:8], y[8]
    gamma = parameters[0] if len(parameters) else GAMMA
    rate = gamma * ((x - x_hat) @ P_B) * x
    outward = ((theta_hat >= BOUND) & (rate > 0)) | ((theta_hat <= -BOUND) & (rate < 0))
    return xp.concatenate(
        [
            A_M @ x + B * (u + THETA @ x),
            A_M @ x_m + B * (K_0 * r),
            xp.where(outward, 0.0, rate),
            A_M @ x_hat + B * (u + theta_hat @ x),
            xp.atleast_1d((K_0 * r - theta_hat @ x - u) / KAPPA),
        ]
    )


def l1_by_components(xp: Any, y: Any, r: Any, parameters: Any) -> Any:
    """The L1 loop written in scalars, without calls for products of small matrices."""

    def projected(rate: Any, estimate: Any) -> Any:
        outward = ((estimate >= BOUND) & (rate > 0)) | ((estimate <= -BOUND) & (rate < 0))
        return xp.where(outward, 0.0, rate)

    x1, x2, x_m1, x_m2, theta1, theta2, x_hat1, x_hat2, u = y
    gamma = parameters[0] if len(parameters) else GAMMA
    v = u + THETA[0] * x1 + THETA[1] * x2
    learnt = theta1 * x1 + theta2 * x2
    e = gamma * ((x1 - x_hat1) * P_B[0] + (x2 - x_hat2) * P_B[1])
    return xp.stack(
        [
            x2,
            A_M[1, 0] * x1 + A_M[1, 1] * x2 + v,
            x_m2,
            A_M[1, 0] * x_m1 + A_M[1, 1] * x_m2 + K_0 * r,
            projected(e * x1, theta1),
            projected(e * x2, theta2),
            x_hat2,
            A_M[1, 0] * x_hat1 + A_M[1, 1] * x_hat2 + u + learnt,
            (K_0 * r - learnt - u) / KAPPA,
        ]
    )


def robust_mrac(xp: Any, y: Any, r: Any, _: Any) -> Any:
    """Eqs (13)-(16) with least squares. An ensemble varies only the initial state."""
    x, x_m, theta_hat, P = y[0:2], y[2:4], y[4:6], y[6:10].reshape(2, 2)
    xi, Xi, n_d, swapping, q = y[10:12], y[12:16].reshape(2, 2), y[16], y[17:19], y[19:21]
    phi = C_0 @ Xi
    m_s_squared = 1 + phi @ phi
    error = C_0 @ (x - xi) - theta_hat @ phi
    argument = error + C_0 @ swapping
    u = K_0 * r - theta_hat @ x - (Q_C[0] @ q + Q_D[0, 0] * argument)
    P_phi = P @ phi
    rate = P_phi * (error / m_s_squared)
    for i in range(2):
        inward = ((theta_hat[i] < BOUND) | (rate[i] < 0)) & ((theta_hat[i] > -BOUND) | (rate[i] > 0))
        rate = rate - P[:, i] * (xp.where(inward, 0.0, rate[i]) / P[i, i])
    return xp.concatenate(
        [
            A_M @ x + B * (u + THETA @ x),
            A_M @ x_m + B * (K_0 * r),
            rate,
            -xp.outer(P_phi, P_phi).reshape(4) / m_s_squared,
            A_M @ xi + B * u,
            (A_M @ Xi + xp.outer(B, x)).reshape(4),
            xp.atleast_1d(u * u - DELTA_0 * n_d),
            A_M @ swapping + Xi @ rate,
            Q_A @ q + Q_B[:, 0] * argument,
        ]
    )


def clip(xp: Any, y: Any) -> Any:
    """The estimate limited to the known box, as it is at every stage."""
    return xp.concatenate([y[:4], xp.clip(y[4:6], -BOUND, BOUND), y[6:]])


def rk4(xp: Any, derivative: Derivative, y: Any, r: Any, parameters: Any) -> Any:
    """One RK4 step. ``r`` is the command at the start, the middle and the end of the step."""
    k_1 = derivative(xp, y, r[0], parameters)
    k_2 = derivative(xp, clip(xp, y + STEP / 2 * k_1), r[1], parameters)
    k_3 = derivative(xp, clip(xp, y + STEP / 2 * k_2), r[1], parameters)
    k_4 = derivative(xp, clip(xp, y + STEP * k_3), r[2], parameters)
    return clip(xp, y + STEP / 6 * (k_1 + 2 * k_2 + 2 * k_3 + k_4))


WRITTEN = {
    "L1, 9 states": Written({"arrays": l1, "numbers": l1_by_components}, 8),
    "robust MRAC, 21 states": Written({"arrays": robust_mrac}, 19),
}
"""The written loops by the name of the benchmark's case."""
