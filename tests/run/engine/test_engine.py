"""The record and its size, and the independence of results from the division of work."""

from __future__ import annotations

import tracemalloc
from itertools import pairwise

import control
import numpy as np
import pytest

from barbalat.controllers import L1Adaptive, Mrac
from barbalat.linear.systems import input_filter
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.run.engine.engine import Batch, best_lanes, run
from barbalat.run.engine.simulate import simulate
from barbalat.run.kernel.grid import CHUNK_STEPS, segments_of
from barbalat.run.kernel.step import step_program
from barbalat.solvers.simulation import Simulation
from independent import brute_force, example_controllers

STEP = 2.0**-7


@pytest.fixture(scope="module")
def recorded_and_brute(problems):
    """About 60 recorded instants of 1003 steps, and every sample."""
    problem, steps = problems[2], 1003
    controller = L1Adaptive(gamma=50.0, filter=input_filter(0.1))
    samples = brute_force(ClosedLoop.of(problem, controller), problem.signals, "rk4", STEP, steps)
    simulation = Simulation(t_end=steps * STEP, dt=STEP, record_points=60)
    return simulate(problem, [controller], simulation)["L1"], samples


def test_recorded_instants_lie_on_the_grid_and_hold_its_samples(recorded_and_brute):
    result, samples = recorded_and_brute
    index = np.round(result.t / STEP).astype(int)
    np.testing.assert_array_equal(result.t, index * STEP)
    assert (index[0], index[-1]) == (0, 1003)
    assert 50 <= len(index) <= 70
    assert np.diff(index).max() <= 17  # 1003/60, rounded: no gap is longer than a block
    for name in ("e", "theta_hat", "u"):
        np.testing.assert_allclose(getattr(result, name), getattr(samples, name)[index], rtol=0, atol=1e-10)
    np.testing.assert_allclose(result.x, samples.states[index, :2], rtol=0, atol=1e-10)


def test_the_envelope_is_attained_and_bounds_every_sample(recorded_and_brute):
    """The envelope has the extrema of the samples, not only bounds, from t[k] up to but not including t[k + 1]."""
    result, samples = recorded_and_brute
    index = np.round(result.t / STEP).astype(int)
    for k, (first, last) in enumerate(pairwise(index)):
        for name in ("e", "theta_hat", "u"):
            part = getattr(samples, name)[first:last].reshape(last - first, -1)
            np.testing.assert_allclose(getattr(result.envelope, f"{name}_min")[k], part.min(axis=0), rtol=0, atol=1e-10)
            np.testing.assert_allclose(getattr(result.envelope, f"{name}_max")[k], part.max(axis=0), rtol=0, atol=1e-10)


def test_the_envelope_shows_what_decimation_hides(section_v):
    """In Fig. 3 the estimates sweep the whole box between two recorded instants."""
    result = simulate(
        section_v, [L1Adaptive(gamma=1e4, filter=input_filter(0.02))], Simulation(t_end=20.0, dt=1e-4, record_points=200)
    )["L1"]
    late = result.t[:-1] > 10
    swept = (result.envelope.theta_hat_max - result.envelope.theta_hat_min)[late]
    assert np.median(swept) > 5
    moved = np.abs(np.diff(result.theta_hat, axis=0))[late]
    assert (swept.max(axis=0) >= moved.max(axis=0)).all()


@pytest.mark.parametrize("steps", [1, 2, 3, 5, 7, 999, 2000, 2001, 12_345])
@pytest.mark.parametrize("record_points", [2, 3, 100, 2000])
def test_segments_cover_every_step_once_and_end_at_the_tail(steps, record_points):
    simulation = Simulation(t_end=steps * STEP, dt=STEP, record_points=record_points)
    position = 0
    for segment in segments_of(simulation, recorded=True):
        assert segment.start == position
        assert segment.length > 0
        assert segment.blocks > 0
        assert segment.in_tail == (4 * segment.start >= 3 * steps)
        position += segment.blocks * segment.length
    assert position == steps
    assert 4 * simulation.tail_start >= 3 * steps > 4 * (simulation.tail_start - 1)


@pytest.mark.parametrize(("t_end", "dt"), [(60.0, 1e-4), (2.4, 0.1), (0.7, 0.1), (1.0, 1 / 3)])
def test_time_on_the_grid(t_end, dt):
    """The product k dt is correct to 2 roundings even at the end of a long run, because steps are not summed."""
    simulation = Simulation(t_end=t_end, dt=dt)
    k = np.arange(simulation.steps + 1)
    np.testing.assert_allclose(simulation.time(k), k * np.longdouble(dt), rtol=5e-16)
    assert simulation.time(simulation.steps) == t_end


def peak_memory(simulation, problem, controller, record) -> int:
    """The largest number of bytes during a run."""
    loop = ClosedLoop.of(problem, controller)
    program = step_program(loop, simulation.solver, simulation.dt)
    program.compile(1)
    tracemalloc.start()
    batch = Batch(loop, program, loop.initial()[:, None], np.zeros((0, 1)), record=record)
    run([batch], problem.signals, simulation, threads=1)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


@pytest.mark.parametrize(("record", "record_points"), [(False, 2000), (True, 100), (True, 2)])
def test_memory_does_not_grow_with_the_run(problems, record, record_points):
    """Twelve chunks are compared with three, with 10 % for small objects. A table for all steps would be four times as large, and
    the record of a hundred instants is small."""

    def peak(chunks):
        simulation = Simulation(t_end=chunks * CHUNK_STEPS * STEP, dt=STEP, record_points=record_points)
        return peak_memory(simulation, problems[2], Mrac(gamma=2.0), record)

    short, long = peak(3), peak(12)
    assert long < 1.1 * short


def test_no_kernel_call_is_longer_than_a_chunk():
    """No call is longer even if few instants of very many steps are recorded, because the table of the signals is made for a
    whole call."""
    simulation = Simulation(t_end=1e6, dt=1e-3, record_points=10)
    assert next(iter(segments_of(simulation, recorded=True))).steps <= CHUNK_STEPS


def test_progress_rises_to_one(problems):
    seen = []
    simulation = Simulation(t_end=3 * CHUNK_STEPS * STEP, dt=STEP)
    simulate(problems[2], [Mrac(gamma=2.0)], simulation, progress=seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    assert len(seen) > 3


def test_controllers_side_by_side_are_as_each_alone(problems):
    controllers = [c for pair in example_controllers(2).values() for c in pair[:1]]
    simulation = Simulation(t_end=500 * STEP, dt=STEP)
    together = simulate(problems[2], controllers, simulation)
    assert list(together) == [c.name for c in controllers]
    for controller in controllers:
        alone = simulate(problems[2], [controller], simulation, threads=1)[controller.name]
        assert np.array_equal(alone.x, together[controller.name].x)
        assert alone.figures == together[controller.name].figures


def test_an_error_in_a_signal_reaches_the_user(problems):
    class Broken:
        def __call__(self, t):
            raise RuntimeError("the sensor's file is gone")

        before = __call__

    from barbalat.problem.state_feedback import Problem

    with pytest.raises(RuntimeError, match="sensor"):
        simulate(Problem(plant=problems[2].plant, reference=Broken()), [Mrac(gamma=1.0)], Simulation(t_end=1.0, dt=0.5))


def test_lanes_for_members():
    assert best_lanes(1) == 1
    for members in (2, 3, 5, 8, 9, 1000):
        lanes = best_lanes(members)
        assert lanes & (lanes - 1) == 0
        assert 1 < lanes < 2 * members or lanes == 2


def test_the_result_in_other_libraries(recorded_and_brute):
    """The numbers of a result, under the same names in pandas, xarray and python-control."""
    result, _ = recorded_and_brute
    table, dataset, response = result.to_pandas(), result.to_xarray(), result.to_control()
    assert table.index.name == "t"
    np.testing.assert_array_equal(table["theta_hat_2"].to_numpy(), result.theta_hat[:, 1])
    np.testing.assert_array_equal(table["u"].to_numpy(), result.u)
    np.testing.assert_array_equal(dataset["e"].sel(component=1).to_numpy(), result.e[:, 0])
    np.testing.assert_array_equal(dataset["t"].to_numpy(), result.t)
    assert isinstance(response, control.TimeResponseData)
    np.testing.assert_array_equal(response.outputs, result.x.T)
    np.testing.assert_array_equal(response.inputs, [result.r, result.u])


def test_numerics_in_one_line(recorded_and_brute):
    """The contracts compare h |lambda|max with eigenvalues of differences at the recorded instants. This test is on the printed
    line."""
    result, _ = recorded_and_brute
    for fragment in ("rk4", "0.0078125", f"{result.stiffness.h_lambda_max:.3g}", "2.83"):
        assert fragment in result.numerics
    assert "\n" not in result.numerics
