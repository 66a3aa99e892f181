"""Brent's methods against SciPy's, and against exact zeros and minima."""

from __future__ import annotations

import math
import platform
from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

from barbalat.linear.brent import SMALLEST_RELATIVE, least_between, zero_between

FUSED = platform.machine().lower() not in ("x86_64", "amd64")
"""Whether SciPy's C code may contain fused multiply-adds, which change last bits."""


def _functions(rng: np.random.Generator) -> list[Callable[[float], float]]:
    """A polynomial with its only zero at p, a flat one, a steep one, one with a jump, and an oscillation."""
    p, q = rng.uniform(-0.9, 0.9), float(np.exp(rng.uniform(-5, 5)))
    return [
        lambda x: (x - p) * (1 + q * (x - p) ** 2),
        lambda x: (x - p) ** 3 * q,
        lambda x: math.atan(q * (x - p)) + 1e-3 * (x - p),
        lambda x: math.copysign(1 + q * abs(x), x - p),
        lambda x: math.sin(1 + q / 20 * (x + 1)) - math.sin(1) if q < 50 else x - p,
    ]


@pytest.mark.parametrize(("absolute", "relative"), [(1e-300, 1e-13), (1e-12, SMALLEST_RELATIVE), (1e-3, 1e-6)])
def test_same_zeros_as_scipy(absolute: float, relative: float) -> None:
    rng, compared = np.random.default_rng(3), 0
    for _ in range(300):
        for function in _functions(rng):
            left, right = sorted(rng.uniform(-1, 1, 2).tolist())
            if not function(left) * function(right) < 0:
                continue
            try:
                expected = brentq(function, left, right, xtol=absolute, rtol=relative)
            except RuntimeError:  # a threefold zero in too many steps
                with pytest.raises(ArithmeticError, match="not found in 100 steps"):
                    zero_between(function, left, right, absolute=absolute, relative=relative)
                continue
            found = zero_between(function, left, right, absolute=absolute, relative=relative)
            compared += 1
            if FUSED:  # both are within the tolerance of the zero
                assert abs(found - expected) <= 2 * (absolute + relative * abs(expected))
            else:
                assert found == expected
    assert compared > 300


def test_a_zero_at_an_end_is_returned() -> None:
    assert zero_between(lambda x: x, 0.0, 1.0, absolute=1e-12) == 0.0
    assert zero_between(lambda x: x - 1, 0.0, 1.0, absolute=1e-12) == 1.0


def test_neither_a_missing_change_of_sign_nor_nan_gives_a_number() -> None:
    with pytest.raises(ValueError, match="same sign at 1 and 2"):
        zero_between(lambda x: x, 1.0, 2.0, absolute=1e-12)
    with pytest.raises(ValueError, match="is NaN at"):
        zero_between(lambda x: x if abs(x) > 0.5 else math.nan, -1.0, 1.0, absolute=1e-12)


def test_the_zero_of_a_convergent_search_is_within_the_tolerance() -> None:
    assert zero_between(lambda x: x * x - 2, 0.0, 2.0, absolute=1e-300, relative=1e-15) == pytest.approx(math.sqrt(2), rel=2e-15)


@pytest.mark.parametrize("absolute", [1e-3, 1e-9])
def test_same_minima_as_scipy(absolute: float) -> None:
    rng = np.random.default_rng(5)
    for _ in range(300):
        for function in _functions(rng):
            left, right = sorted(rng.uniform(-1, 1, 2).tolist())
            for sought in (function, lambda x, of=function: abs(of(x)), lambda x, of=function: -(of(x) ** 2)):
                expected = minimize_scalar(sought, bounds=(left, right), method="bounded", options={"xatol": absolute})
                assert least_between(sought, left, right, absolute=absolute) == (expected.x, expected.fun)


def test_the_minimum_is_found() -> None:
    x, value = least_between(lambda x: 3 + (x - 0.25) ** 2, -1.0, 1.0, absolute=1e-9)
    assert x == pytest.approx(0.25, abs=1e-7)  # the square root of rounding
    assert value == pytest.approx(3)
