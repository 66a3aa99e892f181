"""Eqs (3)-(8), written a second time in plain NumPy and integrated by a method of order eight."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import linalg
from scipy import signal as scipy_signal

from barbalat.controllers import L1Adaptive, Mrac
from barbalat.linear.systems import TransferFunction, input_filter
from barbalat.problem.state_feedback import Problem
from barbalat.run.engine.simulate import simulate
from barbalat.signals import Sine
from barbalat.solvers.simulation import Simulation
from independent import integrate

T_END = 4.0
STEP = 2.0**-10  # RK4's error is of the order of h^4 = 1e-12 times derivatives


def final(problem, controller):
    result = simulate(problem, [controller], Simulation(t_end=T_END, dt=STEP))[controller.name]
    return result.x[-1], result.x_m[-1], result.theta_hat[-1]


def lyapunov_vector(plant):
    """P b from the vectorised equation (A_m' (+) A_m') vec P = -vec I."""
    A, n = plant.A_m.T, plant.n
    P = np.linalg.solve(np.kron(A, np.eye(n)) + np.kron(np.eye(n), A), -np.eye(n).ravel()).reshape(n, n)
    return P @ plant.b


def filter_matrices(controller, n_channels=1):
    if controller.filter is None:
        return np.zeros((0, 0)), np.zeros(0), np.zeros(0), 1.0
    A, B, C, D = scipy_signal.tf2ss(controller.filter.num, controller.filter.den)
    return A, B[:, 0], C[0], D[0, 0]


def written_out(problem, controller, disturbance=lambda t: 0.0):
    """The derivative of (x, x_m, theta_hat, x_hat, filter) by the paper's equations, and its initial value."""
    plant, k_0, r = problem.plant, problem.reference_model.k_0, problem.reference
    n, P_b, gamma = plant.n, lyapunov_vector(plant), controller.gamma
    l1 = isinstance(controller, L1Adaptive)
    A_f, B_f, C_f, D_f = filter_matrices(controller) if l1 else (np.zeros((0, 0)), np.zeros(0), np.zeros(0), 1.0)

    def derivative(t, y):
        x, x_m, theta_hat, x_hat, state = np.split(y, [n, 2 * n, 3 * n, 4 * n])
        wanted = -theta_hat @ x + k_0 * r(np.array(t))
        u = C_f @ state + D_f * wanted
        x_dot = plant.A_m @ x + plant.b * (plant.theta @ x + u + disturbance(t))
        x_m_dot = plant.A_m @ x_m + plant.b * k_0 * r(np.array(t))
        x_hat_dot = plant.A_m @ x_hat + plant.b * (theta_hat @ x + u)
        driving = x - x_hat if l1 else x - x_m
        theta_hat_dot = gamma * (driving @ P_b) * x
        return np.concatenate([x_dot, x_m_dot, theta_hat_dot, x_hat_dot, A_f @ state + B_f * wanted])

    return derivative, np.concatenate([plant.x0, plant.x0, np.zeros(n), plant.x0, np.zeros(len(B_f))])


CONTROLLERS = {
    "mrac": Mrac(gamma=2.0, projection=False),
    "l1, first order": L1Adaptive(gamma=20.0, filter=input_filter(0.05), projection=False),
    "l1, second order": L1Adaptive(gamma=5.0, filter=TransferFunction([3.0, 400.0], [1.0, 20.0, 400.0]), projection=False),
    "l1, C = 1": L1Adaptive(gamma=2.0, filter=None, projection=False),
}


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize("n", [1, 2, 3])
def test_against_the_paper_written_out(problems, n, name):
    problem, controller = problems[n], CONTROLLERS[name]
    derivative, y0 = written_out(problem, controller)
    reference = integrate(derivative, y0, T_END)[:, -1]
    # 1e-8: h^4 = 1e-12 times the fifth derivatives of modes up to 20 rad/s, 20^4 = 1.6e5, over a few seconds
    for found, expected in zip(final(problem, controller), np.split(reference, [n, 2 * n, 3 * n])[:3], strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-8)


def test_a_matched_disturbance_enters_with_the_input(problems):
    given = problems[2]
    problem = Problem(
        plant=given.plant, reference_model=given.reference_model, reference=given.reference, disturbance=Sine(3.0, 2.0)
    )
    controller = CONTROLLERS["mrac"]
    derivative, y0 = written_out(problem, controller, disturbance=lambda t: 3 * np.sin(2 * t))
    reference = integrate(derivative, y0, T_END)[:, -1]
    np.testing.assert_allclose(final(problem, controller)[0], reference[:2], atol=1e-8)  # as above


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("projection", [True, False])
def test_without_its_filter_l1_is_mrac(problems, n, projection):
    """By Section III.A, x_hat = x_m for all t with C = 1. The two programs differ only in the order of their sums.

    The tolerance 4000 * 10 * 1e-16 = 4e-12 is for a rounding of 1e-16 of states of order 10 in each of 4000 steps. The loop does
    not amplify it, because gamma is small and the estimates converge. A wrong term would cause 1e-3 or more.
    """
    simulation = Simulation(t_end=16.0, dt=2.0**-8)
    pair = [
        Mrac(gamma=2.0, projection=projection),
        L1Adaptive(gamma=2.0, filter=None, projection=projection, name="L1, C = 1"),
    ]
    mrac, l1 = simulate(problems[n], pair, simulation).values()
    for name in ("x", "theta_hat", "u", "e"):
        np.testing.assert_allclose(getattr(l1, name), getattr(mrac, name), rtol=0, atol=4e-12)
    np.testing.assert_allclose(
        l1.figures["theta_hat_variation_rate"], mrac.figures["theta_hat_variation_rate"], rtol=0, atol=4e-12
    )


def test_without_its_filter_l1_is_mrac_in_section_v(section_v):
    """The two are equal also with projection, states near 100 and a gain of 1. The tolerance is 20 000 steps * 100 * 1e-16 =
    2e-10."""
    pair = [Mrac(gamma=1.0), L1Adaptive(gamma=1.0, filter=None, name="L1, C = 1")]
    mrac, l1 = simulate(section_v, pair, Simulation(t_end=20.0, dt=1e-3)).values()
    np.testing.assert_allclose(l1.x, mrac.x, rtol=0, atol=2e-10)
    np.testing.assert_allclose(l1.theta_hat, mrac.theta_hat, rtol=0, atol=2e-10)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_the_lyapunov_function_never_grows(problems, n):
    """V = e'Pe + |theta_tilde|^2/gamma has V' = -|e|^2, so V plus the integral of |e|^2 is constant, by Theorem 1's proof."""
    problem, gamma = problems[n], 10.0
    steps = 2**12
    result = simulate(problem, [Mrac(gamma=gamma, projection=False)], Simulation(t_end=8.0, dt=8 / steps, record_points=steps))[
        "MRAC"
    ]
    P = linalg.solve_continuous_are(problem.plant.A_m, np.zeros((n, 1)), np.eye(n), np.eye(1))  # without input, by Lyapunov
    V = np.einsum("ki,ij,kj->k", result.e, P, result.e) + ((result.theta_hat - problem.plant.theta) ** 2).sum(axis=1) / gamma
    dissipated = np.concatenate([[0.0], np.cumsum((result.e[1:] ** 2 + result.e[:-1] ** 2).sum(axis=1)) * 8 / steps / 2])
    np.testing.assert_allclose(V + dissipated, V[0], rtol=1e-5)  # the trapezoidal rule: h^2 = 4e-6 times curvature


def test_the_initial_estimate_is_taken(problems):
    """With theta_hat(0) = theta there is nothing to learn, and e stays zero up to rounding."""
    problem = problems[3]
    result = simulate(problem, [Mrac(gamma=20.0, theta_hat0=problem.plant.theta)], Simulation(t_end=8.0, dt=2.0**-7))["MRAC"]
    assert max(result.figures["max_abs_e"]) < 1e-13  # roundings of states of order 1 in 1000 steps, damped by A_m
    np.testing.assert_allclose(result.theta_hat, np.tile(problem.plant.theta, (len(result.t), 1)), atol=1e-12)
