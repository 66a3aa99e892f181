"""Figures over every step, compared with plain stepping in Python that keeps every sample."""

from __future__ import annotations

import json

import numpy as np
import pytest

from barbalat.adaptation.laws import LeastSquares
from barbalat.controllers import L1Adaptive, Mrac, RobustMrac
from barbalat.linear.systems import input_filter
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.state_feedback import ParameterBox, Plant, Problem
from barbalat.run.engine.engine import Batch, run
from barbalat.run.engine.simulate import simulate
from barbalat.run.kernel import grid
from barbalat.run.kernel.grid import segments_of
from barbalat.run.kernel.metrics import DIVERGENCE_LIMIT
from barbalat.run.kernel.step import step_program
from barbalat.signals import Sine, Square
from barbalat.solvers import EULER, RK4
from barbalat.solvers.simulation import Simulation
from independent import brute_force, example_controllers

STEP = 2.0**-7


def expected_figures(samples, steps, dt):
    """The metrics by the definitions in interfaces.md. The tail is the last quarter of [0, t_end], determined in integers."""
    tail = [k for k in range(steps + 1) if 4 * k >= 3 * steps]
    moved = [np.abs(samples.theta_hat[k + 1] - samples.theta_hat[k]) for k in tail[:-1]]
    duration = (tail[-1] - tail[0]) * dt
    return {
        "max_abs_e": np.abs(samples.e).max(axis=0),
        "rms_e": np.sqrt((samples.e**2).mean(axis=0)),
        "tail_max_abs_e": np.abs(samples.e[tail]).max(axis=0),
        "max_abs_u": np.abs(samples.u).max(),
        "theta_hat_final": samples.theta_hat[-1],
        "theta_hat_tail_min": samples.theta_hat[tail].min(axis=0),
        "theta_hat_tail_max": samples.theta_hat[tail].max(axis=0),
        "theta_hat_variation_rate": np.sum(moved, axis=0) / duration if moved else np.zeros(samples.theta_hat.shape[1]),
    }


def assert_figures(figures, expected):
    assert figures.pop("diverged_at") is None
    assert set(figures) == set(expected)
    for name, value in expected.items():
        # 1e-10: roundings of at most 1000 steps in loops that do not amplify; a sample more or less shows at 1e-5
        np.testing.assert_allclose(figures[name], value, rtol=1e-10, atol=1e-10, err_msg=name)


@pytest.mark.parametrize("steps", [1, 2, 3, 4, 5, 7, 8, 97, 640, 1003])
@pytest.mark.parametrize("record_points", [2, 10, 2000])
@pytest.mark.short(kept=lambda steps, record_points: steps < 640 or record_points == 10)
def test_figures_over_every_step(problems, steps, record_points):
    """The numbers of steps are not divisible by a block or into quarters. The command is a square wave, whose last value counts
    at t_end."""
    given = problems[2]
    reference = Square(amplitude=2.0, frequency=2 * np.pi, constant=0.3)  # jumps every 64 steps
    problem = Problem(
        plant=given.plant, reference_model=given.reference_model, reference=reference, uncertainty=given.uncertainty
    )
    controller = L1Adaptive(gamma=50.0, filter=input_filter(0.1))
    simulation = Simulation(t_end=steps * STEP, dt=STEP, record_points=record_points)
    samples = brute_force(ClosedLoop.of(problem, controller), problem.signals, "rk4", STEP, steps)
    result = simulate(problem, [controller], simulation)["L1"]
    assert_figures(result.figures, expected_figures(samples, steps, STEP))


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.short(kept=lambda n: n == 2)
def test_figures_of_each_order(problems, n):
    problem, steps = problems[n], 333
    for name, controllers in example_controllers(n).items():
        samples = brute_force(ClosedLoop.of(problem, controllers[0]), problem.signals, "rk4", STEP, steps)
        simulation = Simulation(t_end=steps * STEP, dt=STEP, record_points=50)
        result = simulate(problem, [controllers[0]], simulation)[controllers[0].name]
        figures = {
            key: value for key, value in result.figures.items() if key not in ("sigma_hat_final", "k_r_hat_final", "V_hat_final")
        }
        assert_figures(figures, expected_figures(samples, steps, STEP)), name


@pytest.mark.parametrize("chunk", [20, 64, 500])
def test_figures_across_kernel_calls(problems, monkeypatch, chunk):
    """If the run is divided into calls of other lengths, the samples are the same bit for bit, and the sums up to their order
    (1e-13)."""
    problem, controller = problems[2], example_controllers(2)["l1"][0]
    simulation = Simulation(t_end=1003 * STEP, dt=STEP, record_points=60)
    whole = simulate(problem, [controller], simulation)["L1"]
    monkeypatch.setattr(grid, "CHUNK_STEPS", chunk)
    assert len(list(segments_of(simulation, recorded=True))) > 4
    cut = simulate(problem, [controller], simulation)["L1"]
    assert np.array_equal(cut.x, whole.x)
    assert cut.figures.pop("diverged_at") is None
    for name in set(whole.figures) - {"diverged_at"}:
        np.testing.assert_allclose(cut.figures[name], whole.figures[name], rtol=1e-13)


def test_a_short_peak_between_recorded_instants_is_seen(problems):
    """100 of 10 000 steps are recorded, and the command is 1000 for a single step."""

    class Spike:
        def __call__(self, t):
            return np.where(np.abs(t - 5003 * 2.0**-10) < 0.4 * 2.0**-10, 1000.0, 0.0)

        before = __call__

    problem = Problem(plant=problems[2].plant, reference=Spike())
    simulation = Simulation(t_end=10_000 * 2.0**-10, dt=2.0**-10, record_points=100)
    result = simulate(problem, [Mrac(gamma=1.0)], simulation)["MRAC"]
    assert np.abs(result.u).max() < 100
    assert result.figures["max_abs_u"] == pytest.approx(1000, rel=0.01)  # theta_hat'x of order 1 beside it
    assert result.envelope.u_max.max() == pytest.approx(1000, rel=0.01)


# --- divergence ---


def exploding(factor: float, h: float = 1.0) -> Problem:
    """x' = a x, which grows by ``factor`` in each step of Euler's method. theta_hat cannot leave the set {0}, so nothing
    adapts."""
    return Problem(
        plant=Plant(A_m=[[-0.5 / h]], b=[1.0], theta=[(factor - 0.5) / h], x0=[1.0]),
        uncertainty=ParameterBox(lower=[0.0], upper=[0.0]),
    )


NOTHING = Mrac(gamma=1e-300)


@pytest.mark.parametrize("factor", [2.0, 16.0, 1e3, 1e11, 1e40])
@pytest.mark.parametrize("record_points", [2, 7, 2000])
def test_the_time_of_divergence(factor, record_points):
    """The time of divergence is exactly the first instant at which the sum of the states' magnitudes exceeds the limit, for any
    blocks."""
    steps, x, k = 100, 1.0, 0
    while abs(x) + abs(0.5**k) <= DIVERGENCE_LIMIT:  # x_m halves in each step; theta_hat stays 0
        x, k = x * factor, k + 1
    simulation = Simulation(t_end=float(steps), dt=1.0, solver=EULER, record_points=record_points)
    result = simulate(exploding(factor), [NOTHING], simulation)["MRAC"]
    assert result.diverged_at == k
    assert result.t[-1] < k
    assert np.isfinite(result.x).all()


@pytest.mark.parametrize("record_points", [2, 9, 2000])
def test_a_run_that_comes_back_has_diverged_all_the_same(record_points):
    """The transient of a stable plant exceeds 1e12 and decays again within one block. The first crossing counts."""
    plant = Plant(A_m=[[-1.0, 6.0], [0.0, -1.0]], b=[0.0, 1.0], theta=[0.0, 0.0], x0=[0.0, 3e11])
    problem = Problem(plant=plant, uncertainty=ParameterBox(lower=[0.0, 0.0], upper=[0.0, 0.0]))
    steps, h = 400, 2.0**-5
    samples = brute_force(ClosedLoop.of(problem, NOTHING), problem.signals, "rk4", h, steps)
    size = np.abs(samples.states).sum(axis=1)
    first = int(np.flatnonzero(size > DIVERGENCE_LIMIT)[0])
    assert 0 < first < steps
    assert size[-1] < 0.1 * DIVERGENCE_LIMIT
    result = simulate(problem, [NOTHING], Simulation(t_end=steps * h, dt=h, record_points=record_points))["MRAC"]
    assert result.diverged_at == first * h
    assert result.figures["max_abs_u"] is None


def test_divergence_in_the_last_step_and_never():
    factor = 1e3  # 1e12 after four steps is not above the limit by itself, but x_m is added; after five steps it is
    for steps, expected in ((3, None), (4, 4.0), (5, 4.0)):
        result = simulate(exploding(factor), [NOTHING], Simulation(t_end=float(steps), dt=1.0, solver=EULER))["MRAC"]
        assert result.diverged_at == expected


@pytest.mark.parametrize("steps", [40, 41, 400])
def test_divergence_against_brute_force(section_v, steps):
    """Section V without projection at ten times the paper's step, where the divergence is faster than exponential."""
    controller = L1Adaptive(gamma=1e4, filter=input_filter(0.02), projection=False)
    dt = 2.0**-7
    with np.errstate(all="ignore"):
        samples = brute_force(ClosedLoop.of(section_v, controller), section_v.signals, "rk4", dt, steps)
        large = ~(np.abs(samples.states).sum(axis=1) <= DIVERGENCE_LIMIT)
    result = simulate(section_v, [controller], Simulation(t_end=steps * dt, dt=dt, record_points=9))["L1"]
    expected = np.flatnonzero(large)[0] * dt if large.any() else None
    assert result.diverged_at == expected


def test_figures_of_a_diverged_run_are_none_and_json_takes_them():
    result = simulate(exploding(1e40), [NOTHING], Simulation(t_end=50.0, dt=1.0, solver=EULER))["MRAC"]
    figures = result.figures
    assert figures["diverged_at"] == 1
    assert figures["max_abs_u"] is None
    for name, value in figures.items():
        if name not in ("diverged_at", "max_abs_u"):
            assert value == [None], name
    assert "NaN" not in json.dumps(figures, allow_nan=False)
    assert result.t.tolist() == [0.0]
    assert result.envelope.e_min.shape == (0, 1)
    assert np.isfinite(result.stiffness.h_lambda_max)


@pytest.mark.parametrize("h", [1.0, 2.0**-10])
@pytest.mark.parametrize("solver", [EULER, RK4])
@pytest.mark.parametrize("top", [1e154, 1e308])
def test_no_speed_of_divergence_gives_a_warning(h, solver, top):
    """Warnings are errors here. 2000 members have states that exceed 1e154 and 1e308 near the end at slightly different times.
    Squares and sums overflow in the kernel, in the merging of blocks and in the metrics. One member stays bounded."""
    problem, steps = exploding(1.5, h), 40
    loop = ClosedLoop.of(problem, NOTHING)
    states = loop.initial()[:, None].repeat(2001, axis=1)
    states[0] = np.append(top / 1.5**steps * np.geomspace(1e-4, 1e4, 2000), 0.0)
    simulation = Simulation(t_end=steps * h, dt=h, solver=solver, record_points=7)
    batch = Batch(loop, step_program(loop, solver, h), states, np.zeros((0, 2001)))
    run([batch], problem.signals, simulation)
    metrics = batch.metrics(simulation)
    assert (metrics.diverged_at[:-1] == h).all()
    assert np.isnan(metrics.rms_e[:-1]).all()
    assert np.isfinite(metrics.rms_e[-1]).all()


@pytest.mark.parametrize("x0", np.geomspace(1e141, 1e149, 30))
@pytest.mark.short(kept=lambda x0: x0 < 1e143)
def test_a_run_past_the_largest_number_gives_no_warning(x0):
    """A single run with ``simulate`` gives no warning either."""
    given = exploding(1.5).plant
    problem = Problem(
        plant=Plant(A_m=given.A_m, b=given.b, theta=given.theta, x0=[x0]), uncertainty=ParameterBox(lower=[0], upper=[0])
    )
    result = simulate(problem, [NOTHING], Simulation(t_end=30.0, dt=1.0, solver=EULER))["MRAC"]
    assert result.diverged_at == 1.0


def test_members_that_diverge_do_not_disturb_the_others(problems):
    """Each diverging member diverges at a different time. A member that stays bounded keeps its metrics bit for bit."""
    problem = exploding(2.0)
    loop = ClosedLoop.of(problem, NOTHING)
    states = loop.initial()[:, None].repeat(5, axis=1)
    states[0] = [0.0, 1.0, 2.0**10, 2.0**20, 0.0]
    simulation = Simulation(t_end=60.0, dt=1.0, solver=EULER, record_points=5)
    batch = Batch(loop, step_program(loop, EULER, 1.0), states, np.zeros((0, 5)), lanes=4)
    run([batch], problem.signals, simulation)
    metrics = batch.metrics(simulation)
    np.testing.assert_array_equal(metrics.diverged_at, [np.nan, 40, 30, 20, np.nan])  # 2^40 > 1e12 > 2^39
    assert metrics.max_abs_e[[0, 4], 0].tolist() == [1.0, 1.0]  # e = x - x_m with x = 0, x_m(0) = 1
    assert np.isnan(metrics.max_abs_e[1:4]).all()


@pytest.mark.parametrize("unit", [1.0, 1e6])
def test_units_do_not_decide_over_divergence(unit):
    """For the same loop in N and in uN, or with a large initial covariance, a bounded run stays bounded. n_d contains u^2, and
    covariance(0) is free, so neither indicates divergence."""
    given = Plant(A_m=[[0.0, 1.0], [-2.0, -3.0]], b=[0.0, 1.0 / unit], theta=np.array([1.0, -0.5]) * unit, x0=[0.5, -0.5])
    problem = Problem(plant=given, reference=Sine(2.0 * unit, 1.0))
    controller = RobustMrac(tau=0.5, law=LeastSquares(covariance0=50.0 * unit**2))
    result = simulate(problem, [controller], Simulation(t_end=8.0, dt=2.0**-7))[controller.name]
    assert result.diverged_at is None
    assert max(result.figures["max_abs_e"]) < 1
