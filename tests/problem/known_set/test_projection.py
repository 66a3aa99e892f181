from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barbalat.problem.known_set import Gain, ParameterBall, ParameterProduct, limit, project
from barbalat.problem.state_feedback import ParameterBox

REPRODUCIBLE = settings(max_examples=300, derandomize=True, database=None)
ALWAYS = 1e-9  # of quantities of order 1 to 1e3: products of a few random matrices, a few hundred roundings


@st.composite
def situations(draw):
    """(box, theta_hat, theta, rate, gain) with an estimate inside, on a face, on an edge or in a corner, a theta in the box, and
    a matrix gain."""
    n = draw(st.integers(1, 6))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    lower = random.uniform(-5, 5, n)
    upper = lower + random.choice([0.0, 1.0, 10.0], n)  # also boxes that are flat in a direction
    place = np.array(draw(st.lists(st.sampled_from(["lower", "inside", "upper"]), min_size=n, max_size=n)))
    theta_hat = np.where(place == "lower", lower, np.where(place == "upper", upper, random.uniform(lower, upper)))
    theta = random.uniform(lower, upper)
    root = random.normal(size=(n, n))
    gain = root @ root.T + 0.1 * np.eye(n)
    return ParameterBox(lower=lower, upper=upper), theta_hat, theta, random.normal(size=n) * 10, gain


def outward(rate, theta_hat, box):
    """The part of a rate that points out of the box."""
    return np.where(theta_hat >= box.upper, np.maximum(rate, 0), 0) + np.where(theta_hat <= box.lower, np.minimum(rate, 0), 0)


@REPRODUCIBLE
@given(situations())
def test_a_diagonal_gain(situation):
    """No component leaves the box, those inside are untouched, and V = |theta_tilde|^2/gamma does not grow by the projection."""
    box, theta_hat, theta, rate, _ = situation
    projected = project(rate, theta_hat, box)
    assert not outward(projected, theta_hat, box).any()
    free = outward(rate, theta_hat, box) == 0
    assert (projected[free] == rate[free]).all()
    assert (theta_hat - theta) @ (projected - rate) <= ALWAYS


@REPRODUCIBLE
@given(situations())
def test_a_matrix_gain(situation):
    """theta_tilde'P^-1 (projected - raw) <= 0, as required by the Lyapunov proof of (15)."""
    box, theta_hat, theta, rate, gain = situation
    projected = project(rate, theta_hat, box, Gain(gain))
    assert (theta_hat - theta) @ np.linalg.solve(gain, projected - rate) <= ALWAYS


@REPRODUCIBLE
@given(situations())
def test_up_to_four_parameters_also_in_a_corner(situation):
    """The limit's clipping is included. With two parameters it occurs only with an off-diagonal entry of the harmless sign, and
    with three and four parameters nothing remains to clip. With more parameters the clipped part is small, and the inequality is
    not claimed."""
    box, theta_hat, theta, rate, gain = situation
    projected = project(rate, theta_hat, box, Gain(gain))
    kept = np.where(theta_hat >= box.upper, np.minimum(projected, 0), projected)
    kept = np.where(theta_hat <= box.lower, np.maximum(kept, 0), kept)
    if len(rate) in (3, 4):
        assert np.abs(kept - projected).max() <= ALWAYS
    if len(rate) <= 4:
        assert (theta_hat - theta) @ np.linalg.solve(gain, kept - rate) <= ALWAYS


@REPRODUCIBLE
@given(situations())
def test_the_projection_against_the_quadratic_programme(situation):
    """The projected rate is the nearest admissible one in the metric of P^-1. It minimises |v - rate| over the v that stay
    inside.

    At the minimiser of a convex problem every admissible change increases the objective. The test is on one face for any number
    of parameters, and in corners for three and four.
    """
    box, theta_hat, _, rate, gain = situation
    side = np.where(theta_hat <= box.lower, -1.0, np.where(theta_hat >= box.upper, 1.0, 0.0))
    fixed = box.lower == box.upper
    if len(rate) not in (3, 4) and ((side != 0).sum() != 1 or fixed.any()):
        return
    projected = project(rate, theta_hat, box, Gain(gain))
    force = np.linalg.solve(gain, projected - rate)
    touching = (side != 0) & ~fixed
    assert (side * projected)[touching].max(initial=-1) <= ALWAYS  # admissible
    assert np.abs(projected[fixed]).max(initial=0) <= ALWAYS
    assert np.abs(force[side == 0]).max(initial=0) <= ALWAYS  # forces only from faces
    assert (side * force)[touching].max(initial=-1) <= ALWAYS  # a face only pushes inward
    assert np.abs((force * projected)[touching]).max(initial=0) <= 10 * ALWAYS  # and only an estimate that is on it


@pytest.mark.parametrize("n", [3, 4])
def test_ill_conditioned_gains_in_corners(n):
    """With eigenvalues over six decades, the remaining outward part is rounding of the largest term, in the metric's own
    scale."""
    random = np.random.default_rng(n)
    box, theta_hat = ParameterBox(lower=-np.ones(n), upper=np.ones(n)), np.ones(n)
    for _ in range(300):
        turned, _ = np.linalg.qr(random.normal(size=(n, n)))
        gain = turned @ np.diag(10 ** random.uniform(-6, 0, n)) @ turned.T
        scale = np.sqrt(np.diag(gain))
        rate = random.normal(size=n) * scale
        projected = project(rate, theta_hat, box, Gain(gain))
        # 1e-9: condition 1e6 of what is solved, a few roundings, and multipliers up to 1e6 times the rate
        assert (projected / scale).max() <= 1e-9 * np.abs(rate / scale).max() * 1e3
        assert (np.linalg.solve(gain, projected - rate) * scale).max() <= 1e-6 * np.abs(rate / scale).max()


@pytest.mark.parametrize("intervals", [False, True])
@pytest.mark.parametrize("n", [3, 4, 5])
def test_two_faces_among_more_parameters(n, intervals):
    """The last or first two of n parameters have bounds. V does not grow for any value of the others, and nothing is left to the
    limit, which would make V grow by an amount proportional to the error of the unbounded ones."""
    random = np.random.default_rng(n)
    far = np.full(n - 2, 1e200)
    two = ParameterBox(lower=[-1.0, -1.0], upper=[1.0, 1.0])
    whole = ParameterBox(lower=np.concatenate([[-1.0, -1.0], -far]), upper=np.concatenate([[1.0, 1.0], far]))
    chosen = ParameterProduct(None, two) if intervals else whole
    bounded = slice(n - 2, n) if intervals else slice(0, 2)
    for _ in range(300):
        theta_hat, theta = random.normal(size=n) * 5, random.normal(size=n) * 5
        theta_hat[bounded], theta[bounded] = random.choice([-1.0, 1.0], 2), random.uniform(-1, 1, 2)
        root, rate = random.normal(size=(n, n)), random.normal(size=n) * 10
        gain = root @ root.T + 0.1 * np.eye(n)
        projected = project(rate, theta_hat, chosen, Gain(gain))
        assert np.abs(outward(projected[bounded], theta_hat[bounded], two)).max() <= ALWAYS
        assert (theta_hat - theta) @ np.linalg.solve(gain, projected - rate) <= ALWAYS


@pytest.mark.parametrize("ball", [None, ParameterBall(center=[0.5, -0.5], radius=1.0)])
@pytest.mark.parametrize("kind", ["number", "diagonal", "matrix"])
def test_input_gains_beside_theta(ball, kind):
    """For any gain of the law, input gains at their bounds do not move outward, and neither does theta on its sphere.

    A scalar or diagonal gain does not couple the two, so each moves as it does alone.
    """
    random = np.random.default_rng(7)
    gains = ParameterBox(lower=[0.5, -2.0], upper=[3.0, -1.0])
    product = ParameterProduct(ball, gains)
    for _ in range(50):
        angle, rate = random.uniform(0, 2 * np.pi), random.normal(size=4)
        theta = np.array([0.5, -0.5]) + np.array([np.cos(angle), np.sin(angle)])
        theta_hat = np.concatenate([theta, random.choice([0.5, 2.0, 3.0], 1), random.choice([-2.0, -1.5, -1.0], 1)])
        root = random.normal(size=(4, 4))
        gain = {"number": 2.0, "diagonal": np.array([1.0, 2.0, 3.0, 4.0]), "matrix": root @ root.T + 0.1 * np.eye(4)}[kind]
        projected = project(rate, theta_hat, product, Gain(gain))
        if kind != "matrix":  # in a corner of two intervals a matrix leaves a part to the limit
            assert not outward(projected[2:], theta_hat[2:], gains).any()
            free = outward(rate[2:], theta_hat[2:], gains) == 0
            np.testing.assert_array_equal(projected[2:][free], rate[2:][free])
            own = gain if kind == "number" else gain[:2]
            np.testing.assert_array_equal(projected[:2], project(rate[:2], theta, ball, Gain(own)))
            if ball is not None:
                assert (theta - ball.center) @ projected[:2] <= ALWAYS
        inside = np.concatenate([ball.center if ball is not None else random.normal(size=2), gains.middle])
        assert (theta_hat - inside) @ np.linalg.solve(Gain(gain).as_matrix(4), projected - rate) <= ALWAYS


@REPRODUCIBLE
@given(situations(), st.integers(0, 2**32 - 1))
def test_a_march_never_leaves_the_box(situation, seed):
    """With random rates and a long step, theta_hat after the limit is exactly in the box."""
    box, theta_hat, _, _, gain = situation
    random = np.random.default_rng(seed)
    for _ in range(20):
        rate = 100 * random.normal(size=len(theta_hat))
        theta_hat = limit(theta_hat + 0.1 * project(gain @ rate, theta_hat, box, Gain(gain)), box)
        assert box.contains(theta_hat)
        theta_hat = limit(theta_hat + 0.1 * project(rate, theta_hat, box), box)
        assert box.contains(theta_hat)


def test_without_a_box_nothing_is_projected():
    rate, theta_hat = np.array([1.0, -2.0]), np.array([1e9, -1e9])
    assert project(rate, theta_hat, None) is rate
    assert project(rate, theta_hat, None, Gain(np.eye(2))) is rate
    assert limit(theta_hat, None) is theta_hat


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_bad_rate_inside_the_box_stays_visible(bad):
    box = ParameterBox(lower=[-1.0, -1.0], upper=[1.0, 1.0])
    rate = np.array([bad, 1.0])
    np.testing.assert_array_equal(project(rate, np.zeros(2), box), rate)
    with np.errstate(invalid="ignore"):  # inf - inf in between is not a fault
        assert not np.isfinite(project(rate, np.zeros(2), box, Gain(np.eye(2)))[0])


def test_a_bad_estimate_is_not_limited_to_a_good_one():
    box = ParameterBox(lower=[-1.0], upper=[1.0])
    assert np.isnan(limit(np.array([np.nan]), box)[0])
