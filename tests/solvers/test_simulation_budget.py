"""The numbers that a rejection for too many steps proposes."""

from __future__ import annotations

import pytest

from barbalat.solvers.simulation import _round_number


@pytest.mark.parametrize(
    ("most", "expected"), [(1, 1), (4, 2), (9, 5), (10, 10), (49, 20), (99, 50), (123456, 100000), (600000, 500000)]
)
def test_the_proposed_number_is_the_largest_round_one(most, expected):
    assert _round_number(most) == expected
