"""Zeros and minima between two points."""

from __future__ import annotations

import math

import pytest

from barbalat.linear.brent import least_between, zero_between


def test_a_zero_at_an_end_is_returned() -> None:
    assert zero_between(lambda x: x, 0.0, 1.0, absolute=1e-12) == 0.0
    assert zero_between(lambda x: x - 1, 0.0, 1.0, absolute=1e-12) == 1.0


def test_neither_a_missing_change_of_sign_nor_nan_gives_a_number() -> None:
    with pytest.raises(ValueError, match="different signs"):
        zero_between(lambda x: x, 1.0, 2.0, absolute=1e-12)
    with pytest.raises(ValueError, match="NaN"):
        zero_between(lambda x: x if abs(x) > 0.5 else math.nan, -1.0, 1.0, absolute=1e-12)


def test_the_zero_is_within_the_tolerance() -> None:
    assert zero_between(lambda x: x * x - 2, 0.0, 2.0, absolute=1e-300, relative=1e-15) == pytest.approx(math.sqrt(2), rel=2e-15)


def test_the_minimum_is_found() -> None:
    x, value = least_between(lambda x: 3 + (x - 0.25) ** 2, -1.0, 1.0, absolute=1e-9)
    assert x == pytest.approx(0.25, abs=1e-7)  # the square root of rounding
    assert value == pytest.approx(3)
