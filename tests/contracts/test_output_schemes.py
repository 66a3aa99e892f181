"""The contract of every registered output-feedback scheme, as in tests/contracts/test_schemes.py for the others."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, fields, replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from barbalat.controllers import Mrac, Sampled
from barbalat.controllers.output import OUTPUT_SCHEMES, L1OutputPiecewiseConstant, LinearOutput
from barbalat.linear.systems import TransferFunction
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.output_feedback import OutputPlant, OutputProblem, OutputReferenceModel
from barbalat.protocols import Controller, SampledEquations
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.engine.simulate import simulate
from barbalat.signals import Constant, Sine
from barbalat.solvers import SOLVERS
from barbalat.solvers.simulation import Simulation
from independent import (
    brute_force,
    example_output_controllers,
    jacobian_against_differences,
    refusal,
    symbols_against_numbers,
)

PLANTS = {
    1: TransferFunction([2.0], [1.0, -0.5]),
    2: TransferFunction([2.0, 3.0], [1.0, 1.0, -0.5]),
    3: TransferFunction([1.5, 4.5, 3.0], [1.0, 2.0, 1.0, -0.2]),
}
"""Unstable, minimum phase, of relative degree one."""
EXAMPLES = [
    (name, n, i) for name in OUTPUT_SCHEMES for n in PLANTS for i in range(len(example_output_controllers(n).get(name, [None])))
]

SHORT_PAIRS = {(1, "rk4"), (2, "euler"), (2, "heun")}
"""The short tests vary order and solver together. Tests that do not depend on the order use only the second one."""


def problem(n, **changes):
    given = {
        "plant": OutputPlant(transfer_function=PLANTS[n]),
        "reference_model": OutputReferenceModel(transfer_function=TransferFunction([2.0], [1.0, 2.0])),
        "reference": Sine(1.0, 1.0),
    }
    return OutputProblem(**(given | changes))


@pytest.fixture(params=EXAMPLES, ids=[f"{name}-n{n}-{i}" for name, n, i in EXAMPLES])
def example(request):
    name, n, i = request.param
    table = example_output_controllers(n)
    if name not in table:
        pytest.fail(f"the scheme {name!r} is registered but has no example settings: add them to tests/independent.py")
    return problem(n), table[name][i]


@cache
def long_run(n, name, i):
    controller = example_output_controllers(n)[name][i]
    return simulate(problem(n), [controller], Simulation(t_end=64.0, dt=2.0**-7))[controller.name]


@pytest.mark.short(kept=lambda example: example[1] == 2)
def test_the_registry_knows_the_class(example):
    _, controller = example
    assert type(controller) in OUTPUT_SCHEMES.values()
    assert isinstance(controller, Controller)
    assert controller.feedback == "output"


@pytest.mark.short(kept=lambda example: example[1] == 2)
def test_symbols_and_numbers_agree(example):
    symbols_against_numbers(ClosedLoop.of(*example), size=1.0)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.short(kept=lambda example, solver: (example[1], solver) in SHORT_PAIRS)
def test_the_kernel_does_what_plain_stepping_does(example, solver):
    given, controller = example
    dt, steps = 2.0**-7, 128
    samples = brute_force(ClosedLoop.of(given, controller), given.signals, solver, dt, steps)
    simulation = Simulation(t_end=steps * dt, dt=dt, solver=SOLVERS[solver], record_points=steps)
    result = simulate(given, [controller], simulation)[controller.name]
    np.testing.assert_allclose(result.e, samples.e, rtol=0, atol=1e-9)
    np.testing.assert_allclose(result.theta_hat, samples.theta_hat, rtol=0, atol=1e-9)
    np.testing.assert_allclose(result.u, samples.u, rtol=0, atol=1e-8)


@pytest.mark.short(kept=lambda example: example[1:] == (2, 0))
def test_the_error_of_a_solver_falls_with_its_order(example):
    """RK4's step is halved three times before any bound is reached. Each difference is smaller than the previous one by a factor
    of 2^4 = 16, within a third."""
    given, controller = example
    ends = []
    for k in range(4):
        simulation = Simulation(t_end=1.0, dt=2.0 ** -(8 + k), record_points=16)
        ends.append(simulate(given, [controller], simulation)[controller.name].states[-1])
    first, second, third = (np.abs(a - b).max() for a, b in pairwise(ends))
    floor = 1e-12 * np.abs(ends[-1]).max()
    assert second < floor or 10 < first / second < 24
    assert third < floor or 10 < second / third < 24


@pytest.mark.short(kept=lambda example: example[1] == 2)
def test_the_exact_jacobian_against_differences(example):
    jacobian_against_differences(ClosedLoop.of(*example))


@pytest.mark.parametrize(("name", "n", "i"), EXAMPLES)
@pytest.mark.short(kept=lambda name, n, i: n == 2)
def test_it_tracks(name, n, i):
    """The tail error is a fraction of the model's output, 0.9. Without control the unstable plants exceed all bounds."""
    run = long_run(n, name, i)
    assert run.diverged_at is None
    assert run.figures["tail_max_abs_e"][0] < 0.5


@pytest.mark.parametrize(("name", "n", "i"), EXAMPLES)
@pytest.mark.short(kept=lambda name, n, i: n == 2)
def test_shapes_and_numbers_of_a_result(name, n, i):
    run = long_run(n, name, i)
    count, initial = len(run.t), run.controller.bind(run.problem.known).initial()
    estimates = initial.theta_hat.size if "theta_hat" in initial._fields else 0
    assert run.e.shape == (count, 1)
    assert run.y.shape == run.u.shape == run.r.shape == (count,)
    assert run.theta_hat.shape == (count, estimates)
    assert set(run.figures) >= {"max_abs_e", "rms_e", "max_abs_u", "max_abs_y", "diverged_at"}
    assert run.figures["max_abs_y"] >= np.abs(run.y).max()
    for value in [*run.columns().values(), run.stiffness.h_lambda_max]:
        assert np.isfinite(value).all()


@pytest.mark.short(kept=lambda example: example[1] == 2)
def test_settings_are_frozen(example):
    _, controller = example
    for field in fields(controller):
        with pytest.raises(FrozenInstanceError):
            setattr(controller, field.name, 1.0)


@pytest.mark.short(kept=lambda example: example[1] == 2)
def test_rest_stays_rest(example):
    """With r = 0 and d = 0 nothing moves, not even by a rounding."""
    given, controller = example
    (run,) = simulate(replace(given, reference=Constant(0.0)), [controller], Simulation(t_end=1.0, dt=2.0**-6)).values()
    start = run.theta_hat[0]
    assert not run.y.any() and not run.u.any() and not run.e.any()
    np.testing.assert_array_equal(run.theta_hat, np.tile(start, (len(run.t), 1)))


@pytest.mark.short(kept=lambda example: example[1:] == (1, 0))
def test_disturbances_reach_the_plant(example):
    given, controller = example
    simulation = Simulation(t_end=4.0, dt=2.0**-8)
    changes = ({}, {"disturbance": Constant(0.0), "output_disturbance": Constant(0.0)}, {"disturbance": Sine(1.0, 2.0)},
               {"output_disturbance": Sine(0.5, 2.0)})  # fmt: skip
    without, zero, some, other = (
        simulate(replace(given, **change), [controller], simulation)[controller.name] for change in changes
    )
    np.testing.assert_allclose(zero.y, without.y, atol=1e-10)
    assert np.abs(some.y - without.y).max() > 1e-2
    assert np.abs(other.y - without.y).max() > 1e-2


@pytest.mark.short(kept=lambda example: example[1] == 1)
def test_a_member_of_an_ensemble_is_the_run_alone(example):
    given, controller = example
    simulation = Simulation(t_end=4.0, dt=2.0**-7)
    alone = simulate(given, [controller], simulation)[controller.name].metrics
    metrics = simulate_ensemble([(given, controller)] * 5, simulation).metrics
    np.testing.assert_array_equal(metrics.max_abs_e, np.tile(alone.max_abs_e, (5, 1)))


@pytest.mark.parametrize("discretization", ["euler", "midpoint"])
@pytest.mark.short(kept=lambda example, discretization: example[1] == 2 and (discretization == "midpoint" or example[2] == 0))
def test_sampled_fast_it_is_the_continuous_controller(example, discretization):
    """At a sample time of 2^-9 s the run differs from the continuous one by the error of a zero-order hold."""
    given, controller = example
    if isinstance(controller.bind(given.known), SampledEquations):
        assert ("is already sampled") in refusal(
            lambda: Sampled(controller, 2.0**-9, discretization=discretization).bind(given.known)
        )
        return
    try:
        sampled = Sampled(controller=controller, sample_time=2.0**-9, discretization=discretization)
        sampled.bind(given.known)
    except ValueError as error:
        assert discretization == "midpoint" and "midpoint" in str(error)  # rejected if there is no proof
        pytest.skip(str(error))
    simulation = Simulation(t_end=3.0, dt=2.0**-10)
    held, continuous = (simulate(given, [c], simulation)[controller.name] for c in (sampled, controller))
    assert np.abs(held.y - continuous.y).max() < 0.05 * np.abs(continuous.y).max()


@pytest.mark.short(kept=lambda example: example[1] == 2)
def test_what_measures_the_state_is_refused(example):
    given, controller = example
    assert "feeds back the state" in refusal(lambda: ClosedLoop.of(given, Mrac(gamma=1.0)))
    linear = LinearOutput, L1OutputPiecewiseConstant
    assert isinstance(controller, linear) or controller.bind(given.known).initial().theta_hat.size
