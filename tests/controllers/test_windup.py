"""Remedies against windup: nothing changes without a limit at work; with one, nothing wrong is learnt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barbalat.actuation import PlantInput
from barbalat.adaptation.learning import CompositeLearning
from barbalat.controllers import L1Adaptive, Mrac, Sampled
from barbalat.controllers.windup import ModifiedError
from barbalat.grid import Simulation
from barbalat.linear import input_filter
from barbalat.signals import Square
from barbalat.simulation import simulate
from independent import refusal

SIMULATION = Simulation(t_end=30.0, dt=1e-3)


def limited(problem, level):
    plant = replace(problem.plant, input=PlantInput(saturation=(-level, level)))
    return replace(problem, plant=plant, reference=Square(amplitude=2.0, frequency=0.5))


PAIRS = {
    "mrac": (Mrac(gamma=50.0, name="c"), Mrac(gamma=50.0, modified_error=ModifiedError(), name="c")),
    "mrac, mu": (Mrac(gamma=50.0, name="c"), Mrac(gamma=50.0, modified_error=ModifiedError(mu=5.0, margin=0.1), name="c")),
    "l1": (
        L1Adaptive(gamma=500.0, filter=input_filter(0.05), name="c"),
        L1Adaptive(gamma=500.0, filter=input_filter(0.05), saturated_predictor=True, name="c"),
    ),
}


@pytest.mark.parametrize("name", PAIRS)
def test_without_a_limit_at_work_nothing_changes(problems, name):
    """To rounding: the remedy adds terms that are zero."""
    problem = limited(problems[2], 1e4)
    plain, remedied = (simulate(problem, [controller], SIMULATION)["c"] for controller in PAIRS[name])
    np.testing.assert_allclose(remedied.x, plain.x, rtol=0, atol=1e-12)
    np.testing.assert_allclose(remedied.theta_hat, plain.theta_hat, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", PAIRS)
def test_at_the_limit_the_lyapunov_function_still_decreases(problems, name):
    """V of the error that drives the law: with the remedy it never grows, without it it does."""
    problem = limited(problems[2], 3.0)
    P, theta = problem.known.P, problem.plant.theta
    grew = []
    for controller in PAIRS[name]:
        run = simulate(problem, [controller], replace(SIMULATION, record_points=30_000))["c"]
        states = [run.loop.unpack(s) for s in run.states]
        if name == "l1":
            error = np.array([s.x - s.controller.x_hat for s in states])
        else:
            away = [s.controller.e_d if len(s.controller.e_d) else 0.0 for s in states]
            error = run.e - np.array(away).reshape(len(states), -1)
        V = np.einsum("ki,ij,kj->k", error, P, error) + ((run.theta_hat - theta) ** 2).sum(axis=1) / controller.gamma
        grew.append(float(np.maximum(np.diff(V), 0).sum()))
        assert (np.abs(run.u) > 3.0).any()
    assert grew[1] < 1e-9
    assert grew[0] > 1e-3


def test_positive_mu_keeps_the_control_nearer_to_its_limits(problems):
    problem = limited(problems[2], 3.0)
    peaks = [
        simulate(problem, [Mrac(gamma=50.0, modified_error=ModifiedError(mu=mu), name="c")], SIMULATION)["c"].figures["max_abs_u"]
        for mu in (0.0, 1.0, 10.0)
    ]
    assert peaks[0] > peaks[1] > peaks[2] > 3.0


def test_the_sampled_predictor_takes_what_is_left_of_u(problems):
    """Midpoint: the estimates of the remedied form move less astray than those of the plain one."""
    problem = limited(problems[2], 3.0)
    astray = []
    for controller in PAIRS["l1"]:
        run = simulate(problem, [Sampled(controller=controller, sample_time=0.01)], SIMULATION)["c"]
        astray.append(np.linalg.norm(run.theta_hat - problem.plant.theta, axis=1).max())
    assert astray[1] <= np.linalg.norm(problem.plant.theta) * 1.05 < astray[0]


def test_refusals(problems):
    free, bounded = problems[2], limited(problems[2], 3.0)
    remedied = PAIRS["mrac"][1]
    assert "plant.input.saturation" in refusal(lambda: remedied.bind(free.known))
    assert "plant.input.saturation" in refusal(lambda: PAIRS["l1"][1].bind(free.known))
    assert "input_gain" in refusal(lambda: remedied.bind(replace(bounded, input_gain=(0.5, 2.0)).known))
    assert "margin" in refusal(lambda: ModifiedError(margin=1.0))
    assert "mu" in refusal(lambda: ModifiedError(mu=-1.0))
    assert "modified_error" in refusal(lambda: Sampled(controller=remedied, sample_time=0.01).bind(bounded.known))
    learning = CompositeLearning(gamma_c=1.0, time_constant=0.1)
    assert "learning" in refusal(lambda: Mrac(gamma=1.0, modified_error=ModifiedError(), learning=learning))
