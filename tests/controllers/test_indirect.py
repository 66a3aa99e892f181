"""Indirect MRAC, which is MRAC with an unknown input gain, in the plant's own parameters."""

from __future__ import annotations

import numpy as np
import pytest

from barbalat import Mrac, load_case, simulate
from barbalat.solvers.simulation import Simulation
from independent import integrate


def test_mrac_with_an_unknown_gain_is_the_indirect_scheme_of_the_textbooks():
    """For x' = a x + b u with a = 1 and b = 3, the scheme estimates a and b and computes the gains from them.

    x_hat' = a_m (x_hat - x) + a_hat x + b_hat u, a series-parallel estimator, with a_hat' = gamma (x - x_hat) x and b_hat' =
    gamma (x - x_hat) u; u = -k_x x + k_r r with k_x = (a_hat - a_m)/b_hat and k_r = b_m/b_hat. With that u, x_hat is x_m, so the
    law is the law of ``mrac``, with P = 1/(2 |a_m|) in its gain, theta_hat = a_hat - a_m and omega_hat = b_hat, which stays
    inside its interval here. At the ends ``mrac`` would project it. The tolerance 1e-8 is for RK4 at 1 ms.
    """
    case, gamma, a_m, b_m, until = load_case("first-order"), 0.25, -4.0, 4.0, 10.0

    def indirect(t, state):
        x, x_hat, a_hat, b_hat = state
        r = 4 * np.sin(3 * t)
        u = -(a_hat - a_m) / b_hat * x + b_m / b_hat * r
        off = x - x_hat
        return x + 3 * u, a_m * (x_hat - x) + a_hat * x + b_hat * u, gamma * off * x, gamma * off * u

    instants = np.linspace(0, until, 101)
    states = integrate(indirect, [0.0, 0.0, a_m, 1.0], until, instants)
    assert (states[3] > 0.5).all() and (states[3] < 5.0).all()
    simulation = Simulation(t_end=until, dt=1e-3, record_points=100)
    (run,) = simulate(case.problem, [Mrac(gamma=gamma * 2 * abs(a_m))], simulation).values()
    np.testing.assert_allclose(run.t, instants, atol=1e-12)
    np.testing.assert_allclose(run.x[:, 0], states[0], atol=1e-8)
    np.testing.assert_allclose(run.theta_hat[:, 0], states[2] - a_m, atol=1e-8)
    np.testing.assert_allclose(run.theta_hat[:, 1], states[3], atol=1e-8)
    assert run.theta_hat[-1] != pytest.approx([0.0, 1.0], abs=0.1)  # the estimates did change
