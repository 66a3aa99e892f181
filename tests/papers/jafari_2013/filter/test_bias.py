"""The filter's error under a sine is |W_b (1 - C) ...| and not a constant. For a constant command it vanishes."""

import numpy as np
import pytest

from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.filter import bias
from barbalat.papers.jafari_2013.robustness import robustness


@pytest.fixture(scope="module")
def claim():
    return bias.bias_is_proportional()


def test_an_error_that_is_proportional_and_no_constant_bias(claim):
    assert claim.finding == "mixed"
    assert [reading.holds for reading in claim.readings if reading.literal] == [True, False, True]


def test_twice_is_twice_to_within_a_tenth():
    assert list(bias.doubles(np.array([4.39, 2.0, 1.0]))) == [True, True]
    assert list(bias.doubles(np.array([4.41, 2.0, 1.0]))) == [False, True]


def test_the_exponents_are_those_of_the_loop_with_theta_known(claim):
    """With theta_hat = theta the error is (G_C - W_m) r, in closed form at the command's frequency and without adaptation."""
    plant = section_v.problem().plant
    s, k_0 = 0.5j, section_v.problem().known.k_0

    def error(kappa: float) -> float:
        C = 1 / (kappa * s + 1)
        loop = s * np.eye(2) - plant.A_m - np.outer(plant.b, plant.theta) * (1 - C)
        filtered = np.linalg.solve(loop, plant.b * C * k_0 * 50)
        ideal = np.linalg.solve(s * np.eye(2) - plant.A_m, plant.b * k_0 * 50)
        return abs(filtered[0] - ideal[0])

    (shown,) = claim.listings
    for kappa, tail, exponent in shown.rows:
        assert float(tail) == pytest.approx(error(float(kappa)), rel=0.02)
        if exponent != "-":
            assert float(exponent) == pytest.approx(np.log2(error(2 * float(kappa)) / error(float(kappa))), abs=0.02)


def test_the_error_is_at_most_proportional_to_tau_up_to_figure_2s():
    """The error is proportional to tau only below 0.1 s, and the row says so."""
    claim = robustness.tau_and_error()
    assert [reading.holds for reading in claim.readings] == [True, True]
    (shown,) = claim.listings
    assert shown.rows[0][0] == "0.5" and float(shown.rows[1][3]) == pytest.approx(0.915, abs=0.01)
    assert "22.8 at 0.1 s" in claim.shows and "0.915 up to 0.5 s" in claim.measured
