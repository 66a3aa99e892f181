"""Forgetting, resetting, bounds and the integral cost, compared with closed forms and quadrature."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad_vec

from barbalat.adaptation.laws import (
    Estimation,
    IntegralCost,
    LeastSquares,
    LeastSquaresBounded,
    LeastSquaresBoundedGain,
    LeastSquaresForgetting,
    LeastSquaresResetting,
    least_squares,
)
from independent import integrate

THETA = np.array([4.0, -3.0, 0.5])
THETA_HAT0 = np.array([0.2, 1.0, -1.0])
P_0 = np.array([[3.0, 1.0, 0.5], [1.0, 2.0, -0.4], [0.5, -0.4, 1.0]])
TIMES = np.linspace(0, 6, 7)


def phi(t):
    """A persistently exciting regressor with three frequencies."""
    return np.array([np.sin(t), np.cos(2 * t) + 0.3, np.cos(0.5 * t)])


def m_s_squared(t):
    return 1 + phi(t) @ phi(t)


def flow(law, times, regressor=phi, theta=THETA, theta_hat0=THETA_HAT0, rtol=1e-12):
    """theta_hat and the parts of the law's memory at these times. The first axis is time."""
    n = len(theta)
    memory0 = law.initial(n)
    sizes = np.cumsum([n] + [part.size for part in memory0])

    def unpack(y):
        parts = np.split(y, sizes[:-1])
        return parts[0], type(memory0)(*(p.reshape(m.shape) for p, m in zip(parts[1:], memory0, strict=True)))

    def derivative(t, y):
        theta_hat, memory = unpack(y)
        phi_t = regressor(t)
        m_squared = 1 + phi_t @ phi_t
        rates = law.rates(theta_hat, memory, Estimation(phi_t, m_squared, (theta - theta_hat) @ phi_t / m_squared), None)
        return np.concatenate([rates.theta_hat, *(part.ravel() for part in rates.memory)])

    y0 = np.concatenate([theta_hat0, *(part.ravel() for part in memory0)])
    solved = [unpack(y) for y in integrate(derivative, y0, times[-1], times, rtol=rtol).T]
    return np.array([s[0] for s in solved]), [s[1] for s in solved]


def weighted(f, beta, t):
    """int_0^t e^{-beta (t - s)} f(s) ds, by quadrature."""
    return quad_vec(lambda s: np.exp(-beta * (t - s)) * f(s), 0, t, epsabs=1e-13)[0] if t else 0 * f(0.0)


def test_forgetting_is_the_exponentially_weighted_least_squares_solution():
    """P^-1 = e^{-beta t} P_0^-1 + int e^{-beta(t-s)} phi phi'/m^2, and theta_tilde = e^{-beta t} P P_0^-1 theta_tilde(0)."""
    beta = 0.7
    theta_hat, memory = flow(LeastSquaresForgetting(covariance0=P_0, forgetting=beta), TIMES)
    for i, t in enumerate(TIMES):
        information = np.exp(-beta * t) * np.linalg.inv(P_0) + weighted(
            lambda s: np.outer(phi(s), phi(s)) / m_s_squared(s), beta, t
        )
        # 1e-9: the integration's 1e-12 times the condition number of the information matrix, about 100
        np.testing.assert_allclose(memory[i].covariance @ information, np.eye(3), atol=1e-9)
        exact = np.exp(-beta * t) * np.linalg.solve(information, np.linalg.solve(P_0, THETA_HAT0 - THETA))
        np.testing.assert_allclose(theta_hat[i] - THETA, exact, atol=1e-9)


def test_integral_cost_remembers_the_weighted_data():
    beta = 0.7
    _, memory = flow(IntegralCost(gamma=P_0, forgetting=beta), TIMES)
    for i, t in enumerate(TIMES):
        R = weighted(lambda s: np.outer(phi(s), phi(s)) / m_s_squared(s), beta, t)
        np.testing.assert_allclose(memory[i].R, R, atol=1e-11)  # integrated to 1e-12, entries below 2
        np.testing.assert_allclose(memory[i].Q, R @ THETA, atol=1e-10)


def test_pure_least_squares_goes_like_1_over_t_and_forgetting_exponentially():
    """Under persistent excitation the error halves from 50 to 100 s without forgetting. With forgetting it falls by e^{-50 beta}
    times a periodic factor."""
    times = np.array([0.0, 50.0, 100.0])
    slow, _ = flow(LeastSquares(covariance0=100.0), times, rtol=1e-10)
    fast, _ = flow(LeastSquaresForgetting(covariance0=100.0, forgetting=0.2), times, rtol=1e-10)
    error = [np.linalg.norm(estimate - THETA, axis=1) for estimate in (slow, fast)]
    assert error[0][2] / error[0][1] == pytest.approx(0.5, rel=0.05)  # a few per cent of the information is not yet periodic
    assert np.log(error[1][2] / error[1][1]) == pytest.approx(-0.2 * 50, abs=1.5)  # P between its periodic extremes


def test_windup_and_its_two_cures():
    """Without excitation P is P_0 e^{beta t}, is held at R_0, or follows a logistic curve towards k_0."""
    beta, bound, t = 0.5, 8.0, 10.0

    def nothing(_):
        return np.zeros(1)

    theta, theta_hat0 = np.ones(1), np.zeros(1)
    wound = flow(LeastSquaresForgetting(covariance0=2.0, forgetting=beta), [0, t], nothing, theta, theta_hat0)[1][-1]
    assert wound.covariance[0, 0] == pytest.approx(2 * np.exp(beta * t), rel=1e-10)
    gentle = LeastSquaresBoundedGain(covariance0=2.0, forgetting=beta, covariance_bound=bound)
    curve = flow(gentle, [0, t], nothing, theta, theta_hat0)[1][-1]
    assert curve.covariance[0, 0] == pytest.approx(bound / (1 + (bound / 2 - 1) * np.exp(-beta * t)), rel=1e-10)
    held = march(LeastSquaresBounded(covariance0=2.0, forgetting=beta, covariance_bound=bound), nothing, theta, theta_hat0, t)[1]
    assert held[-1][0, 0] == pytest.approx(bound, rel=1e-12)
    assert max(P[0, 0] for P in held) <= bound


def march(law, regressor, theta, theta_hat0, t_end, h=1e-2):
    """theta_hat and the covariance at every step of Heun's method with the law's limit at both stages."""

    def rates(t, theta_hat, memory):
        phi_t = regressor(t)
        m_squared = 1 + phi_t @ phi_t
        return law.rates(theta_hat, memory, Estimation(phi_t, m_squared, (theta - theta_hat) @ phi_t / m_squared), None)

    theta_hat, memory = theta_hat0, law.initial(len(theta))
    estimates, covariances = [theta_hat], [memory.covariance]
    for k in range(round(t_end / h)):
        first = rates(k * h, theta_hat, memory)
        stage = law.limit(least_squares.Memory(memory.covariance + h * first.memory.covariance))
        second = rates((k + 1) * h, theta_hat + h * first.theta_hat, stage)
        theta_hat = theta_hat + h / 2 * (first.theta_hat + second.theta_hat)
        memory = law.limit(least_squares.Memory(memory.covariance + h / 2 * (first.memory.covariance + second.memory.covariance)))
        estimates.append(theta_hat)
        covariances.append(memory.covariance)
    return np.array(estimates), covariances


def V(theta_hat, P):
    return (theta_hat - THETA) @ np.linalg.solve(P, theta_hat - THETA) / 2


def test_resetting_keeps_the_covariance_between_its_bounds():
    rho_0, rho_1 = 10.0, 0.3
    estimates, covariances = march(LeastSquaresResetting(rho_0=rho_0, rho_1=rho_1), phi, THETA, THETA_HAT0, 60.0)
    eigenvalues = np.linalg.eigvalsh(np.array(covariances))
    assert eigenvalues.min() > rho_1
    assert eigenvalues.max() <= rho_0 * (1 + 1e-14)
    resets = [k for k, P in enumerate(covariances) if k and (rho_0 * np.eye(3) == P).all()]
    assert len(resets) >= 3
    for k in resets:  # just above rho_1 before: a step decreases the largest eigenvalue by at most h |P phi|^2/m^2 <= 1e-2 100
        assert eigenvalues[k - 1, 0] < rho_1 + 0.01
    values = [V(*pair) for pair in zip(estimates, covariances, strict=True)]
    assert (
        np.diff(values) <= 1e-4 * values[0]
    ).all()  # the error of Heun's method at 1e-2, because V' = 0 does not exclude growth by it
    assert values[-1] < 1e-6 * values[0]


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_the_reset_criterion_is_the_smallest_eigenvalue(n):
    """The pivots of P - rho I agree with LAPACK's eigenvalues for definite and indefinite matrices."""
    random = np.random.default_rng(n)
    for _ in range(500):
        root = random.normal(size=(n, n))
        P = root @ root.T - random.choice([0.0, 1.0]) * np.eye(n)
        smallest = np.linalg.eigvalsh(P)[0]
        rho = smallest + random.choice([-1, 1]) * 10.0 ** random.uniform(-8, 0)
        assert (least_squares.smallest_pivot(P, rho) > 0) == (smallest > rho)


def test_a_bad_covariance_is_not_reset_to_a_good_one():
    P = np.full((2, 2), np.nan)
    assert np.isnan(LeastSquaresResetting(rho_0=1.0, rho_1=0.1).limit(least_squares.Memory(P)).covariance).all()
    assert np.isnan(
        LeastSquaresBounded(covariance0=1.0, forgetting=0.1, covariance_bound=9.0).limit(least_squares.Memory(P)).covariance
    ).all()


@pytest.mark.parametrize("kind", [LeastSquaresBounded, LeastSquaresBoundedGain])
def test_bounds_hold_where_one_direction_is_never_excited(kind):
    """P grows up to its bound in the second direction and stays there. In the first direction the law continues to learn, and V
    decreases throughout."""
    bound = 20.0
    law = kind(covariance0=5.0, forgetting=0.5, covariance_bound=bound)

    def partial(t):
        return np.array([1 + np.sin(t), 0.0, 0.5 * np.cos(t)])

    estimates, covariances = march(law, partial, THETA, THETA_HAT0, 60.0)
    norms = [np.linalg.norm(P) for P in covariances]
    assert max(norms) <= bound * (1 + 1e-12)
    assert norms[-1] > 0.99 * bound  # without the bound it would grow further
    if kind is LeastSquaresBounded:  # (P^-1)' <= -beta P^-1 + I or 0, so P^-1 <= I/beta, as a fixed sigma requires
        assert np.linalg.eigvalsh(covariances)[:, 0].min() > 0.5 * (1 - 1e-3)
    values = [V(*pair) for pair in zip(estimates, covariances, strict=True)]
    assert (np.diff(values) <= 1e-4 * values[0]).all()  # as above
    # with the other direction at its bound nothing is forgotten, and the error decreases like 1/t: 4/60
    np.testing.assert_allclose(estimates[-1][[0, 2]], THETA[[0, 2]], atol=0.07)
