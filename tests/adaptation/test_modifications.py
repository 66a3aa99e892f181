"""Leakage and dead zone, compared with exact solutions for one parameter, and the robustness that they provide."""

from __future__ import annotations

import numpy as np
import pytest

from barbalat.adaptation.laws import Estimation
from barbalat.adaptation.laws.least_squares import Memory
from barbalat.laws import DeadZone, EpsilonModification, FixedSigma, Gradient, LeastSquares, LeastSquaresResetting, SwitchingSigma
from independent import integrate, refusal


def estimate(law, theta, t_end, phi=lambda t: 1.0, eta=lambda t: 0.0, theta_hat0=0.0):
    """theta_hat(t_end) of one parameter with m_s^2 = 1 + phi^2."""

    def derivative(t, y):
        m_squared = 1 + phi(t) ** 2
        epsilon = ((theta - y[0]) * phi(t) + eta(t)) / m_squared
        return law.rates(y, (), Estimation(np.array([phi(t)]), m_squared, epsilon), None).theta_hat

    return integrate(derivative, [theta_hat0], t_end, [t_end], rtol=1e-11)[0, -1]


def test_fixed_sigma_is_a_linear_pull_to_zero():
    """With phi = 1, theta_hat' = gamma ((theta - theta_hat)/2 - sigma theta_hat), which has its equilibrium at theta/(1 + 2
    sigma)."""
    gamma, sigma, theta, t = 0.8, 0.2, 3.0, 2.0
    rest, rate = theta / (1 + 2 * sigma), gamma * (0.5 + sigma)
    law = Gradient(gamma=gamma, leakage=FixedSigma(sigma=sigma))
    assert estimate(law, theta, t) == pytest.approx(rest * (1 - np.exp(-rate * t)), rel=1e-10)


def test_switching_sigma_is_off_inside_and_full_beyond_twice():
    law = SwitchingSigma(sigma=0.3, M_0=2.0)
    for size, expected in [(0.0, 0.0), (2.0, 0.0), (3.0, 0.15), (4.0, 0.3), (100.0, 0.3)]:
        assert law.coefficient(size * np.array([0.6, -0.8]), 1.0) == pytest.approx(expected, abs=1e-15)
    inside = Gradient(gamma=1.0, leakage=law)
    assert estimate(inside, 1.5, 30.0) == pytest.approx(
        1.5, abs=1e-6
    )  # e^{-15} of the initial value: no bias, unlike a fixed sigma


def test_epsilon_modification_rests_where_the_error_does():
    """With phi = 1, an equilibrium requires epsilon = 0 or epsilon = nu |epsilon m_s| theta_hat. The modification does not move
    the equilibrium with epsilon = 0."""
    law = Gradient(gamma=2.0, leakage=EpsilonModification(nu=0.1))
    assert estimate(law, 1.5, 60.0) == pytest.approx(1.5, abs=1e-5)
    assert EpsilonModification(nu=0.5).coefficient(np.ones(2), -3.0) == 1.5


def test_the_dead_zone_stops_at_its_border():
    """With phi = 1, |epsilon m_s| falls exponentially to g_0 and not below it, where theta - theta_hat = g_0 sqrt(2)."""
    g_0 = 0.1
    law = Gradient(gamma=1.0, dead_zone=DeadZone(g_0=g_0))
    assert 2.0 - estimate(law, 2.0, 60.0) == pytest.approx(g_0 * np.sqrt(2), rel=1e-6)
    zone = DeadZone(g_0=0.5)
    assert zone.weight(0.0) == zone.weight(0.25) == 0.0
    assert zone.weight(4.0) == 0.75


DRIFT = {
    "fixed sigma": {"leakage": FixedSigma(sigma=0.1)},
    "switching sigma": {"leakage": SwitchingSigma(sigma=0.1, M_0=3.0)},
    "epsilon": {"leakage": EpsilonModification(nu=0.5)},
    "dead zone": {"dead_zone": DeadZone(g_0=0.25)},
}


@pytest.mark.full
def test_a_bounded_error_lets_the_plain_law_drift_and_no_modified_one():
    """The drift is that in section 8.3.1 of Ioannou and Sun: phi decays like (1 + t)^{-1/2} and eta like (1 + t)^{-1/4}."""

    def phi(t):
        return (1 + t) ** -0.5

    def eta(t):
        return 0.25 * (1 + t) ** -0.25

    drifted = abs(estimate(Gradient(gamma=1.0), 2.0, 1e6, phi, eta))
    assert drifted > 2 * abs(estimate(Gradient(gamma=1.0), 2.0, 1e3, phi, eta))
    for name, extra in DRIFT.items():
        assert abs(estimate(Gradient(gamma=1.0, **extra), 2.0, 1e6, phi, eta)) < min(6.0, drifted / 1.5), name


def test_the_dead_zone_stops_the_covariance_as_well():
    law = LeastSquares(covariance0=2.0, dead_zone=DeadZone(g_0=0.5))
    given = Estimation(np.array([1.0]), 2.0, 0.3)  # |epsilon m_s| = 0.42
    rates = law.rates(np.zeros(1), Memory(np.array([[2.0]])), given, None)
    assert not rates.theta_hat.any() and not rates.memory.covariance.any()
    outside = law.rates(np.zeros(1), Memory(np.array([[2.0]])), given._replace(epsilon=1 / np.sqrt(2)), None)  # = 1: weight 1/2
    np.testing.assert_allclose(outside.memory.covariance, [[-0.5 * 4 / 2]], rtol=1e-14)
    np.testing.assert_allclose(outside.theta_hat, [0.5 * 2 / np.sqrt(2)], rtol=1e-14)


class Twice(FixedSigma):
    """A leakage from outside the package that is twice another leakage."""

    def coefficient(self, theta_hat, error):
        return 2 * super().coefficient(theta_hat, error)


class Unbounded(Twice):
    """A leakage whose largest value is unknown."""

    largest = np.inf


def test_a_leakage_from_outside_is_tolerated_for_what_it_answers():
    assert Gradient(1.0, leakage=Unbounded(0.1)).leakage is not None
    assert LeastSquaresResetting(rho_0=2.0, rho_1=1.0, leakage=Twice(0.1)).leakage is not None
    assert "use FixedSigma or SwitchingSigma instead" in refusal(
        lambda: LeastSquaresResetting(rho_0=2.0, rho_1=1.0, leakage=Unbounded(0.1))
    )
    assert "use SwitchingSigma instead" in refusal(lambda: LeastSquares(1.0, leakage=Twice(0.1)))
    assert "leakage must be" in refusal(lambda: Gradient(1.0, leakage=FixedSigma))
