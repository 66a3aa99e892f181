"""Numbers of members that differ from the first only now and then, against the list of them all."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from barbalat.run.columns import Columns, StructureError


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
