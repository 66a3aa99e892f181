"""Sliders that must not be moved together, for functions with a known answer and for a case with two inputs."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from barbalat.cases.load import CaseText
from barbalat.explorer.describe import Described
from barbalat.explorer.sliders import Outcome, Together
from barbalat.explorer.source import TextSource

MOVED = {0: 2.0, 1: -3.0}
"""The tried values. A function's number is not moved if it is 0."""


def found(function, count: int, kinds=None, allowed=lambda x: True) -> tuple[set[tuple[int, int]], set[int], int]:
    """The pairs kept apart, the numbers dropped, and the number of settings tried."""
    base, tried = np.zeros(count), []

    def outcome(moves) -> Outcome:
        tried.append(moves)
        x, composed = base.copy(), np.array(function(base), dtype=float)
        for k, i in moves:
            x[k] = MOVED[i]
            alone = base.copy()
            alone[k] = MOVED[i]
            made = np.array(function(alone), dtype=float)
            composed[made != function(base)] = made[made != function(base)]
        if not allowed(x):
            return Outcome.NO_CASE
        return Outcome.FITS if (composed == function(x)).all() else Outcome.DIFFERS

    search = Together(kinds or range(count), np.zeros((count, count), dtype=bool), outcome)
    search.search(list(product(range(count), MOVED)), everywhere=True)
    return {(i, j) for i, j in np.argwhere(search.apart).tolist() if i < j}, search.dropped, len(tried)


def test_products_with_a_zero_are_found_among_forty_numbers() -> None:
    """None of these rows changes if one number is moved alone. Some dozens of settings cover 3000 pairs of values."""
    pairs = {(0, 7), (3, 39), (12, 13), (20, 31), (7, 20)}
    apart, dropped, settings = found(lambda x: np.array([*x, *(x[i] * x[j] for i, j in pairs)]), 40)
    assert apart == pairs
    assert not dropped
    assert settings < 150


def test_what_takes_three_numbers_keeps_any_two_of_them_apart() -> None:
    apart, _, _ = found(lambda x: np.array([*x, x[1] * x[4] * x[6]]), 9)
    assert apart == {(1, 4), (1, 6), (4, 6)}


def test_only_one_combination_of_values_is_enough() -> None:
    apart, _, _ = found(lambda x: np.array([*x, max(x[2], 0.0) * min(x[5], 0.0)]), 12)
    assert apart == {(2, 5)}


def test_an_entry_stands_for_its_matrix() -> None:
    apart, _, _ = found(lambda x: np.array([*x, x[0] * x[2]]), 5, kinds=["A", "A", "b", "b", "gamma"])
    assert apart == {(0, 2), (0, 3), (1, 2), (1, 3)}


def test_settings_that_make_no_case_hide_nothing() -> None:
    """Bounds that cross at some values do not exclude the others. Two numbers that never make a valid case are kept apart."""
    apart, _, _ = found(lambda x: np.array([*x, x[0] * x[1]]), 8, allowed=lambda x: x[2] <= x[3] + 4 and not (x[5] and x[6]))
    assert apart == {(0, 1), (5, 6)}


SPIN = """name = "Satellite spin"
[plant]
A = [[0.0, 10.0], [-10.0, -5.0]]
b = [[1.0, 0.0], [0.0, 1.0]]
[reference_model]
A_m = [[-5.0, 0.0], [0.0, -5.0]]
k_0 = [[5.0, 0.0], [0.0, 5.0]]
[[reference]]
kind = "sine"
amplitude = 1.0
frequency = 2.0
[[reference]]
kind = "sine"
amplitude = 1.0
frequency = 2.0
[uncertainty]
lower = [[0.0, -15.0], [0.0, -5.0]]
upper = [[10.0, 0.0], [15.0, 5.0]]
[simulation]
t_end = 1.0
dt = 1e-3
[[controller]]
scheme = "mrac"
gamma = 100.0
"""


@pytest.fixture(scope="module")
def spin() -> dict[str, set[str]]:
    sliders = Described.of(TextSource(CaseText(SPIN))).sliders
    return {
        str(one.number.path): {str(other.number.path) for other in sliders if other is not one and one.excludes(other)}
        for one in sliders
    }


def test_theta_follows_from_A_and_b_where_b_alone_leaves_its_zero(spin) -> None:
    """The last entry of theta' = (A - A_m) / b is 0 for every b, but not for A = -7."""
    assert "plant.b[1][1]" in spin["plant.A[1][1]"]
    assert "plant.A[1][1]" in spin["plant.b[1][1]"]
    assert not spin["controller[0].gamma"]


def test_bits_that_differ_at_some_values_only_are_no_surprise(spin) -> None:
    """A is multiplied and divided by the largest entry of b to compute theta, which sometimes changes the last bit."""
    assert "plant.b[1][1]" in spin["plant.A[0][1]"]
