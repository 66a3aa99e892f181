"""Statements in the bundled cases' comments about their plants."""

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
    "mass-spring-damper": [-1.0, -1.0, -0.2 - 0.4j, -0.2 + 0.4j],
    "payload-drop": [0.0, 0.0],
    "paper": [-4.775, 0.775],
}


@pytest.mark.parametrize("case", STATED)
def test_the_modes_without_control(case):
    """The modes from unit impulses of the state with u = 0 agree with the comments to all stated digits."""
    plant = load_case(case).problem.plant
    A = np.column_stack([plant.derivative(e, np.zeros(plant.inputs) if plant.inputs > 1 else 0.0) for e in np.eye(plant.n)])
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(A).round(6)), STATED[case], atol=5e-3)


def test_the_wing_that_is_left_alone_diverges():
    plant = load_case("wing-rock").problem.plant
    path = solve_ivp(lambda t, x: plant.derivative(x, 0.0), (0, 12), plant.x0, rtol=1e-9)
    assert np.abs(path.y[0, -1]) > 10  # rad, from 0.2


def test_the_payload_that_falls_off():
    """Newton's law with the remaining mass, the thrust of hovering with the payload and g = 9.81 m/s^2 gives the case's d."""
    problem, with_payload, left = load_case("payload-drop").problem, 2.0, 1.5
    plant, thrust = problem.plant, with_payload * 9.81 + 0.7
    after = plant.derivative(np.array([0.3, -0.2]), plant.paths[0].gain * 0.7 + problem.disturbance(np.array(20.0)))
    np.testing.assert_allclose(after, [-0.2, thrust / left - 9.81], atol=1e-12)
    assert problem.disturbance(np.array(5.0)) == 0


def test_the_carts_follow_newton_s_law():
    """The matrices follow by hand from the springs and dampers between the walls and the carts."""
    plant = load_case("mass-spring-damper").problem.plant
    p_1, v_1, p_2, v_2, u_1, u_2 = 0.3, -0.2, 0.5, 0.7, 2.0, -1.0
    on_1 = -p_1 - v_1 + (p_2 - p_1) + (v_2 - v_1) + u_1
    on_2 = (p_1 - p_2) + (v_1 - v_2) - v_2 + u_2
    found = plant.derivative(np.array([p_1, v_1, p_2, v_2]), np.array([path.gain for path in plant.paths]) * [u_1, u_2])
    np.testing.assert_allclose(found, [v_1, on_1 / 5.0, v_2, on_2 / 1.0], atol=1e-12)
