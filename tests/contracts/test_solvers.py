"""The contract of every registered solver. tests/solvers covers the mathematics of the methods."""

from __future__ import annotations

import numpy as np
import pytest

from barbalat.controllers import L1Adaptive
from barbalat.linear.systems import input_filter
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.state_feedback import ParameterBox, Problem
from barbalat.run.engine.simulate import simulate
from barbalat.solvers import SOLVERS
from barbalat.solvers.simulation import Simulation
from independent import brute_force


@pytest.fixture(params=SOLVERS)
def solver(request):
    return SOLVERS[request.param]


def test_the_registry_uses_the_name(solver):
    assert SOLVERS[solver.name] is solver


def test_it_is_explicit(solver):
    """Row i of a has i entries, so a stage uses only earlier ones."""
    assert [len(row) for row in solver.a] == list(range(len(solver.b)))
    assert len(solver.c) == len(solver.b)
    assert solver.c[0] == 0


def test_it_is_frozen_and_can_be_a_key(solver):
    with pytest.raises(AttributeError):
        solver.order = 9
    assert {solver: 1}[solver] == 1


def test_a_polynomial_of_its_degree_is_integrated_exactly(solver):
    """For x' = t^(p-1) a method of order p gives t^p/p up to rounding."""
    h, x = 0.5, 0.0
    for k in range(4):
        signals = {node: np.float64((k + node) * h) ** (solver.order - 1) for node in solver.nodes}
        x = solver.advance(lambda _, s: s, lambda y: y, x, signals, h)
    assert x == pytest.approx(2.0**solver.order / solver.order, rel=1e-15)


def test_the_limit_acts_on_every_stage(solver):
    """The limit is applied before each evaluation of the derivative and to the result: docs/equations.md, section 2."""
    asked = []

    def derivative(y, _):
        asked.append(float(y))
        return 1000.0

    result = solver.advance(derivative, lambda y: np.minimum(y, 1.0), 0.5, dict.fromkeys(solver.nodes, 0.0), 0.1)
    assert result == 1.0
    assert max(asked) <= 1.0
    assert len(asked) == len(solver.b)


def test_high_gain_stays_bounded_through_the_limit(section_v, solver):
    """In Fig. 3's setting at ten times its step, the estimate saturates at the box, and nothing becomes NaN."""
    controller = L1Adaptive(gamma=1e4, filter=input_filter(0.02))
    result = simulate(section_v, [controller], Simulation(t_end=10.0, dt=1e-3, solver=solver))["L1"]
    assert result.diverged_at is None
    assert np.abs(result.theta_hat).max() == 5.0


def test_through_the_projection_as_plain_stepping(problems, solver):
    """The box excludes theta_1 = 1, so the estimate is on a face part of the time, at a gain without numerical chaos.

    The tolerance 1e-10 is for roundings of states of order 1 in 1500 steps, without amplification.
    """
    given = problems[2]
    problem = Problem(
        plant=given.plant,
        reference_model=given.reference_model,
        reference=given.reference,
        uncertainty=ParameterBox(lower=[-0.8, -0.8], upper=[0.8, 0.8]),
    )
    controller = L1Adaptive(gamma=20.0, filter=input_filter(0.05))
    dt, steps = 2.0**-7, 1500
    samples = brute_force(ClosedLoop.of(problem, controller), problem.signals, solver.name, dt, steps)
    result = simulate(problem, [controller], Simulation(t_end=steps * dt, dt=dt, solver=solver, record_points=steps))["L1"]
    resting = (np.abs(samples.theta_hat) == 0.8).any(axis=1).mean()
    assert 0.1 < resting < 0.9
    np.testing.assert_allclose(result.theta_hat, samples.theta_hat, rtol=0, atol=1e-10)
    np.testing.assert_allclose(result.x, samples.states[:, :2], rtol=0, atol=1e-10)


def test_the_region_of_stability_is_left_once_along_a_ray_into_the_left_half_plane(solver):
    """The search for the largest step relies on this property for its bisection. The tolerance 1e-13 is for roundings of the
    growth at the start of a ray."""
    for angle in np.linspace(np.pi / 2 + 1e-6, np.pi, 500):
        outside = solver.growth(np.geomspace(1e-4, 2 * solver.reach, 2000) * np.exp(1j * angle)) > 1e-13
        assert (np.diff(outside.astype(int)) >= 0).all()


def test_growth_is_the_amplification_less_one(solver):
    z = np.array([0.3 - 0.2j, -1.0 + 2.0j, 5j, -40.0])
    np.testing.assert_allclose(solver.growth(z), np.abs(solver.amplification(z)) ** 2 - 1, rtol=1e-12)
    assert solver.growth(np.array([-1e-20]))[0] == pytest.approx(-2e-20, rel=1e-12)  # lost without this care
    assert solver.reach > max(solver.imaginary_limit, solver.real_limit)
