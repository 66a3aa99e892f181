"""Fractions of polynomials: exact values at points are within the bounds, and extremes at corners are attained."""

from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from barbalat.problem.laurent import products_of
from barbalat.problem.rational import Rational

FORMULAS = (
    "m*l/(m*l**2 + m*l*r)",
    "m*l/(m*l**2 + J) - 0.3*l",
    "(m + M)*g*l/(J*(m + M) + m*M*l**2) - g/l",
    "-K*K/(J*r) - K**2/(J*r + K*J)",
    "(m + l)**2/(m*l) - 1/(m/l + l/m)",
    "1/(1/m + 1/(l + J/m))**2",
    "m - m*l/(l + J)",
)


def exactly(text, point):
    """A formula's value in exact arithmetic. A float in the text has its value in double precision."""
    return eval(text.replace("0.3", "Fraction(0.3)"), {"Fraction": Fraction}, point)


@pytest.mark.parametrize("text", FORMULAS)
@pytest.mark.parametrize("spread", [0.0, 1e-12, 0.01, 0.5])
def test_exact_values_lie_within_the_bounds(text, spread):
    """No exact value is outside the bounds, not even by rounding, either at corners, where bounds are attained, or inside."""
    rng = np.random.default_rng(7)
    names = sorted({"m", "l", "r", "J", "M", "g", "K"} & set("".join(c if c.isalnum() else " " for c in text).split()))
    for _ in range(5):
        centre = 10 ** rng.uniform(-2, 2, len(names))
        low, high = (dict(zip(names, map(float, centre * (1 + sign * spread)), strict=True)) for sign in (-1, 1))
        lower, upper, _ = Rational.of(products_of(text)).bounds(low, high)
        corners = [dict(zip(names, one, strict=True)) for one in product(*((low[name], high[name]) for name in names))]
        inside = [
            {name: float(np.clip(rng.uniform(low[name], high[name]), low[name], high[name])) for name in names} for _ in range(30)
        ]
        values = [exactly(text, {name: Fraction(v) for name, v in point.items()}) for point in (*corners, *inside)]
        assert Fraction(lower) <= min(values) and max(values) <= Fraction(upper)
        if spread == 0.0:
            assert upper - lower <= 1e-11 * max(abs(upper), abs(lower))


def test_a_quantity_that_is_monotone_in_each_parameter_has_its_extremes_at_corners():
    """By hand, m l/(m l^2 + m l r) = 1/(l + r), although m and l occur several times. It also holds with m from 0."""
    rational = Rational.of(products_of("m*l/(m*l**2 + m*l*r)"))
    lower, upper, points = rational.bounds({"m": 0.0, "l": 0.2, "r": 0.1}, {"m": 2.0, "l": 0.4, "r": 0.3})
    assert (lower, upper) == pytest.approx((1 / 0.7, 1 / 0.3), rel=1e-12)
    assert [(one["l"], one["r"]) for one in points] == [(0.4, 0.3), (0.2, 0.1)]


def test_functions_of_parameters_are_bounded_as_a_whole():
    rational = Rational.of(products_of("sin(a)*m/(m*l + m)"))
    lower, upper, _ = rational.bounds({"a": 0.1, "m": 1.0, "l": 1.0}, {"a": 0.2, "m": 9.0, "l": 2.0})
    assert (lower, upper) == pytest.approx((np.sin(0.1) / 3, np.sin(0.2) / 2), rel=1e-6)


def test_what_cannot_be_bounded_is_unbounded():
    low, high = {"a": -1.0, "b": 0.0}, {"a": 1.0, "b": 1.0}
    assert Rational.of(products_of("1/(a + b)")).bounds(low, high)[:2] == (-np.inf, np.inf)
    tiny = {"a": 1e-150, "b": 1e-150}
    assert Rational.of(products_of("a*a/(a*a + b*b)")).bounds(tiny, {"a": 2e-150, "b": 2e-150})[:2] == (
        -np.inf,
        np.inf,
    )  # underflow
    assert Rational.of(products_of("1/(1 + " + "*".join(f"a_{i}" for i in range(14)) + ")")) is None  # 2^14 coefficients


def test_a_sum_that_underflows_on_the_way_is_unbounded():
    """In the product of 1e-200, 1e-150 and 1e240, the product of the first two is 0 in floats, but the product of all three is
    not."""
    rational = Rational.of(products_of("a*b*1e-200*c/(c*c + c*c)"))
    low, high = {"a": 1e-150, "b": 1e240, "c": 1e-110}, {"a": 4e-150, "b": 4e240, "c": 4e-110}
    assert rational is None or rational.bounds(low, high)[:2] == (-np.inf, np.inf)


@pytest.mark.parametrize("text", ["k**1500 - k**1400 + k", "k**1e300 + k - k*k", "(k + l)**1000000 + k - k*k"])
def test_large_powers_are_left_alone(text):
    assert Rational.of(products_of(text)) is None


def test_powers_of_large_ranges_are_unbounded():
    low, high = {"k": 1e160, "l": 1e160}, {"k": 2e160, "l": 2e160}
    assert Rational.of(products_of("k/(k + l) - l/(k + 2*l)")).bounds(low, high)[:2] == (-np.inf, np.inf)
