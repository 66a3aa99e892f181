"""The path of u to the plant: limits and dynamics, in order, compared with a plain integration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from barbalat.controllers import LinearFeedback, Mrac
from barbalat.linear.systems import TransferFunction
from barbalat.problem.actuation import PlantInput
from barbalat.problem.tracking import Disturbance
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.engine.simulate import simulate
from barbalat.signals import Sine
from barbalat.solvers.simulation import Simulation
from independent import refusal


def with_input(problem, path):
    return replace(problem, plant=replace(problem.plant, input=path))


def test_each_stage_of_the_path():
    path = replace(PlantInput(quantization=0.5, saturation=(-1.0, 2.0), rate_limit=3.0).path, following=1e-3)
    assert [float(path.asked(np.array(u))) for u in (0.24, 0.26, -0.74, -5.0, 9.0)] == [0.0, 0.5, -0.5, -1.0, 2.0]
    state = path.initial()
    for u, expected in ((9.0, 3.0), (0.0, 0.0), (-9.0, -3.0), (0.001, 0.0), (0.26, 3.0)):
        assert float(path.derivative(state, np.array(u)).limited[0]) == expected


def test_rate_limit_slope_and_following(problems):
    """The limited output never moves faster than the limit. If u is slower, the output follows within about a step."""
    dt, rate = 1e-3, 2.0
    free, limited = (with_input(problems[2], path) for path in (None, PlantInput(rate_limit=rate)))
    simulation = Simulation(t_end=8.0, dt=dt, record_points=10_000)
    run = simulate(limited, [Mrac(gamma=1.0)], simulation)["MRAC"]
    passed = np.array([run.loop.unpack(s).input[0].limited[0] for s in run.states])
    slopes = np.diff(passed) / dt
    assert np.abs(slopes).max() <= rate * (1 + 1e-9)
    assert (np.abs(slopes) > 0.99 * rate).any()
    slow = simulate(with_input(problems[2], PlantInput(rate_limit=1e6)), [Mrac(gamma=1.0)], simulation)["MRAC"]
    exact = simulate(free, [Mrac(gamma=1.0)], simulation)["MRAC"]
    assert np.abs(slow.x - exact.x).max() < 10 * dt  # a lag of one step, times slopes of a few units per second


def test_saturation_and_actuator_against_dop853(problems):
    """The parameters are fixed, because nothing is adapted with gamma = 1e-9. The tolerance 1e-6 is for RK4 with h = 1e-3 at the
    corners of the saturation."""
    problem = problems[2]
    wn = 10.0
    actuator = TransferFunction([wn**2], [1.0, 1.4 * wn, wn**2])
    path = PlantInput(saturation=(-0.3, 0.4), actuator=actuator, gain=1.5)
    plant, r = problem.plant, problem.reference
    k_0 = problem.reference_model.k_0

    def slope(t, s):
        x, a = s[:2], s[2:]
        u = np.clip(k_0 * float(r(np.array(t))), -0.3, 0.4)
        v = 1.5 * a[0]
        return [*(plant.A_m @ x + plant.b * (plant.theta @ x + v)), a[1], wn**2 * (u - a[0]) - 1.4 * wn * a[1]]

    exact = solve_ivp(slope, (0, 6), [*plant.x0, 0, 0], method="DOP853", rtol=1e-10, atol=1e-12, max_step=0.01).y[:2, -1]
    run = simulate(with_input(problem, path), [Mrac(gamma=1e-9)], Simulation(t_end=6.0, dt=1e-3))["MRAC"]
    np.testing.assert_allclose(run.x[-1], exact, atol=1e-6)


def test_unmatched_disturbance_against_dop853(problems):
    problem = replace(problems[2], unmatched=(Disturbance(direction=[1.0, 0.2], signal=Sine(amplitude=0.7, frequency=3.0)),))
    plant, r, k_0 = problem.plant, problem.reference, problem.reference_model.k_0

    def slope(t, x):
        d = np.array([1.0, 0.2]) * 0.7 * np.sin(3 * t)
        return plant.A_m @ x + plant.b * (plant.theta @ x + k_0 * float(r(np.array(t)))) + d

    exact = solve_ivp(slope, (0, 5), plant.x0, method="DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
    run = simulate(problem, [Mrac(gamma=1e-12)], Simulation(t_end=5.0, dt=1e-3))["MRAC"]
    np.testing.assert_allclose(run.x[-1], exact, atol=1e-9)


def test_members_differ_in_every_number_of_the_path(problems):
    """An ensemble over limits, rates, gains and quanta equals the single runs in every metric."""
    simulation = Simulation(t_end=3.0, dt=1e-2)
    paths = [
        PlantInput(quantization=0.01 * i, saturation=(-1.0 / i, 2.0 / i), rate_limit=1.0 + i, gain=0.5 + 0.1 * i)
        for i in (1, 2, 3)
    ]
    members = [(with_input(problems[2], path), Mrac(gamma=2.0)) for path in paths]
    together = simulate_ensemble(members, simulation).metrics
    for i, (problem, controller) in enumerate(members):
        alone = simulate(problem, [controller], simulation)["MRAC"].metrics
        np.testing.assert_allclose(together.max_abs_e[i], alone.max_abs_e[0], rtol=1e-10)
        np.testing.assert_allclose(together.max_abs_u[i], alone.max_abs_u[0], rtol=1e-10)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"saturation": (1.0, 2.0)}, ["saturation", "lower <= 0 <= upper"]),
        ({"saturation": (1.0,)}, ["saturation", "2"]),
        ({"rate_limit": 0.0}, ["rate_limit", "positive"]),
        ({"rate_limit": True}, ["rate_limit", "number"]),
        ({"quantization": -1.0}, ["quantization", "positive"]),
        ({"gain": 0.0}, ["gain", "positive"]),
        ({"gain": "full"}, ["gain", "number"]),
    ],
)
def test_bad_settings(settings, words):
    message = refusal(lambda: PlantInput(**settings))
    assert all(word in message for word in words)


def test_a_linear_controller_meets_the_limits_too(problems):
    run = simulate(
        with_input(problems[2], PlantInput(saturation=(-0.1, 0.1))),
        [LinearFeedback(controller=TransferFunction([1.0], [1.0, 1.0]))],
        Simulation(t_end=2.0, dt=1e-2),
    )
    assert next(iter(run.values())).diverged_at is None
