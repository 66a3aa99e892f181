"""The projected MRAC with a delay, integrated by plain loops, the exact scaling, the small-gain size, and Rohrs' frozen loop."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from barbalat.controllers import Mrac
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.robustness import unmodelled
from barbalat.papers.jafari_2013.section_v import figures, variant
from barbalat.problem.actuation import PlantInput
from barbalat.signals import Sine

A_M, B = np.array([[0.0, 1.0], [-0.3, -1.0]]), np.array([0.0, 1.0])
H = 5e-3


def by_loops(theta: np.ndarray, gamma: float, delay: float, t_end: float) -> np.ndarray:
    """|e|_inf at every step of Heun's method for (3)-(4) with its box and u(t - delay). It stops above 1e9."""
    Pb = np.array([1 / 0.6, (1 + 2 / 0.6) / 2])  # the second column of P, by hand
    x, x_m, theta_hat = np.ones(2), np.ones(2), np.zeros(2)
    past, found = [0.0] * round(delay / H), []
    for k in range(round(t_end / H)):
        r = [50 * np.sin(0.5 * H * (k + i)) for i in (0, 1)]
        past.append(-theta_hat @ x + 4 * r[0])
        v = past[k], past[k + 1]

        def rates(x, x_m, i, v=v, r=r):
            e = x - x_m
            return A_M @ x + B * (theta @ x + v[i]), A_M @ x_m + B * 4 * r[i], gamma * (e @ Pb) * x

        first = rates(x, x_m, 0)
        second = rates(x + H * first[0], x_m + H * first[1], 1)
        x, x_m = (a + H / 2 * (f + s) for a, f, s in zip((x, x_m), first, second, strict=False))
        theta_hat = np.clip(theta_hat + H / 2 * (first[2] + second[2]), -5, 5)
        found.append(np.abs(x - x_m).max())
        if found[-1] > 1e9:
            break
    return np.array(found)


@pytest.mark.parametrize("delay, grows", [(0.222, False), (0.548, True)])
def test_without_end_is_so_by_other_code_too(delay, grows):
    """theta = 0, so u = k_0 r alone tolerates any delay. The delays are on both sides of the first one at which the loop is
    lost."""
    members = [((0.0, 0.0), 1.0, delay)]
    (lost,), _ = unmodelled.lost(members, "MRAC (3)-(4)")
    e = by_loops(np.zeros(2), 1.0, delay, 80.0)
    assert bool(lost) == grows == bool(e[-1] > 1e6)
    assert grows or e[len(e) // 2 :].max() < 3 * e[: len(e) // 2].max()


def test_gamma_over_c_squared_is_the_same_motion_c_times_as_large():
    """With c a power of two it holds bit for bit, except for the order of roundings in the law."""
    c, gamma, delay = 4.0, 16.0, PlantInput(delay=0.1)
    given = variant(input=delay)
    scaled = replace(variant(input=delay, reference=Sine(50.0 * c, 0.5)), plant=replace(given.plant, x0=c * given.plant.x0))
    one, other = (figures([(problem, Mrac(gamma=g))], 20.0, 1e-3) for problem, g in ((given, gamma), (scaled, gamma / c**2)))
    np.testing.assert_allclose(other.max_abs_e, c * one.max_abs_e, rtol=1e-12)
    np.testing.assert_allclose(other.theta_hat_final, one.theta_hat_final, rtol=1e-12)


def test_the_size_that_small_gain_tolerates():
    """Both norms are computed by trapezoids. At this size the gain is one."""
    h, states, state = 1e-3, [], B
    step = expm(A_M * h)
    for _ in range(60_000):
        states.append(state)
        state = step @ state
    W_b = np.array(states)
    plain = np.trapezoid(np.abs(W_b), dx=h, axis=0).max()
    derivative = (np.abs(B) + np.trapezoid(np.abs(W_b @ A_M.T), dx=h, axis=0)).max()
    size = unmodelled.certain_size(None)
    assert 4 * size * plain + 2 * size * unmodelled.PROVEN_DELAY * derivative == pytest.approx(1, rel=1e-4)
    assert unmodelled.certain_size(section_v.KAPPA) < size


def test_rohrs_frozen_loop():
    """By Routh's criterion s^3 + 31 s^2 + 259 s + 229 + 458 k is stable up to 31 x 259 = 229 + 458 k."""
    assert unmodelled.largest_gain(None) == pytest.approx((31 * 259 - 229) / 458, rel=1e-8)
    assert unmodelled.largest_gain(0.02) < unmodelled.largest_gain(None)


def test_rohrs_plant_is_his():
    """The plant is 2/(s + 1) 229/(s^2 + 30 s + 229), and the model is 3/(s + 3)."""
    plant = unmodelled.problem(20.0, Sine(1.0, 1.0)).plant
    assert plant.A_m[0, 0] + plant.b[0] * plant.theta[0] == -1.0
    assert plant.b[0] * plant.paths[0].dynamics.dc_gain == pytest.approx(2.0)
    np.testing.assert_allclose(np.polymul([1, 1], unmodelled.UNMODELLED.den), [1, 31, 259, 229])
