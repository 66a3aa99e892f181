"""Loops with hundreds of states: the code is compiled quickly, its results are bit-identical, and a label needs only a few
spectra."""

import numpy as np
import pytest

from barbalat import NormalizedMrac, Plant, Problem, ReferenceModel, Simulation, simulate
from barbalat.laws import LeastSquares
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.run.engine.engine import Batch
from barbalat.run.kernel import step as kernel_step
from barbalat.run.kernel.step import LARGEST_WATCHED_STATE, step_program
from barbalat.signals import Sine
from independent import example_controllers


def large(n=10):
    """A chain of n states with least squares, which has n^2 entries of the covariance and as many filtered states."""
    A_m = np.diag(-1.0 - 0.05 * np.arange(n)) + np.diag(np.ones(n - 1), 1)
    plant = Plant(A_m=A_m, b=np.eye(n)[-1], theta=np.full(n, 0.1), x0=np.full(n, 0.1))
    problem = Problem(plant=plant, reference_model=ReferenceModel(k_0=1.0), reference=Sine(amplitude=1.0, frequency=0.5))
    return problem, NormalizedMrac(law=LeastSquares(covariance0=100.0), c_0=np.eye(n)[-1])


@pytest.fixture(scope="module")
def problem_and_controller():
    return large()


def after_128_steps(problem, controller, worth_optimising, monkeypatch):
    """The kernel and its state after 128 steps."""
    monkeypatch.setattr(kernel_step, "STEPS_WORTH_OPTIMISING", worth_optimising)
    kernel_step.compiled.cache_clear()
    batch = Batch.of([(problem, controller)], Simulation(t_end=0.125, dt=2.0**-10))
    table = np.ones((128, batch.program.shape.signals))
    batch.groups[0].call(0, 1, 128, batch.groups[0].state, table)
    return batch.groups[0].kernel, batch.final_states


def same_bits(problem, controller, monkeypatch):
    (optimised, its), (quick, others) = (after_128_steps(problem, controller, k, monkeypatch) for k in (0, 10**9))
    assert optimised is not quick
    np.testing.assert_array_equal(its, others)


def test_quickly_made_code_of_a_large_loop_gives_the_same_bits(problem_and_controller, monkeypatch):
    same_bits(*problem_and_controller, monkeypatch)


@pytest.mark.parametrize("scheme", example_controllers(2))
def test_quickly_made_code_gives_the_same_bits(scheme, problems, monkeypatch):
    for controller in example_controllers(2)[scheme][:2]:
        same_bits(problems[2], controller, monkeypatch)


def test_code_is_optimised_once_its_runs_are_long_enough_in_all(problem_and_controller, monkeypatch):
    made = []
    monkeypatch.setattr(kernel_step, "Kernel", lambda *_, quickly, **__: made.append(quickly) or object())
    kernel_step.compiled.cache_clear()
    problem, controller = problem_and_controller
    program = step_program(ClosedLoop.of(problem, controller), Simulation(t_end=1, dt=1e-3).solver, 1e-3)
    for steps in (10, kernel_step.STEPS_WORTH_OPTIMISING - 11, 1, 10):
        program.compile(1, steps)
    program.compile(2)
    kernel_step.compiled.cache_clear()
    assert made == [True, False, False]


@pytest.mark.short(kept=lambda dt, stable: not stable)
@pytest.mark.parametrize(("dt", "stable"), [(1e-3, True), (0.1, False)])
def test_the_label_of_a_large_loop(dt, stable):
    """The fastest mode belongs to the plant, at 30 per second. h lambda = 3 exceeds RK4's 2.79."""
    n = 10
    rates = np.append(np.arange(1.0, n), 30.0)
    plant = Plant(A_m=np.diag(-rates) + np.diag(np.ones(n - 1), 1), b=np.eye(n)[-1], theta=np.full(n, 0.1), x0=np.full(n, 0.1))
    problem = Problem(plant=plant, reference_model=ReferenceModel(k_0=1.0), reference=Sine(amplitude=1.0, frequency=0.5))
    controller = NormalizedMrac(law=LeastSquares(covariance0=100.0), c_0=np.eye(n)[-1])
    (result,) = simulate(problem, [controller], Simulation(t_end=2.0, dt=dt)).values()
    assert ClosedLoop.of(problem, controller).size > LARGEST_WATCHED_STATE
    found = result.stiffness
    assert found.looks < 100 and found.h_lambda_max == pytest.approx(30.0 * dt, rel=0.02)
    assert (found.unstable_from is None) == stable
    assert stable or found.unstable_from < 0.5


def test_a_small_loop_is_watched(problem_and_controller):
    problem, controller = large(3)
    assert Batch.of([(problem, controller)], Simulation(t_end=0.1, dt=1e-3), windows=10).watch is not None
    assert Batch.of([problem_and_controller], Simulation(t_end=0.1, dt=1e-3), windows=10).watch is None
