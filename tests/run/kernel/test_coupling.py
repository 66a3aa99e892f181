"""The watched quantity of a run: with its constant part it is the sum of the squared eigenvalues."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barbalat import L1Adaptive, Mrac, RobustMrac, Sampled, input_filter
from barbalat.adaptation.laws import LeastSquares
from barbalat.cases.load import load_case
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import jacobian_function
from barbalat.run.kernel.step import coupling_function, step_function
from barbalat.solvers import RK4

PAPER = replace(load_case("paper").problem, uncertainty=None)
CONTROLLERS = {
    "mrac": Mrac(gamma=7.0),
    "l1": L1Adaptive(gamma=300.0, filter=input_filter(0.1)),
    "robust": RobustMrac(tau=0.5, law=LeastSquares(covariance0=3.0)),
}


def coupling(loop):
    step, _ = step_function(loop, RK4, 1e-3)
    function = coupling_function(loop, step)

    def at(state, r):
        return float(function(state, 0, [], np.full(3, r), [], []))

    return at


@pytest.mark.parametrize("name", CONTROLLERS)
def test_differences_are_those_of_the_squared_eigenvalues(name):
    """tr J^2 is computed from the spectrum at two states. If neither part changes its sign, the constants cancel in the
    difference."""
    loop = ClosedLoop.of(PAPER, CONTROLLERS[name])
    at, jacobian, random = coupling(loop), jacobian_function(loop), np.random.default_rng(5)
    state = loop.initial() + random.normal(size=loop.size)
    pairs = []
    for scale in (1.0, 1.001):
        matrix = np.asarray(jacobian(scale * state, [1.0]))
        own, crossed = np.sum(np.diag(matrix) ** 2), np.sum(matrix * matrix.T) - np.sum(np.diag(matrix) ** 2)
        assert own + crossed == pytest.approx(np.sum(np.linalg.eigvals(matrix) ** 2).real, rel=1e-9)
        pairs.append((own, crossed, at(scale * state, 1.0)))
    (own, crossed, watched), (own_2, crossed_2, watched_2) = pairs
    moved = {sign * (crossed_2 - crossed) + own_2 - own for sign in (1, -1)}
    assert any(watched_2 - watched == pytest.approx(value, rel=1e-6) for value in moved)


def test_the_frozen_oscillator():
    """With x_tilde = 0 it is 2 omega_a^2, because the modes of the filter and the model are constant."""
    loop = ClosedLoop.of(PAPER, CONTROLLERS["l1"])
    state, known = loop.initial(), PAPER.known
    omega_a_squared = 300.0 * (PAPER.plant.x0 @ PAPER.plant.x0) * (known.b @ known.P @ known.b)
    at = coupling(loop)
    assert at(state, 0.0) == pytest.approx(2 * omega_a_squared, rel=1e-12)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_sampled_controller_is_watched_as_the_continuous_one(name):
    controller = CONTROLLERS[name]
    loop = ClosedLoop.of(PAPER, controller)
    sampled = ClosedLoop.of(PAPER, Sampled(controller=controller, sample_time=0.01, discretization="euler"))
    state = loop.initial() + np.random.default_rng(2).normal(size=loop.size)
    padded = np.concatenate([state, np.ones(sampled.size - loop.size)])
    assert coupling(sampled)(padded, 1.0) == pytest.approx(coupling(loop)(state, 1.0), rel=1e-12)


def test_what_has_diverged_is_not_watched():
    loop = ClosedLoop.of(PAPER, CONTROLLERS["mrac"])
    state = loop.initial()
    state[0] = 2e12
    assert coupling(loop)(state, 1.0) == -np.inf
