"""The filter of two slopes: its order at zero frequency, and what that does to the error of the limit loop."""

import numpy as np
import pytest

from barbalat.linear.systems import input_filter
from barbalat.papers.jafari_2013.linear.linear_design import second_order_filter


def test_one_slope_and_two():
    """|1 - C| over a decade of frequency falls by 10 with (6) and by 100 with C'(0) = 0, and C(0) = 1 in both."""
    w = np.array([1e-3, 1e-2])
    for C, decade in ((input_filter(0.02), 10.0), (second_order_filter(0.05), 100.0)):
        response = np.ravel(C.realise().response(w))
        rest = np.abs(1 - response)
        assert rest[0] < 1e-4 and rest[1] / rest[0] == pytest.approx(decade, rel=1e-2)
        assert np.abs(np.ravel(C.realise().response(np.array([1e7])))) < 1e-4  # strictly proper
