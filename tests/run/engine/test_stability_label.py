"""The label of a run: every step counts, recorded or not, and the stated time is the time of the first step outside the
region."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barbalat import L1Adaptive, Mrac, ParameterBox, Plant, Problem, ReferenceModel, Sampled, Simulation, input_filter, simulate
from barbalat.cases.load import load_case
from barbalat.plants import Noise, PlantInput, Sensor
from barbalat.signals import Constant, Steps

PAPER = load_case("paper").problem

BURST = Problem(
    plant=Plant(A_m=[[-50.0]], b=[1.0], theta=[3.0]),
    reference_model=ReferenceModel(k_0=50.0),
    reference=Steps(times=[0.0, 30.18, 30.4], values=[0.1, 300.0, 0.1]),
    uncertainty=ParameterBox(lower=[-5.0], upper=[5.0]),
)
"""A command that is small for a minute, except for a fifth of a second in which x is three thousand times as large."""


def every_step(result):
    """h omega_a from the run with every step recorded, by the formula and without a Jacobian."""
    P = result.problem.known.P[0, 0]
    return result.simulation.dt * np.sqrt(result.controller.gamma * P) * np.abs(result.x[:, 0])


@pytest.mark.parametrize("record_points", [5, 50, 2000, 60_000])
def test_a_burst_between_the_recorded_instants_is_labelled(record_points):
    """The label does not depend on the record. It is compared with the oscillator's frequency at every step, where the mode's
    real part moves the exit by one step."""
    controller, simulation = Mrac(gamma=1e5), Simulation(t_end=60.0, dt=1e-3, record_points=record_points)
    (result,) = simulate(BURST, [controller], simulation).values()
    (full,) = simulate(BURST, [controller], replace(simulation, record_points=60_000)).values()
    beyond = full.t[np.argmax(every_step(full) > simulation.solver.imaginary_limit)]
    assert result.stiffness.unstable_from == pytest.approx(beyond, abs=2e-3)
    assert result.stiffness.unstable_from == full.stiffness.unstable_from
    assert result.stiffness.h_lambda_max == pytest.approx(every_step(full).max(), rel=0.01)
    assert "h |lambda| <=" not in result.numerics


def test_below_the_limit_the_burst_is_not_labelled():
    (result,) = simulate(BURST, [Mrac(gamma=1e5)], Simulation(t_end=60.0, dt=2e-4)).values()
    assert result.label is None
    assert 1.8 < result.stiffness.h_lambda_max < 2.0  # a fifth of 9.5


def noisy(problem):
    return replace(problem, sensor=Sensor(noise=Noise(std=0.01, sample_time=1e-3, seed=3)))


def delayed(problem):
    return replace(problem, plant=replace(problem.plant, input=PlantInput(delay=0.0123)), reference=Constant(20.0))


PARTS = {
    "plain": (PAPER, L1Adaptive(gamma=1e4, filter=input_filter(0.02)), 1e-4),
    "noise": (noisy(PAPER), L1Adaptive(gamma=1e4, filter=input_filter(0.02)), 1e-4),
    "delay": (delayed(PAPER), L1Adaptive(gamma=1e3, filter=input_filter(0.02)), 5e-4),
    "sampled": (PAPER, Sampled(controller=Mrac(gamma=1.0), sample_time=5e-4, discretization="euler"), 1e-4),
    "diverging": (PAPER, L1Adaptive(gamma=1e4, filter=input_filter(0.02), projection=False), 1e-4),
}


@pytest.mark.parametrize("part", PARTS)
def test_the_time_of_the_label_does_not_depend_on_the_record(part):
    """Pieces of a run are simulated again from the record. With delays, noise and samples they are the same bit for bit."""
    problem, controller, dt = PARTS[part]
    times = []
    for record_points in (7, 100, 5000):
        (result,) = simulate(problem, [controller], Simulation(t_end=8.0, dt=dt, record_points=record_points)).values()
        times.append(result.stiffness.unstable_from)
    assert times[0] is not None
    assert times[0] > 10 * dt
    assert times == [times[0]] * 3


@pytest.mark.parametrize("discretization", ["euler", "midpoint"])
def test_a_flow_that_overflows_between_samples_is_a_finding(discretization):
    """With theta = 1e42, e^(A T) overflows although the Jacobian does not, so the discrete-time map has no finite numbers."""
    problem = Problem(
        plant=Plant(A_m=[[0.0, 1.0], [-2.0, -2.0]], b=[0.0, 1.0], theta=[4.5e42, 0.1], x0=[1.0, 0.0]),
        reference_model=ReferenceModel(k_0=2.0),
        reference=Constant(1.0),
    )
    controller = Sampled(Mrac(gamma=1.0), 0.01, discretization=discretization)
    (result,) = simulate(problem, [controller], Simulation(t_end=0.2, dt=1e-3)).values()
    assert result.diverged_at is not None
    assert result.label
    assert "inf" not in result.numerics
