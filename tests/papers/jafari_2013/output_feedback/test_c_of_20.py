"""Condition (20) over a set, compared with the loop of the plant and C/((1 - C) G_m) in state space and with a quadrature."""

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.signal import impulse, tf2ss

from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.output_feedback import c_of_20


def loop_is_stable(C, G) -> bool:
    """Whether the negative feedback loop of G and K = C/((1 - C) G_m), each realised separately, is stable."""
    K = tf2ss(np.polymul(C.num, [1 / c_of_20.M, 1.0]), np.polysub(C.den, C.num))
    plant = tf2ss(G.num, G.den)
    A = block_diag(plant[0], K[0])
    B, out, D = block_diag(plant[1], K[1]), block_diag(plant[2], K[2]), block_diag(plant[3], K[3])
    feedback = np.array(
        [[0.0, 1.0], [-1.0, 0.0]]
    )  # the input of the plant is the output of K, and the input of K is minus the output of the plant
    closed = A + B @ feedback @ np.linalg.solve(np.eye(2) - D @ feedback, out)
    return bool(np.linalg.eigvals(closed).real.max() < 0)


@pytest.mark.parametrize("form", c_of_20.FORMS)
@pytest.mark.parametrize("w", [1.0, 10.0, 100.0])
def test_h_is_stable_where_the_loop_with_one_fixed_controller_is(form, w):
    C, family = c_of_20.FORMS[form](w), c_of_20.plants()
    assert c_of_20.stabilised(C, family) == sum(loop_is_stable(C, G) for G in family)


def test_the_plants_are_section_vs():
    plant, places = section_v.problem().plant, [(a, b) for a in c_of_20.GRID for b in c_of_20.GRID]
    for theta, G in zip(places, c_of_20.plants(), strict=True):
        poles = np.linalg.eigvals(plant.A_m + np.outer(plant.b, theta))
        np.testing.assert_allclose(np.sort_complex(G.poles), np.sort_complex(poles), atol=1e-9)


def test_the_filters_have_a_unit_dc_gain_and_are_strictly_proper():
    for form in c_of_20.FORMS.values():
        C = form(7.0)
        assert C.num[-1] == C.den[-1] and len(C.num) < len(C.den)


def test_the_norm_is_that_of_a_quadrature():
    """The norm is the norm for the worst plant of the set, with the lead at 10 rad/s, from 20 000 samples of the impulse
    response."""
    C, family = c_of_20.with_lead(10.0), c_of_20.plants()
    t, worst = np.linspace(0, 30, 20_001), 0.0
    for G in family:
        num = c_of_20.M * np.polymul(G.num, np.polysub(C.den, C.num))
        den = np.polyadd(
            np.polymul(np.polymul(C.num, G.num), [1.0, c_of_20.M]), c_of_20.M * np.polymul(np.polysub(C.den, C.num), G.den)
        )
        worst = max(worst, float(np.trapezoid(np.abs(impulse((num, den), T=t)[1]), t)))
    assert c_of_20.largest_norm(C, family) == pytest.approx(c_of_20.LIPSCHITZ * worst, rel=1e-3)
