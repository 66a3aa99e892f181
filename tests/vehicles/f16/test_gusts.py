"""Dryden's vertical gusts, compared with their known correlation."""

import numpy as np
import pytest

from barbalat.vehicles.f16.flying import TURBULENCE_LENGTH, gusts_met


def test_they_have_drydens_correlation():
    """R(s) = deviation^2 (1 - s/(2 tau)) e^(-s/tau) with tau = 1 s. Of 40,000 samples about 10,000 are independent."""
    w = gusts_met(3.0, TURBULENCE_LENGTH, 0.5, 40_000)
    for lag in range(5):
        s = 0.5 * lag
        found = float(np.mean(w[: len(w) - lag] * w[lag:])) / 9
        assert found == pytest.approx((1 - s / 2) * np.exp(-s), abs=0.04)  # four deviations of a mean of this many values


def test_their_first_samples_are_as_large_as_any():
    """The gusts are stationary from the start, by statistics over seeds and not over time."""
    first = [gusts_met(2.0, TURBULENCE_LENGTH, 0.01, 1, seed)[0] for seed in range(1000)]
    assert np.std(first) == pytest.approx(2.0, rel=0.1)  # four deviations of an estimate from 1000


def test_a_seed_draws_the_same_again():
    np.testing.assert_array_equal(gusts_met(1.0, 500.0, 0.01, 100), gusts_met(1.0, 500.0, 0.01, 100))
    assert (gusts_met(0.0, 500.0, 0.01, 100) == 0).all()
