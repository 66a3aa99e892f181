"""Known sets: their largest distances, compared with their corners and with random points."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

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
    """No point is farther. In the Euclidean norm it is opposite to the centre, in the 1-norm where all components move
    equally."""
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
    """Each coordinate's relative position in a box, and the share of a disc's area that lies inside a point's radius, are
    uniformly distributed in [0, 1]."""
    points = known_set.drawn(np.random.default_rng(3), 4000)
    assert all(known_set.contains(point) for point in points)
    quarters = np.quantile(shares(points), [0.25, 0.5, 0.75], axis=0).T
    np.testing.assert_allclose(quarters, np.broadcast_to([0.25, 0.5, 0.75], quarters.shape), atol=0.03)  # 4 sigma of a quartile


@pytest.mark.parametrize("n", [1, 2, 4])
def test_a_box_is_within_a_bound_that_its_corners_keep(n):
    """The box is within the bound for either position of its larger side. One double below the farthest corner is too small."""
    random = np.random.default_rng(n)
    for _ in range(20):
        lower = random.uniform(-3, 1, n)
        box = ParameterBox(lower=lower, upper=lower + random.uniform(0.1, 4, n))
        corners = itertools.product(*zip(box.lower.tolist(), box.upper.tolist(), strict=True))
        squared = max(sum(Fraction(value) ** 2 for value in corner) for corner in corners)
        bound = math.sqrt(squared)
        above, below = (next(b for b in steps if keeps(Fraction(b) ** 2)) for steps, keeps in around(bound, squared))
        assert box.within(Fraction(above))
        assert not box.within(Fraction(below))


def around(bound, squared):
    """The doubles next to ``bound`` in both directions. The first one above the farthest corner satisfies the bound."""
    up, down = [bound], [bound]
    for _ in range(4):
        up.append(math.nextafter(up[-1], math.inf))
        down.append(math.nextafter(down[-1], 0))
    return (up, lambda b: b >= squared), (down, lambda b: b < squared)


@pytest.mark.parametrize(
    "known_set",
    [ParameterBox(lower=[-1.0, 2.0], upper=[3.0, 4.0]), ParameterBall(center=[1.0, -2.0], radius=1.5)],
    ids=["box", "ball"],
)
def test_points_outside_are_brought_to_the_nearest_of_the_set(known_set):
    """Points inside do not move. For a point outside, no other point of the set is nearer than the chosen one."""
    random = np.random.default_rng(5)
    points = random.uniform(-6, 6, (40, 2))
    brought, others = known_set.brought_in(points), known_set.drawn(random, 4000)
    for point, taken in zip(points, brought, strict=True):
        if known_set.contains(point):
            np.testing.assert_array_equal(taken, point)
            continue
        distance = np.linalg.norm(taken - point)
        assert known_set.contains(point + (taken - point) * (1 + 1e-9))
        assert distance <= np.linalg.norm(others - point, axis=1).min()
