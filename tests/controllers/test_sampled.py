"""Sampled controllers: the compiled loop against a plain one, the limit of short samples, high gains, delays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barbalat.adaptation.gradient import Gradient
from barbalat.adaptation.least_squares import LeastSquares
from barbalat.closed_loop import ClosedLoop
from barbalat.controllers import L1Adaptive, LinearFeedback, Mrac, NormalizedMrac, RobustMrac, Sampled
from barbalat.controllers.output.l1 import L1Output
from barbalat.controllers.output.linear import LinearOutput
from barbalat.controllers.output.lyapunov import LyapunovLaw
from barbalat.controllers.output.mrac import MracOutput
from barbalat.grid import Simulation
from barbalat.linear import TransferFunction, input_filter
from barbalat.measurement import Noise, Sensor, standard_normal
from barbalat.output_problem import OutputPlant, OutputProblem, OutputReferenceModel
from barbalat.signals import Sine
from barbalat.simulation import simulate
from independent import refusal


def plain_loop(loop, every, signals, dt, steps, noise=None):
    """RK4 with hold, written out: sample, step, sample, step."""
    y = loop.initial()
    states = []
    for k in range(steps + 1):
        drawn = [] if noise is None else noise[k]

        def at(t, left=False, drawn=drawn):
            return np.array([float((s.before if left else s)(np.array(t))) for s in signals] + list(drawn))

        if k % every == 0:
            y = loop.sample(y, at(k * dt))
        states.append(y)
        f = loop.derivative
        k_1 = f(y, at(k * dt))
        k_2 = f(loop.limit(y + dt / 2 * k_1), at((k + 0.5) * dt))
        k_3 = f(loop.limit(y + dt / 2 * k_2), at((k + 0.5) * dt))
        k_4 = f(loop.limit(y + dt * k_3), at((k + 1) * dt, left=True))
        y = loop.limit(y + dt / 6 * (k_1 + 2 * k_2 + 2 * k_3 + k_4))
    return np.array(states)


CONTROLLERS = {
    "mrac": Mrac(gamma=20.0),
    "l1": L1Adaptive(gamma=50.0, filter=input_filter(0.1)),
    "normalized": NormalizedMrac(law=Gradient(gamma=10.0)),
    "robust": RobustMrac(tau=0.3, law=LeastSquares(covariance0=20.0)),
}


@pytest.mark.parametrize("discretization", ["midpoint", "euler"])
@pytest.mark.parametrize("name", CONTROLLERS)
def test_compiled_loop_against_a_plain_one(problems, name, discretization):
    """Samples every three steps, noise that changes every two. 1e-10: sums in another order, over 240 steps."""
    dt, steps, every = 2.0**-7, 240, 3
    noise = Noise(std=[0.01, 0.02], sample_time=2 * dt, seed=5)
    problem = replace(problems[2], sensor=Sensor(noise=noise))
    controller = Sampled(controller=CONTROLLERS[name], sample_time=every * dt, discretization=discretization)
    loop = ClosedLoop.of(problem, controller)
    drawn = standard_normal(5, 0, 0, steps // 2 + 1, 2)[np.arange(steps + 1) // 2]
    expected = plain_loop(loop, every, problem.signals, dt, steps, drawn)
    result = simulate(problem, [controller], Simulation(t_end=steps * dt, dt=dt, record_points=10_000))[controller.name]
    np.testing.assert_allclose(result.states, expected, rtol=1e-10, atol=1e-10)
    moved = np.abs(np.diff([loop.unpack(s).controller.theta_hat for s in expected], axis=0))
    tail = moved[180 - 1 : steps - 1].sum(axis=0) / (60 * dt)  # the jump of a sample is counted in the step that it starts
    np.testing.assert_allclose(result.figures["theta_hat_variation_rate"], tail, rtol=1e-8)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_midpoint_tends_to_the_continuous_controller(problems, name):
    """Holding the control costs an error in proportion to the sample time: halving it halves the distance."""
    problem, controller = problems[2], CONTROLLERS[name]
    simulation = Simulation(t_end=4.0, dt=2.0**-9)
    exact = simulate(problem, [controller], simulation)[controller.name].x[-1]
    distances = []
    for every in (8, 4, 2):
        sampled = Sampled(controller=controller, sample_time=every * 2.0**-9)
        distances.append(np.abs(simulate(problem, [sampled], simulation)[controller.name].x[-1] - exact).max())
    ratios = np.array(distances[:-1]) / distances[1:]
    assert ((ratios > 1.6) & (ratios < 2.6)).all()


def test_no_gain_makes_the_estimates_chatter(section_v):
    """Section V at h = T = 1e-4: the midpoint forms vary alike from 1e2 to 1e8, the explicit Euler form a thousand times more."""
    simulation = Simulation(t_end=20.0, dt=1e-4)
    fine = simulate(section_v, [Mrac(gamma=100.0)], simulation)["MRAC"]
    for make in (
        lambda gamma: Mrac(gamma=gamma, name="c"),
        lambda gamma: L1Adaptive(gamma=gamma, filter=input_filter(0.02), name="c"),
    ):
        rates = {}
        for gamma in (1e2, 1e4, 1e6, 1e8):
            run = simulate(section_v, [Sampled(controller=make(gamma), sample_time=1e-4)], simulation)["c"]
            rates[gamma] = np.array(run.figures["theta_hat_variation_rate"])
        for rate in rates.values():
            np.testing.assert_allclose(rate, rates[1e4], rtol=0.01)
        euler = simulate(section_v, [Sampled(controller=make(1e2), sample_time=1e-4, discretization="euler")], simulation)["c"]
        assert (np.array(euler.figures["theta_hat_variation_rate"]) > 1000 * rates[1e2]).all()
    # the same order as the continuous law at a gain that the step resolves
    assert (rates[1e8] < 3 * np.array(fine.figures["theta_hat_variation_rate"]) + 1).all()


def test_refusals(section_v):
    mrac = Mrac(gamma=1.0)
    assert "sample_time" in refusal(lambda: Sampled(controller=mrac, sample_time=0.0))
    assert "discretization" in refusal(lambda: Sampled(controller=mrac, sample_time=0.1, discretization="tustin"))
    assert "continuous" in refusal(lambda: Sampled(controller=Sampled(controller=mrac, sample_time=0.1), sample_time=0.1))
    simulation = Simulation(t_end=1.0, dt=0.01)
    sampled = Sampled(controller=mrac, sample_time=0.015)
    assert "whole number of solver steps" in refusal(lambda: simulate(section_v, [sampled], simulation))


OUTPUT = {
    "l1-output": L1Output(m=3.0, gamma=50.0, filter=TransferFunction([20.0], [1.0, 20.0]), name="c"),
    "mrac-output": MracOutput(order=2, relative_degree=1, sign=1, law=Gradient(gamma=5.0), c_0_min=0.1, tau=0.3, name="c"),
    "mrac-output, least squares": MracOutput(
        order=2, relative_degree=1, sign=1, law=LeastSquares(covariance0=5.0), c_0_min=0.1, name="c"
    ),
    "linear": LinearOutput(loop=TransferFunction([3.0, 4.0], [1.0, 0.0]), name="c"),
}


def output_problem():
    return OutputProblem(
        plant=OutputPlant(transfer_function=TransferFunction([2.0, 6.0], [1.0, 3.0, 1.0])),
        reference_model=OutputReferenceModel(transfer_function=TransferFunction([3.0], [1.0, 3.0])),
        reference=Sine(amplitude=1.0, frequency=1.0),
    )


@pytest.mark.parametrize("name", OUTPUT)
def test_output_feedback_tends_to_the_continuous_controller(name):
    problem, controller, simulation = output_problem(), OUTPUT[name], Simulation(t_end=4.0, dt=2.0**-9)
    exact = simulate(problem, [controller], simulation)["c"].y[-1]
    distances = [
        abs(simulate(problem, [Sampled(controller=controller, sample_time=every * 2.0**-9)], simulation)["c"].y[-1] - exact)
        for every in (8, 4, 2)
    ]
    ratios = np.array(distances[:-1]) / distances[1:]
    assert ((ratios > 1.6) & (ratios < 2.6)).all()


def test_linear_state_feedback_by_tustin(problems):
    problem, simulation = problems[2], Simulation(t_end=4.0, dt=2.0**-9)
    controller = LinearFeedback(controller=TransferFunction([3.0, 4.0], [1.0, 0.0]), name="c")
    exact = simulate(problem, [controller], simulation)["c"].x[-1]
    far, near = (
        np.abs(
            simulate(problem, [Sampled(controller=controller, sample_time=every * 2.0**-9)], simulation)["c"].x[-1] - exact
        ).max()
        for every in (8, 4)
    )
    assert 1.6 < far / near < 2.6


def test_output_refusal():
    classical = MracOutput(order=1, relative_degree=1, sign=1, law=LyapunovLaw(gamma=1.0))
    assert "euler" in refusal(lambda: Sampled(controller=classical, sample_time=0.01).bind(output_problem().known))
