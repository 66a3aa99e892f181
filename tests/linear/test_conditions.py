"""A matrix is tested for Hurwitz and controllability in any unit, also with numbers near the ends of a double's range."""

from __future__ import annotations

import numpy as np
import pytest

from barbalat.linear.conditions import require_controllable, require_hurwitz
from independent import refusal

A, B = np.array([[0.0, 1.0], [-6.5, -6.0]]), np.array([-1.0, 0.3])


@pytest.mark.parametrize("size", [1e-300, 1e-8, 1.0, 1e150, 1e307])
def test_units_change_no_verdict(size):
    require_controllable("(A, b)", A, size * B)
    require_controllable("(A, b)", size * A, B)
    require_hurwitz("A", size * A)
    assert "controllable" in refusal(lambda: require_controllable("(A, b)", np.diag([-1.0, -2.0]), size * np.array([1.0, 0.0])))
    assert "Hurwitz" in refusal(lambda: require_hurwitz("A", -size * A))


def test_columns_of_very_different_size():
    """With -1e308 and 0.3 in one column, the scales of the balancing used to overflow."""
    require_controllable("(A, b)", np.array([[0.0, 1.0], [-6.5, -6.08]]), np.array([-1e308, 0.34]))


def test_the_mode_is_named_in_its_own_unit():
    message = refusal(lambda: require_hurwitz("A", np.array([[3e200]])))
    assert "real part 3e+200" in message
