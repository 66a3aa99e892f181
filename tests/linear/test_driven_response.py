"""A driven linear system between instants, compared with SciPy's ``lsim``, and its integrator for piecewise linear signals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lsim

from barbalat.linear.driven_response import driven_response
from barbalat.signals import Constant, Sine


@pytest.mark.parametrize(("n", "signals"), [(1, 1), (3, 1), (2, 2), (3, 3)])
def test_against_scipy(n, signals):
    random = np.random.default_rng(n + 10 * signals)
    A, B, C = random.normal(size=(n, n)) - 2 * np.eye(n), random.normal(size=(n, signals)), random.normal(size=(2, n))
    driving = [Sine(amplitude=2.0, frequency=1.3), Constant(0.7), Sine(amplitude=1.0, frequency=0.4, phase=1.0)][:signals]
    x0 = random.normal(size=n)
    t, y = driven_response(A, B, C, x0, driving, 5.0, 500)
    u = np.stack([signal(t) for signal in driving], axis=1)
    np.testing.assert_allclose(y, lsim((A, B, C, np.zeros((2, signals))), u, t, x0)[1], rtol=1e-9, atol=1e-11)

    def rate(now, x):
        return A @ x + B @ np.array([np.interp(now, t, column) for column in u.T])

    integrated = solve_ivp(rate, (0, 5), x0, t_eval=t[-1:], max_step=0.01, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(y[-1], C @ integrated.y[:, -1], rtol=1e-6, atol=1e-7)
