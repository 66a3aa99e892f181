"""What the bundled cases' comments say of their plants."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from barbalat.cases.load import load_case

STATED = {
    "f16-short-period": [-1.911, -0.185],
    "lateral-aircraft": [-3.62, -0.423 - 3.06j, -0.423 + 3.06j, -0.016],
    "third-order": [-2.549 - 1.858j, -2.549 + 1.858j, -0.402],
    "first-order": [1.0],
    "astrom-wittenmark": [-1.0],
    "satellite-spin": [-2.5 - 9.682j, -2.5 + 9.682j],
    "paper": [-4.775, 0.775],
}


@pytest.mark.parametrize("case", STATED)
def test_the_modes_without_control(case):
    """From unit impulses of the state, with u = 0; to the digits that are written down."""
    plant = load_case(case).problem.plant
    A = np.column_stack([plant.derivative(e, np.zeros(plant.inputs) if plant.inputs > 1 else 0.0) for e in np.eye(plant.n)])
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(A)), STATED[case], atol=5e-3)


def test_the_wing_that_is_left_alone_diverges():
    plant = load_case("wing-rock").problem.plant
    path = solve_ivp(lambda t, x: plant.derivative(x, 0.0), (0, 12), plant.x0, rtol=1e-9)
    assert np.abs(path.y[0, -1]) > 10  # rad, from 0.2
