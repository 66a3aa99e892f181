"""Peak gains, compared with closed forms and python-control's H-infinity norm."""

import control
import numpy as np
import pytest

from barbalat.linear.peaks import PEAK_PRECISION, peak_gain
from barbalat.linear.systems import StateSpace, TransferFunction, complementary_sensitivity, sensitivity
from independent import refusal


@pytest.mark.parametrize("zeta", [1e-4, 0.01, 0.1, 0.5])
def test_resonance(zeta):
    """1/(s^2 + 2 zeta s + 1) has the peak 1/(2 zeta sqrt(1 - zeta^2)) at sqrt(1 - 2 zeta^2)."""
    peak = peak_gain(TransferFunction([1.0], [1.0, 2 * zeta, 1.0]).realise())
    assert peak.gain == pytest.approx(1 / (2 * zeta * np.sqrt(1 - zeta**2)), rel=2 * PEAK_PRECISION)
    assert peak.frequency == pytest.approx(np.sqrt(1 - 2 * zeta**2), rel=0.01)


def test_ends_of_the_frequency_axis():
    assert peak_gain(TransferFunction([2.0], [1.0, 1.0]).realise()).frequency == 0
    high = peak_gain(TransferFunction([2.0, 0.0], [1.0, 1.0]).realise())
    assert high.gain == pytest.approx(2.0, rel=2 * PEAK_PRECISION)
    assert peak_gain(StateSpace(np.zeros((0, 0)), np.zeros(0), np.zeros(0), -3.0)).gain == pytest.approx(
        3.0, rel=2 * PEAK_PRECISION
    )
    assert peak_gain(StateSpace(-np.eye(1), np.zeros(1), np.ones(1), 0.0)).gain == 0


def test_random_systems():
    """python-control's own bisection, or SLICOT's if it is installed, stops within about 1e-6."""
    rng = np.random.default_rng(1)
    for _ in range(60):
        n = int(rng.integers(1, 6))
        A = rng.normal(size=(n, n)) * 10 ** rng.uniform(-1, 2)
        A -= np.eye(n) * (np.linalg.eigvals(A).real.max() + 10 ** rng.uniform(-3, 1))
        system = StateSpace(A, rng.normal(size=n), rng.normal(size=n), float(rng.normal() * rng.integers(0, 2)))
        norm, _ = control.linfnorm(control.ss(A, system.B[:, None], system.C[None], system.D))
        assert peak_gain(system).gain == pytest.approx(norm, rel=3e-6)


def test_sensitivities_add_to_one():
    loop = TransferFunction([2.0, 3.0], [1.0, 1.0, 0.3]).realise()
    w = np.geomspace(0.01, 100, 30)
    S, T = sensitivity(loop).response(w), complementary_sensitivity(loop).response(w)
    np.testing.assert_allclose(S + T, 1.0, rtol=1e-12)
    np.testing.assert_allclose(S, 1 / (1 + loop.response(w)), rtol=1e-12)


def test_an_unstable_system_is_refused():
    assert "0.5" in refusal(lambda: peak_gain(TransferFunction([1.0], [1.0, -0.5]).realise()))
