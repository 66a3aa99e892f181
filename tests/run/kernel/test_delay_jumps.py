"""A delayed input that jumps: commands, limits and a sampled controller's held control, compared with exact solutions."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from barbalat.controllers import L1Adaptive, Mrac, Sampled
from barbalat.linear.systems import TransferFunction, input_filter
from barbalat.problem.actuation import PlantInput
from barbalat.problem.measurement import Noise, Sensor
from barbalat.problem.plant import Plant, ReferenceModel
from barbalat.problem.regressors import Terms
from barbalat.problem.state_feedback import Problem
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.engine.simulate import simulate
from barbalat.run.kernel import delay as exact_delay
from barbalat.signals import Sine, Square
from barbalat.solvers import EULER, HEUN, RK4, SOLVERS
from barbalat.solvers.simulation import Simulation

A_M, B, THETA = np.array([[0.0, 1.0], [-1.0, -1.4]]), np.array([0.0, 1.0]), np.array([0.7, -0.5])
A = A_M + np.outer(B, THETA)
FROZEN = 1e-30
"""A gain that adapts nothing: the loop is linear."""
COMMAND = Square(amplitude=3.0, frequency=2 * np.pi * 2.5)  # edges every 0.2 s


def problem(reference=COMMAND, **path) -> Problem:
    return Problem(
        plant=Plant(A_m=A_M, b=B, theta=THETA, x0=[0.3, 0.0], input=PlantInput(**path)),
        reference_model=ReferenceModel(k_0=2.0),
        reference=reference,
    )


def held(x: np.ndarray, v: float, duration: float) -> np.ndarray:
    """The exact solution of x' = A x + B v with a constant v."""
    M = np.zeros((3, 3))
    M[:2, :2], M[:2, 2] = A * duration, B * v * duration
    return (expm(M) @ [*x, 1.0])[:2]


def exactly(given: Problem, edges: np.ndarray, values: np.ndarray, t_end: float) -> np.ndarray:
    """The exact x(t_end) if u is values[i] from edges[i] on."""
    tau = given.delay
    times = np.concatenate([[0.0], edges + tau, [t_end]])
    times = np.minimum(times, t_end)
    x = given.plant.x0
    for (start, stop), v in zip(pairwise(times), [given.history[0], *values], strict=True):
        x = held(x, v, stop - start)
    return x


def order(steps, errors) -> float:
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


COARSE = 0.04
SHRINKING = {0.08: (1, 2, 4), 0.06: (1, 3, 9), 0.05: (1, 5), 0.07: (1, 5)}
"""The divisors of the coarse step for each delay with which its fraction of a step, 0, 1/2, 1/4 or 3/4, stays the same."""
DELAYS = list(SHRINKING)


def steps_for(tau: float) -> np.ndarray:
    return COARSE / np.array(SHRINKING[tau])


@pytest.mark.parametrize("tau", DELAYS)
@pytest.mark.parametrize("level", [np.inf, 1.0])
@pytest.mark.parametrize("history", [0.0, -0.8])
@pytest.mark.short(kept=lambda tau, level, history: np.isinf(level) == (history == 0.0))
def test_a_square_command_keeps_the_method_s_order(tau, level, history):
    """The loop is open, with or without limits. All 2 t_end/0.4 jumps and the jump from the history are within steps."""
    limits = {"saturation": (-level, level)} if np.isfinite(level) else {}
    given, t_end = problem(delay=tau, history=history, **limits), 2.0
    edges = 0.2 * np.arange(10)
    expected = exactly(given, edges, np.clip(6.0 * (-1.0) ** np.arange(10), -level, level), t_end)
    steps = steps_for(tau)
    runs = [simulate(given, [Mrac(gamma=FROZEN)], Simulation(t_end=t_end, dt=h))["MRAC"] for h in steps]
    errors = np.array([np.abs(run.x[-1] - expected).max() for run in runs])
    assert order(steps, errors) > 3.7


def test_a_nonlinear_plant_loses_one_order_at_a_jump():
    """x' = -x + 0.4 x^2 + v has third order if the jump is within the step. The reference is DOP853 from edge to edge."""
    plant = Plant(A_m=[[-1.0]], b=[1.0], theta=[0.4], regressor=Terms(terms=("x1**2",)), input=PlantInput(delay=0.06))
    given = Problem(plant=plant, reference=Square(amplitude=0.5, frequency=2 * np.pi * 2.5))
    x, t_end = np.zeros(1), 2.0
    for i, (start, stop) in enumerate(pairwise([0.0, *(0.06 + 0.2 * np.arange(10)), t_end])):
        v = 0.0 if i == 0 else 0.5 * (-1.0) ** (i - 1)
        slope = lambda t, x, v=v: -x + 0.4 * x**2 + v  # noqa: E731
        x = solve_ivp(slope, (start, stop), x, method="DOP853", rtol=1e-13, atol=1e-15).y[:, -1]
    steps = steps_for(0.06)
    runs = [simulate(given, [Mrac(gamma=FROZEN)], Simulation(t_end=t_end, dt=h))["MRAC"] for h in steps]
    assert order(steps, [np.abs(run.x[-1] - x).max() for run in runs]) > 2.7


@pytest.mark.parametrize("solver", SOLVERS)
def test_every_solver_keeps_its_order(solver):
    given, t_end = problem(delay=0.06, history=0.5), 2.0
    expected = exactly(given, 0.2 * np.arange(10), 6.0 * (-1.0) ** np.arange(10), t_end)
    steps = steps_for(0.06)
    simulations = [Simulation(t_end=t_end, dt=h, solver=SOLVERS[solver]) for h in steps]
    errors = [np.abs(simulate(given, [Mrac(gamma=FROZEN)], s)["MRAC"].x[-1] - expected).max() for s in simulations]
    assert order(steps, errors) > SOLVERS[solver].order - 0.2


@pytest.mark.parametrize("tau", DELAYS)
def test_a_sampled_controller_s_held_control_is_replayed(tau):
    """In the closed loop u_k = 2 r_k - theta_hat'x_k is held for T = 0.04 s. x follows from sample to sample by matrix
    exponentials."""
    T, t_end, estimate = 0.04, 2.0, np.array([0.4, 0.9])
    given = problem(Sine(amplitude=1.0, frequency=1.3, phase=0.4), delay=tau, history=-0.8)
    count = round(t_end / T)
    u, x = [], given.plant.x0
    moments = sorted({0.0, *(T * np.arange(count + 1)).tolist(), *(T * np.arange(count) + tau).tolist()})
    for start, stop in pairwise(moments):
        if start > t_end - 1e-9:
            break
        if len(u) < count and start >= T * len(u) - 1e-12:
            u.append(2.0 * float(given.reference(np.array(T * len(u)))) - estimate @ x)
        index = int(np.floor((start - tau) / T + 1e-9))
        x = held(x, -0.8 if index < 0 else u[index], min(stop, t_end) - start)
    steps, errors = steps_for(tau), []
    for h in steps:
        controller = Sampled(controller=Mrac(gamma=FROZEN, theta_hat0=estimate, name="c"), sample_time=T)
        errors.append(np.abs(simulate(given, [controller], Simulation(t_end=t_end, dt=h))["c"].x[-1] - x).max())
    assert order(steps, errors) > 3.7


def test_what_is_held_is_replayed_to_the_last_bit():
    """If the delay is a whole number of steps, the weights select one stored value, and no stage has a mixture of two."""
    for solver in (EULER, HEUN, RK4):
        weights = exact_delay.weights(0.05, 0.01, solver)
        for past in ([1.0, 7.0, 7.0], [1.0, 1.0, 7.0], [7.0, 1.0, 1.0]):
            np.testing.assert_array_equal(weights @ [*past, *past], past[0])  # held over each step: start and end are the same


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_jump_s_moments(solver):
    """The end of a step of x' = A x + B v with a jump in the step, to order h^(q+1), where q is the number of the solver's
    nodes."""
    tableau = SOLVERS[solver]
    for fraction in (0.0, 0.25, 0.9):
        errors, steps = [], np.array([0.1, 0.05, 0.025])
        values = exact_delay.jump_weights(tableau, fraction)
        for h in steps:
            by_node = dict(zip(tableau.nodes, values, strict=True))
            x = tableau.advance(lambda x, v: A @ x + B * v, lambda x: x, np.zeros(2), by_node, h)
            errors.append(np.abs(x - held(np.zeros(2), 1.0, (1 - fraction) * h)).max())
        assert order(steps, errors) > len(tableau.nodes) + 0.8


def test_one_step_of_delay():
    """Delays from one step on are compared with the same delay on a grid eight times as fine."""
    given = problem(Sine(amplitude=1.0, frequency=1.3), delay=0.0123)
    controller = Mrac(gamma=2.0, theta_hat0=THETA)
    steps = np.array([0.0123, 0.01, 0.008])
    fine = simulate(replace(given), [controller], Simulation(t_end=6.15, dt=0.0123 / 8))["MRAC"].x[-1]
    coarse = simulate(given, [controller], Simulation(t_end=6.15, dt=steps[0]))["MRAC"].x[-1]
    assert np.abs(coarse - fine).max() < 1e-4


def test_members_with_jumps_and_histories_equal_single_runs():
    """The members have different delays, one of them between one and two steps, and different histories and limits. They are
    sampled and have noise and an actuator."""
    simulation = Simulation(t_end=2.0, dt=0.01)
    sensor = Sensor(noise=Noise(std=0.01, sample_time=0.02, seed=3))
    actuator = TransferFunction([400.0], [1.0, 28.0, 400.0])
    for controller in (
        Mrac(gamma=2.0, name="c"),
        Sampled(controller=L1Adaptive(gamma=10.0, filter=input_filter(0.1), name="c"), sample_time=0.04),
    ):
        paths = [
            PlantInput(delay=tau, history=h, saturation=(-s, s), actuator=actuator)
            for tau, h, s in ((0.0137, 0.3, 1.0), (0.05, -0.2, 2.0), (0.0777, 0.0, 30.0))
        ]
        given = [replace(problem(), plant=replace(problem().plant, input=path), sensor=sensor) for path in paths]
        together = simulate_ensemble([(p, controller) for p in given[:1]], simulation).metrics
        for i, p in enumerate(given[:1]):
            alone = simulate(p, [controller], simulation)["c"].metrics
            np.testing.assert_allclose(together.max_abs_e[i], alone.max_abs_e[0], rtol=1e-9)
        every = simulate_ensemble([(replace(p, sensor=None), controller) for p in given], simulation).metrics
        for i, p in enumerate(given):
            alone = simulate(replace(p, sensor=None), [controller], simulation)["c"].metrics
            np.testing.assert_allclose(every.max_abs_e[i], alone.max_abs_e[0], rtol=1e-9)
