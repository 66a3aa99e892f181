"""The filter of two slopes: its order at zero frequency, and the effect on the error of the limit loop."""

import numpy as np
import pytest

from barbalat.linear.systems import input_filter, two_slopes


def test_one_slope_and_two():
    """Over a decade of frequency |1 - C| changes by a factor of 10 with (6) and of 100 with C'(0) = 0. Both have C(0) = 1."""
    w = np.array([1e-3, 1e-2])
    for C, decade in ((input_filter(0.02), 10.0), (two_slopes(0.05), 100.0)):
        response = np.ravel(C.realise().response(w))
        rest = np.abs(1 - response)
        assert rest[0] < 1e-4 and rest[1] / rest[0] == pytest.approx(decade, rel=1e-2)
        assert np.abs(np.ravel(C.realise().response(np.array([1e7])))) < 1e-4  # strictly proper


def test_a_second_slope_that_is_slow_leaves_the_filter_of_the_paper():
    w = np.geomspace(0.1, 1e3, 20)
    slow, plain = (np.ravel(C.realise().response(w)) for C in (two_slopes(0.02, 1e5), input_filter(0.02)))
    assert slow == pytest.approx(plain, rel=1e-2)
    first, second = 0.02, 0.02 * 7
    rest = first * second * (1j * w) ** 2 / ((1j * w * first + 1) * (1j * w * second + 1))
    assert 1 - np.ravel(two_slopes(first, 7.0).realise().response(w)) == pytest.approx(rest, rel=1e-6)
