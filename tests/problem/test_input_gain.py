"""The projection of the unknown input gain: a separate set in addition to a box, a ball or no known set of theta."""

from __future__ import annotations

from dataclasses import replace
from importlib import resources

import numpy as np
import pytest
from test_regressors import two_inputs

from barbalat.adaptation.laws.least_squares import LeastSquares
from barbalat.cases.load import parse_case
from barbalat.controllers import Mrac, RobustMrac, Sampled
from barbalat.problem.actuation import PlantInput
from barbalat.problem.known_set import Gain, ParameterBall, ParameterBox, limit, project, with_gains
from barbalat.run.engine.simulate import simulate
from barbalat.solvers.simulation import Simulation
from independent import refusal

BALL = ParameterBall(center=[0.5, -0.3], radius=0.6)  # the origin and theta are inside


@pytest.mark.parametrize("known_set", [BALL, None])
@pytest.mark.parametrize("projection", [None, False])
@pytest.mark.parametrize("gamma", [10.0, [10.0, 5.0, 20.0], [[10.0, 1.0, 2.0], [1.0, 8.0, -1.0], [2.0, -1.0, 9.0]]])
def test_the_gain_has_a_projection_of_its_own(problems, known_set, projection, gamma):
    """With a ball of theta and without a set, omega_hat stays in its interval, theta_hat in the ball, and V never grows.

    The tolerance 1e-9 of V(0) is for corners of a projection and stages of a step.
    """
    problem = replace(problems[2], plant=replace(problems[2].plant, input=PlantInput(gain=0.35)), uncertainty=known_set)
    problem = replace(problem, plant=replace(problem.plant, theta=[0.9, -0.5]), input_gain=(0.3, 2.0))
    controller = Mrac(gamma=gamma, projection=projection)
    run = simulate(problem, [controller], Simulation(t_end=20.0, dt=1e-3))["MRAC"]
    omega_hat, lowest = run.theta_hat[:, 2], run.envelope.theta_hat_min[:, 2]
    assert (lowest >= 0.3).all() and (lowest == 0.3).any() and omega_hat.max() <= 2.0
    away = np.linalg.norm(run.theta_hat[:, :2] - BALL.center, axis=1).max()
    assert away <= 0.6 if known_set is not None and projection is None else away > 0.6
    P, tilde = problem.known.P, run.theta_hat - problem.parameters
    inverse = np.linalg.inv(Gain(np.array(gamma) if np.ndim(gamma) else gamma).as_matrix(3))
    V = np.einsum("ki,ij,kj->k", run.e, P, run.e) + np.einsum("ki,ij,kj->k", tilde, inverse, tilde)
    assert (np.diff(V) <= 1e-9 * V[0]).all()
    assert run.adapting.on_bounds.most[2] > 0


@pytest.mark.parametrize("gain", [0.5, 1.5])
def test_projections_side_by_side_are_the_projections(gain):
    """With a scalar or diagonal gain the projection of the product consists of the projections of its factors, evaluated
    separately."""
    random = np.random.default_rng(3)
    intervals = ParameterBox(lower=[0.5, 1.0], upper=[2.0, 1.5])
    product = with_gains(BALL, intervals)
    diagonal = gain * random.uniform(0.5, 2.0, 4)
    for _ in range(200):
        outside = random.normal(size=4) * 3
        estimate = limit(outside, product)
        np.testing.assert_array_equal(estimate, [*limit(outside[:2], BALL), *limit(outside[2:], intervals)])
        assert product.contains(estimate)
        rate = random.normal(size=4)
        for Gamma in (gain, diagonal):
            own = (Gamma, Gamma) if np.ndim(Gamma) == 0 else (Gamma[:2], Gamma[2:])
            alone = [
                project(rate[:2], estimate[:2], BALL, Gain(own[0])),
                project(rate[2:], estimate[2:], intervals, Gain(own[1])),
            ]
            np.testing.assert_array_equal(project(rate, estimate, product, Gain(Gamma)), np.concatenate(alone))


def test_an_interval_for_each_input():
    """Each estimate starts in its interval and stays there. A single pair applies to both."""
    problem = two_inputs(input=[PlantInput(gain=0.6), PlantInput(gain=2.5)])
    apart = replace(problem, input_gain=((0.3, 0.8), (2.0, 4.0)))
    assert apart.known.gains.lower.tolist() == [0.3, 2.0] and apart.known.gains.upper.tolist() == [0.8, 4.0]
    run = simulate(apart, [Mrac(gamma=5.0)], Simulation(t_end=5.0, dt=1e-3))["MRAC"]
    assert run.theta_hat[0, -2:].tolist() == [0.8, 2.0]
    assert (run.envelope.theta_hat_min[:, -2:] >= [0.3, 2.0]).all() and (run.envelope.theta_hat_max[:, -2:] <= [0.8, 4.0]).all()
    once, twice = (replace(problem, input_gain=given).known.estimate_set for given in ((0.5, 3.0), ((0.5, 3.0), (0.5, 3.0))))
    np.testing.assert_array_equal(once.extent, twice.extent)


def test_a_case_with_nothing_but_the_gain_s_interval():
    text = resources.files("barbalat.cases.bundled").joinpath("first-order.toml").read_text()
    bare = text.replace("lower = [-10.0]\n", "").replace("upper = [10.0]\n", "")
    case = parse_case(bare)
    assert case.problem.uncertainty is None
    assert case.problem.known.gains.upper.tolist() == [5.0]
    several = parse_case(text.replace("input_gain = [0.5, 5.0]", "input_gain = [[0.5, 5.0]]"))
    assert several.problem.known.gains.lower.tolist() == [0.5]
    for run in simulate(case.problem, list(case.controllers), replace(case.simulation, t_end=10.0)).values():
        assert run.diverged_at is None and (run.theta_hat[:, 1] >= 0.5).all()


def test_what_does_not_go_together(problems):
    ball = replace(problems[2], uncertainty=BALL, input_gain=(0.3, 2.0)).known
    matrix = Mrac(gamma=np.diag([1.0, 2.0, 3.0]))
    assert "matrix" in refusal(lambda: Sampled(controller=matrix, sample_time=0.01).bind(ball))
    assert "ball" in refusal(lambda: Sampled(controller=Mrac(gamma=[1.0, 2.0, 3.0]), sample_time=0.01).bind(ball))
    assert "input gain" in refusal(lambda: RobustMrac(tau=0.2, law=LeastSquares(covariance0=1.0)).bind(ball))
    Sampled(controller=Mrac(gamma=1.0), sample_time=0.01).bind(ball)
