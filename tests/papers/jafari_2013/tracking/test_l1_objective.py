"""The reference system's run, compared with SciPy's linear simulation, and the control's bound, compared with a quadrature."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import StateSpace, lsim

from barbalat.linear.systems import input_filter
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.tracking import l1_reference

KAPPA, THETA = section_v.KAPPA, np.array([4.0, -3.0])
A_M, B = np.array([[0.0, 1.0], [-0.3, -1.0]]), np.array([0.0, 1.0])


def test_the_reference_run():
    """x' = (A_m + b theta')x + b c, c' = (-c - theta'x + k_0 r)/kappa."""
    _, reference = l1_reference.run_pair(100.0, 1e-4, t_end=6.0)
    A = np.block([[A_M + np.outer(B, THETA), B[:, None]], [-THETA[None] / KAPPA, np.array([[-1 / KAPPA]])]])
    system = StateSpace(A, np.array([[0.0], [0.0], [4 / KAPPA]]), np.eye(3), np.zeros((3, 1)))
    t = np.linspace(0, 6, 60_001)
    _, y, _ = lsim(system, 50 * np.sin(0.5 * t), t, X0=[1.0, 1.0, 0.0])
    at = np.searchsorted(t, reference.t - 1e-9)
    # straight lines between samples of the command 1e-4 s apart, and RK4: both 1e-8 of |x| = 100 or better
    np.testing.assert_allclose(reference.x, y[at, :2], atol=1e-5)
    np.testing.assert_allclose(reference.u, y[at, 2], atol=1e-4)
    assert np.abs(reference.theta_hat - THETA).max() < 1e-9


def test_the_distance_does_not_depend_on_the_step():
    gamma = 1e3
    coarse, fine = (l1_reference.run_pair(gamma, h) for h in (2e-5, 1e-5))
    largest = [np.abs(one.x - other.x).max() for one, other in (coarse, fine)]
    assert largest[0] == pytest.approx(largest[1], rel=0.02)  # the instants fall on other phases of the oscillation


def test_gamma_2():
    """C/(c_0'W_b) = (s^2 + s + 0.3)/((kappa s + 1)(s + 1)), with its norm by trapezoids."""
    A = np.array([[-1 / KAPPA - 1, -1 / KAPPA], [1.0, 0.0]])
    D = 1 / KAPPA
    row = np.array([1.0, 0.3]) / KAPPA + D * A[0]
    h, state, values = 2e-4, np.array([1.0, 0.0]), []
    step = expm(A * h)
    for _ in range(100_000):
        values.append(row @ state)
        state = step @ state
    norm, nu_0, of_state = D + np.trapezoid(np.abs(values), dx=h), 6.6, 8.0
    found = l1_reference.control_constant(input_filter(KAPPA), THETA, nu_0, of_state)
    assert found == pytest.approx(2 * norm * nu_0 + 7 * of_state, rel=1e-3)
