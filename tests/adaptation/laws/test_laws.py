"""The laws on data z = theta'phi with a constant theta and a regressor that is a known function of time."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad_vec

from barbalat.adaptation.law import Normalization
from barbalat.adaptation.laws import Estimation, Gradient, LeastSquares
from barbalat.adaptation.laws.least_squares import Memory
from independent import integrate

THETA = np.array([4.0, -3.0, 0.5])
THETA_HAT0 = np.array([0.2, 1.0, -1.0])
TIMES = np.linspace(0, 6, 7)


def phi(t):
    return np.array([np.sin(t), np.cos(2 * t) + 0.3, np.exp(-t / 3)])


def m_s_squared(t):
    return 1 + phi(t) @ phi(t)


def flow(law):
    """theta_hat (7, 3) and the covariance (7, 3, 3) at TIMES."""
    covariance0 = law.initial(3).covariance

    def derivative(t, y):
        theta_hat, covariance = y[:3], y[3:].reshape(covariance0.shape)
        epsilon = (THETA - theta_hat) @ phi(t) / m_s_squared(t)
        rates = law.rates(theta_hat, Memory(covariance), Estimation(phi(t), m_s_squared(t), epsilon), None)
        return np.concatenate([rates.theta_hat, rates.memory.covariance.ravel()])

    y = integrate(derivative, np.concatenate([THETA_HAT0, covariance0.ravel()]), TIMES[-1], TIMES).T
    return y[:, :3], y[:, 3:].reshape(-1, *covariance0.shape)


@pytest.mark.parametrize("covariance0", [0.1, 5.0, 500.0])
def test_least_squares_is_the_regularised_least_squares_solution(covariance0):
    """P^-1(t) = P_0^-1 + int phi phi'/m^2; theta_hat(t) = argmin |theta_hat - theta_hat_0|^2/p_0 + int (z - theta'phi)^2/m^2."""
    theta_hat, covariance = flow(LeastSquares(covariance0=covariance0))
    for i, t in enumerate(TIMES):
        information = (
            quad_vec(lambda s: np.outer(phi(s), phi(s)) / m_s_squared(s), 0, t, epsabs=1e-13)[0] if t else np.zeros((3, 3))
        )
        normal = np.eye(3) / covariance0 + information
        # 1e-8: the integration's 1e-12 times the condition number of the information matrix, at most 1e4 here
        np.testing.assert_allclose(covariance[i] @ normal, np.eye(3), atol=1e-8)
        minimiser = np.linalg.solve(normal, THETA_HAT0 / covariance0 + information @ THETA)
        np.testing.assert_allclose(theta_hat[i], minimiser, atol=1e-8)


def test_the_covariance_stays_symmetric_and_decreases():
    _, covariance = flow(LeastSquares(covariance0=50.0))
    for earlier, later in pairwise(covariance):
        np.testing.assert_allclose(later, later.T, atol=1e-10)
        assert np.linalg.eigvalsh(later).min() > 0
        assert np.linalg.eigvalsh(earlier - later).min() > -1e-10  # the accuracy of the integration of entries up to 50


def test_gradient_decreases_its_lyapunov_function_at_the_right_rate():
    """V = |theta_tilde|^2/(2 gamma) has V' = -epsilon^2 m^2 along the flow. V' is integrated with the flow."""
    gamma = 3.0

    def derivative(t, y):
        theta_hat = y[:3]
        epsilon = (THETA - theta_hat) @ phi(t) / m_s_squared(t)
        rates = Gradient(gamma=gamma).rates(theta_hat, (), Estimation(phi(t), m_s_squared(t), epsilon), None)
        return np.append(rates.theta_hat, epsilon**2 * m_s_squared(t))

    y = integrate(derivative, np.append(THETA_HAT0, 0.0), 6.0)
    V = ((y[:3].T - THETA) ** 2).sum(axis=1) / (2 * gamma)
    np.testing.assert_allclose(V + y[3], V[0], rtol=1e-10)  # integrated to 1e-12


def test_gradient_of_one_parameter_is_an_exponential():
    """With phi = 1 and m^2 = 2, theta_tilde = theta_tilde(0) exp(-gamma t/2)."""
    law = Gradient(gamma=0.8)

    def derivative(t, y):
        return law.rates(y, (), Estimation(np.ones(1), 2.0, (3.0 - y[0]) / 2), None).theta_hat

    y = integrate(derivative, [0.0], 4.0, [4.0])
    assert y[0, -1] == pytest.approx(3 * (1 - np.exp(-0.8 * 4 / 2)), rel=1e-10)


def test_normalising_signal_of_a_constant_input():
    """n_d = u^2 (1 - exp(-delta_0 t))/delta_0, exactly."""
    normalization = Normalization(alpha_0=2.0, delta_0=0.7)
    n_d = integrate(lambda t, y: [normalization.n_d_dot(y[0], 3.0)], [0.0], 2.0, [2.0])[0, -1]
    exact = 9 * (1 - np.exp(-1.4)) / 0.7
    assert n_d == pytest.approx(exact, rel=1e-10)
    assert normalization.m_s_squared(np.array([1.0, 2.0]), exact) == pytest.approx(1 + 5 + 2 * exact, rel=1e-15)
