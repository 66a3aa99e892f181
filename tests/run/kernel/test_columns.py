"""Numbers of members that rarely differ from the first member's, compared with the list of all numbers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from barbalat.run.kernel.template import Columns, StructureError


class Pair(NamedTuple):
    number: float
    array: np.ndarray


@pytest.mark.parametrize("numbers", [[1.0] * 6, [1.0, 1.0, 2.0, 1.0, 3.0, 1.0], [1.0, 1.0, 1.0, 4.0], [0.0, -0.0, 5.0]])
def test_leaves_that_return_to_the_first_s_value(numbers):
    shared = np.array([7.0, 8.0])
    members = [Pair(value, shared if value == numbers[0] else np.array([7.0, value])) for value in numbers]
    columns = Columns(members[0])
    for member in members[1:]:
        columns.add(member)
    expected = np.array([[member.number, *member.array] for member in members]).T
    assert columns.everything().tobytes() == np.ascontiguousarray(expected).tobytes()
    differs, values = columns.differing()
    np.testing.assert_array_equal(differs, (expected != expected[:, :1]).any(axis=1))
    np.testing.assert_array_equal(values, expected[differs])


def test_other_shapes_and_kinds_are_another_structure():
    for other in (Pair(1.0, np.zeros(3)), Pair(1, np.zeros(2)), (1.0, np.zeros(2)), Pair(1.0, None)):
        columns = Columns(Pair(1.0, np.zeros(2)))
        with pytest.raises(StructureError):
            columns.add(other)


@pytest.mark.parametrize(
    ("first", "second", "same"),
    [
        ([0.0, 2.0], [1e-12, 2.0], True),
        ([1.0, 2.0], [1.0, 2.0 + 1e-12], True),
        ([1.0, 2.0], [1.0 + 1e-6, 2.0], False),
        ([1.0, np.inf], [5.0, np.inf], False),
        ([1.0, np.inf], [1.0, 3.0], False),
        ([1.0, 2.0], [1.0, np.nan], False),
        ([0.0, 0.0], [0.0, 1e-12], False),
    ],
)
def test_a_rounding_is_one_beside_the_largest_finite_number_of_its_array(first, second, same):
    columns = Columns(Pair(1.0, np.array(first)))
    columns.add(Pair(1.0, np.array(second)))
    none = np.zeros(3, dtype=bool)
    with pytest.raises(StructureError):
        columns.chosen(none)
    if same:
        assert columns.chosen(none, 1e-9).shape == (0, 2)
    else:
        with pytest.raises(StructureError):
            columns.chosen(none, 1e-9)
