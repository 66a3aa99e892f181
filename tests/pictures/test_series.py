"""A picture of a series shows nothing that the series does not do, and loses nothing visible."""

import numpy as np
import pytest

from barbalat.pictures.series import COLUMNS_PER_INCH, FASTEST_SWING_COLUMNS, outline, turning_points

INCHES = 4.0
COLUMNS = INCHES * COLUMNS_PER_INCH


def of(t, value, low=None, high=None):
    return outline(t, value, low, high, inches=INCHES)


@pytest.mark.parametrize("periods", [0.3, 1, 7, 25])
def test_a_slow_sine_is_a_line_that_stays_on_it(periods):
    t = np.linspace(0, 1, 4001)
    value = np.sin(2 * np.pi * periods * t)
    found = of(t, value)
    assert found.envelopes == ()
    steepest = 2 * np.pi * periods
    assert np.abs(np.interp(t, *found.line) - value).max() < 0.01 + steepest / COLUMNS / 2  # half a column aside


def test_a_fast_sine_on_a_slope_is_an_envelope_that_follows_the_slope():
    """For x = 3 t + sin the upper and lower envelopes are 3 t + 1 and 3 t - 1. The line is in their middle, without a gap."""
    t = np.linspace(0, 1, 20001)
    found = of(t, 3 * t + np.sin(2 * np.pi * 300 * t))
    (band,) = found.envelopes
    inside = (band[0] > 0.05) & (band[0] < 0.95)
    np.testing.assert_allclose(band[2][inside], 3 * band[0][inside] + 1, atol=0.05)
    np.testing.assert_allclose(band[1][inside], 3 * band[0][inside] - 1, atol=0.05)
    assert band[0, 0] < 0.02 and band[0, -1] > 0.98
    assert np.diff(found.line[0]).max() < 0.05
    assert np.isfinite(found.line).all()


def test_what_happens_between_the_instants_is_seen_by_the_extrema_alone():
    t = np.linspace(0, 1, 1001)
    zeros = np.zeros(1001)
    found = of(t, zeros, -np.ones(1000), np.ones(1000))
    (band,) = found.envelopes
    assert band[1].max() == -1 and band[2].min() == 1


def test_an_envelope_never_leaves_the_values():
    rng = np.random.default_rng(1)
    t = np.linspace(0, 1, 5001)
    value = np.clip(3 * rng.standard_normal(5001), -1, 1)
    for band in of(t, value).envelopes:
        assert band[1].min() >= value.min() and band[2].max() <= value.max()
        assert (band[1] <= band[2]).all()


def test_a_spike_is_a_line_and_keeps_its_height():
    t = np.linspace(0, 1, 5001)
    value = np.where(np.arange(5001) == 2345, 7.0, 0.0)
    found = of(t, value)
    assert found.envelopes == ()
    assert found.line[1].max() == 7.0


def test_few_instants_and_a_constant():
    assert of(np.zeros(1), np.ones(1)).line.tolist() == [[0.0], [1.0]]
    found = of(np.linspace(0, 1, 50), np.full(50, 3.0))
    assert found.envelopes == () and (found.line[1] == 3).all()


def test_how_fast_is_too_fast():
    """The limit is an oscillation of FASTEST_SWING_COLUMNS columns."""
    t = np.linspace(0, 1, 40001)
    for factor, enveloped in ((1.3, False), (0.8, True)):
        half_period = factor * FASTEST_SWING_COLUMNS / COLUMNS
        assert bool(of(t, np.sin(np.pi * t / half_period)).envelopes) == enveloped


def test_turning_points_of_a_known_path():
    assert turning_points(np.array([0.0, 1.0, 0.95, 1.2, 0.0, 0.5]), 0.1).tolist() == [3, 4, 5]


@pytest.mark.parametrize(("lasts", "enveloped"), [(0.1, False), (0.5, True)])
def test_a_burst_too_short_to_have_a_shape_is_a_line(lasts, enveloped):
    """A slow wave has a fast oscillation for a while. A box would hide the wave under it."""
    t = np.linspace(0, 1, 20001)
    value = np.sin(2 * np.pi * 3 * t) + np.where(t < lasts, 0.3 * np.sin(2 * np.pi * 400 * t), 0)
    found = of(t, value)
    assert bool(found.envelopes) == enveloped
    if not enveloped:
        assert np.abs(np.interp(t[t > lasts], *found.line) - value[t > lasts]).max() < 0.1
        slow = np.sin(2 * np.pi * 3 * found.line[0])
        assert np.abs(found.line[1] - slow).max() < 0.4
