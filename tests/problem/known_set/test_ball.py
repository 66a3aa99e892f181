"""Projection onto a ball, for scalar, diagonal and matrix gains."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from adaptation.examples import random_gain
from barbalat.problem.known_set import Gain, ParameterBall, limit, project

REPRODUCIBLE = settings(max_examples=300, derandomize=True, database=None)
ALWAYS = 1e-9  # of quantities of order 1 to 1e3


@st.composite
def situations(draw):
    """(random, ball, theta_hat on the sphere after the limit, theta in the ball, rate, gain)."""
    n = draw(st.integers(1, 5))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    ball = ParameterBall(center=random.normal(size=n) * random.choice([0.0, 1.0, 100.0]), radius=10 ** random.uniform(-2, 2))
    direction = random.normal(size=n)
    theta_hat = limit(ball.center + ball.radius * 10 ** random.uniform(0, 3) * direction / np.linalg.norm(direction), ball)
    inward = random.normal(size=n)
    theta = ball.center + ball.radius * random.uniform() * inward / np.linalg.norm(inward)
    gain = [random.uniform(0.1, 10), random.uniform(0.1, 10, n), random_gain(random, n)][draw(st.integers(0, 2))]
    return random, ball, theta_hat, theta, 10 * random.normal(size=n), gain


@REPRODUCIBLE
@given(situations())
def test_on_the_sphere(situation):
    """No projected rate points outward, an inward rate is unchanged, and the projection does not make V grow."""
    _, ball, theta_hat, theta, rate, gain = situation
    projected = project(rate, theta_hat, ball, Gain(gain))
    g = (theta_hat - ball.center) / ball.radius
    scale = np.abs(rate).max() * np.linalg.cond(Gain(gain).as_matrix(ball.size))
    assert g @ projected <= 1e-13 * scale
    if g @ rate <= 0:
        assert (projected == rate).all()
    change = np.linalg.solve(Gain(gain).as_matrix(ball.size), projected - rate)
    assert (theta_hat - theta) @ change <= ALWAYS * max(1, ball.radius)


@REPRODUCIBLE
@given(situations())
def test_the_nearest_admissible_rate(situation):
    """In the metric of Gamma^-1 the projected rate is the nearest one with g'v <= 0, as a solver for constrained problems
    confirms."""
    _, ball, theta_hat, _, rate, gain = situation
    g = theta_hat - ball.center
    if np.ndim(gain) < 2 or g @ rate <= 0 or ball.size > 3:
        return
    inverse = np.linalg.inv(gain)
    unit = g / np.linalg.norm(g)
    found = minimize(
        lambda v: (v - rate) @ inverse @ (v - rate),
        np.zeros(ball.size),
        jac=lambda v: 2 * inverse @ (v - rate),
        constraints={"type": "ineq", "fun": lambda v: -unit @ v, "jac": lambda v: -unit},
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    )
    projected = project(rate, theta_hat, ball, Gain(gain))
    ours, best = ((v - rate) @ inverse @ (v - rate) for v in (projected, found.x))
    assert ours <= best * (1 + 1e-6) + 1e-9  # SLSQP's own accuracy


@REPRODUCIBLE
@given(situations())
def test_a_march_never_leaves_the_ball_and_inside_nothing_changes(situation):
    random, ball, theta_hat, theta, _, gain = situation
    for _ in range(20):
        rate = Gain(gain).times(100 * random.normal(size=ball.size))
        theta_hat = limit(theta_hat + 0.1 * project(rate, theta_hat, ball, Gain(gain)), ball)
        assert ball.contains(theta_hat)
    inner = ball.center + 0.99 * (theta - ball.center)
    assert (limit(inner, ball) == inner).all()
    assert (project(rate, inner, ball, Gain(gain)) == rate).all()


@pytest.mark.parametrize(
    "gain", [2.0, np.array([0.3, 1.0, 4.0]), np.array([[3.0, 1.0, 0.5], [1.0, 2.0, -0.4], [0.5, -0.4, 1.0]])]
)
def test_ascent_of_a_linear_function_ends_at_its_maximiser(gain):
    """With theta_hat' = proj(Gamma v) the equilibrium is center + radius v/|v| in any metric, by the conditions of Karush, Kuhn
    and Tucker.

    With only a limit along the radius, without projection in the metric of Gamma^-1, the equilibrium would be elsewhere.
    """
    ball = ParameterBall(center=[1.0, -2.0, 0.5], radius=1.5)
    v = np.array([1.0, 2.0, -0.5])
    theta_hat = ball.center + np.array([0.1, 0.0, 0.2])
    for _ in range(20_000):
        theta_hat = limit(theta_hat + 3e-3 * project(Gain(gain).times(v), theta_hat, ball, Gain(gain)), ball)
        assert ball.contains(theta_hat)
    np.testing.assert_allclose(theta_hat, ball.center + 1.5 * v / np.linalg.norm(v), atol=1e-6)


def test_facts_about_a_ball():
    """theta_max, the farthest point and the extent are compared with sampled points of the sphere."""
    ball = ParameterBall(center=[1.0, -2.0, 0.0], radius=1.5)
    random = np.random.default_rng(1)
    directions = random.normal(size=(200_000, 3))
    points = ball.center + ball.radius * directions / np.linalg.norm(directions, axis=1)[:, None]
    start = np.array([0.3, 0.1, -0.2])
    for claimed, sampled in [
        (ball.theta_max, np.abs(points).sum(axis=1).max()),
        (ball.farthest(start), np.linalg.norm(points - start, axis=1).max()),
    ]:
        assert sampled <= claimed <= sampled * (1 + 1e-3)  # the densest sample misses the extremum by its angle squared
    np.testing.assert_allclose([points.min(axis=0), points.max(axis=0)], ball.extent, atol=1e-3)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_bad_estimate_stays_visible(bad):
    ball = ParameterBall(center=[0.0, 0.0], radius=1.0)
    with np.errstate(invalid="ignore"):  # inf/inf in between is not a fault
        assert np.isnan(limit(np.array([bad, 0.0]), ball)).any()
