"""Known sets: their largest distances against their corners, and against points drawn from them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from barbalat.problem.known_set import ParameterBall, ParameterBox


@pytest.mark.parametrize("n", [1, 2, 4])
def test_the_farthest_point_of_a_box_is_a_corner(n):
    random = np.random.default_rng(n)
    lower = random.uniform(-3, 1, n)
    box = ParameterBox(lower=lower, upper=lower + random.uniform(0.1, 3, n))
    corners = np.array(list(itertools.product(*zip(box.lower, box.upper, strict=True))))
    for theta in (np.zeros(n), *random.uniform(-4, 4, (10, n))):
        assert box.farthest(theta) == pytest.approx(np.linalg.norm(corners - theta, axis=1).max(), rel=1e-12)
        assert box.farthest_1(theta) == pytest.approx(np.abs(corners - theta).sum(axis=1).max(), rel=1e-12)


@pytest.mark.parametrize("n", [1, 2, 4])
def test_the_farthest_point_of_a_ball_is_on_its_surface(n):
    """No point is farther; in the Euclidean norm it lies beyond the centre, in the 1-norm where all components move alike."""
    random = np.random.default_rng(n)
    ball = ParameterBall(center=random.uniform(-2, 2, n), radius=random.uniform(0.1, 3))
    directions = random.normal(size=(2000, n))
    points = ball.center + ball.radius * directions / np.linalg.norm(directions, axis=1)[:, None]
    for theta in (np.zeros(n), *random.uniform(-4, 4, (10, n))):
        away = ball.center - theta
        attained = away + ball.radius * away / np.linalg.norm(away), away + ball.radius * np.sign(away) / np.sqrt(n)
        assert np.linalg.norm(points - theta, axis=1).max() <= ball.farthest(theta) * (1 + 1e-12)
        assert np.abs(points - theta).sum(axis=1).max() <= ball.farthest_1(theta) * (1 + 1e-12)
        assert ball.farthest(theta) == pytest.approx(np.linalg.norm(attained[0]), rel=1e-12)
        assert ball.farthest_1(theta) == pytest.approx(np.abs(attained[1]).sum(), rel=1e-12)


@pytest.mark.parametrize(
    ("known_set", "shares"),
    [
        (ParameterBox(lower=[-1.0, 2.0], upper=[3.0, 4.0]), lambda points: (points - [-1.0, 2.0]) / [4.0, 2.0]),
        (ParameterBall(center=[1.0, -2.0], radius=1.5), lambda points: ((points - [1.0, -2.0]) ** 2).sum(axis=1) / 1.5**2),
    ],
    ids=["box", "ball"],
)
def test_points_are_drawn_evenly(known_set, shares):
    """Each coordinate's share of a box, and the share of a disc's area within a point's radius, are uniform in [0, 1]."""
    points = known_set.drawn(np.random.default_rng(3), 4000)
    assert all(known_set.contains(point) for point in points)
    quarters = np.quantile(shares(points), [0.25, 0.5, 0.75], axis=0).T
    np.testing.assert_allclose(quarters, np.broadcast_to([0.25, 0.5, 0.75], quarters.shape), atol=0.03)  # 4 sigma of a quartile
