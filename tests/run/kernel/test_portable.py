"""Signals of runs without fused multiply-adds: the results are identical to those of the operation lists, whatever NumPy's
functions return."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barbalat import OutputPlant, Simulation, TransferFunction, load_case, simulate
from barbalat.lowering.compiled import evaluate, tabulator
from barbalat.lowering.functions import FUNCTIONS, function
from barbalat.run.engine.engine import Batch, run
from barbalat.run.kernel.grid import final_row, signal_table
from barbalat.run.kernel.portable import LIST_NAMES, Portable
from barbalat.run.kernel.step import output_function
from barbalat.signals import Chirp, Sine, Sines
from lowering.functions.test_functions import evaluated
from lowering.test_c99 import same_bits

SIMULATION = Simulation(t_end=20.0, dt=1e-3, fused=False)


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
@pytest.mark.parametrize("count", [0, 1, 37])
def test_arrays_have_the_bits_of_single_numbers(name, count) -> None:
    x = np.random.default_rng(1).uniform(0.1, 9, (function(name).arguments, count))
    assert same_bits(evaluate(name, *x), evaluated(name, *x) if count else np.empty(0))


def test_a_command_comes_from_the_list() -> None:
    signal = Sine(amplitude=50.0, frequency=0.5, phase=0.1, constant=2.0)
    table = signal_table((signal,), SIMULATION, 100, 5000)
    for column, node in enumerate((0.0, 0.5, 1.0)):
        t = SIMULATION.time(np.arange(100, 5100) + node)
        assert same_bits(table[:, column], 2.0 + 50.0 * evaluated("sin", 0.5 * t + 0.1))
    assert final_row((signal,), SIMULATION)[0, 0] == 2.0 + 50.0 * evaluated("sin", np.array([0.5 * 20 + 0.1]))[0]


@pytest.mark.parametrize("signal", [Sines((1.0, 2.0), (3.0, 7.0)), Chirp(1.0, 0.5, 9.0, 10.0)])
def test_other_signals_do_too(signal) -> None:
    """The values agree with NumPy's to within 2 ulp of each term, and the table is the same on every computer. The sum below is
    over its bits."""
    t = SIMULATION.time(np.arange(20_000)).view(Portable)
    found = np.asarray(signal(t))
    assert np.allclose(found, signal(np.asarray(t)), rtol=0, atol=2e-15)
    assert (found != signal(np.asarray(t))).any() or (np.sin(np.arange(1e4)) == evaluated("sin", np.arange(1e4))).all()


def test_what_a_user_writes_with_numpy() -> None:
    """Functions of quantities derived from the time are traced, in place or not, also through NumPy's functions that return plain
    arrays."""
    t = np.linspace(0, 9, 1000)

    def written(t):
        held = np.where(t < 5, t, 5.0)
        total = np.zeros(t.shape)
        total += np.exp(-held) * np.sin(np.clip(3 * t, 0, 20))
        return np.tanh(total) + np.cumsum(np.cos(t)) + t**3.0

    def by_lists(t):
        held, clipped = np.where(t < 5, t, 5.0), np.clip(3 * t, 0, 20)
        total = evaluated("exp", -held) * evaluated("sin", clipped)
        return evaluated("tanh", total) + np.cumsum(evaluated("cos", t)) + evaluated("pow", t, np.full(1000, 3.0))

    found = written(t.view(Portable))
    assert same_bits(np.asarray(found), by_lists(t))
    assert isinstance(np.concatenate([t.view(Portable), t]), Portable)
    assert set(LIST_NAMES.values()) == FUNCTIONS - {"ndtri"}  # only for noise: NumPy has no such function


def test_a_run_uses_them() -> None:
    case = load_case("paper")
    simulation = replace(case.simulation, t_end=2.0, fused=False)
    (run, *_) = simulate(case.problem, case.controllers, simulation).values()
    assert same_bits(run.r, 50.0 * evaluated("sin", 0.5 * run.t))


@pytest.mark.parametrize(
    ("case", "name"), [("l1-output", "L1 output"), ("first-order", "MRAC, sampled"), ("paper", "Robust MRAC")]
)
def test_outputs_are_those_of_the_equations_but_for_roundings(case, name) -> None:
    """The outputs are compared with CasADi's evaluation of the same function at the recorded states, as in fused runs."""
    given = load_case(case)
    (controller,) = (c for c in given.controllers if c.name == name)
    simulation = replace(given.simulation, t_end=2.0, fused=False)
    (run,) = simulate(given.problem, [controller], simulation).values()
    command = run.r if run.r.ndim > 1 else run.r[:, None]
    loop = run.loop
    signals = np.zeros((loop.signal_count, len(run.t)))
    for i, signal in enumerate(given.problem.signals):
        signals[i] = signal(run.t)
    assert np.allclose(signals[: command.shape[1]].T, command, rtol=0, atol=1e-13)
    e, u, theta_hat, x, x_m, _ = (np.asarray(value).T for value in output_function(loop)(run.states.T, signals))
    for found, expected in ((run.e, e), (run.u[:, None], u), (run.theta_hat, theta_hat), (run.x, x), (run.x_m, x_m)):
        assert found.shape == expected.shape
        # a few roundings of terms that may cancel; the largest are in u
        assert np.allclose(found, expected, rtol=0, atol=1e-13 * (1 + np.abs(u).max()))


def test_the_outputs_functions_are_the_lists() -> None:
    import casadi as ca

    x, s = ca.SX.sym("x", 2), ca.SX.sym("s", 1)
    function = ca.Function("f", [x, s], [ca.sin(x), x[0] * s + x[1] * s, ca.SX(0, 1), ca.vertcat(0, ca.exp(s))])
    rng = np.random.default_rng(8)
    states, signals = rng.uniform(-9, 9, (2, 50)), rng.uniform(-9, 9, (1, 50))
    sines, total, nothing, exponentials = tabulator(function)(states, signals)
    assert same_bits(sines, np.array([evaluated("sin", row) for row in states]))
    assert same_bits(total, states[:1] * signals + states[1:] * signals)
    assert nothing.shape == (0, 50)
    assert same_bits(exponentials, np.array([np.zeros(50), evaluated("exp", signals[0])]))
    assert [part.shape for part in tabulator(function)(np.zeros((2, 0)), np.zeros((1, 0)))] == [(2, 0), (1, 0), (0, 0), (2, 0)]


@pytest.mark.parametrize("case", ["paper", "rohrs", "first-order"])
def test_no_bit_depends_on_which_numbers_a_kernel_is_handed(case) -> None:
    """A run alone equals that among members with different plants. With fused operations a compiled-in number would be rounded
    differently."""
    given = load_case(case)
    simulation = replace(given.simulation, t_end=2.0, fused=False)
    for controller in given.controllers:
        alone = Batch.of([(given.problem, controller)], simulation, lanes=1)
        others = [(moved(given.problem, share), controller) for share in (0.9, 1.1)]
        together = Batch.of([(given.problem, controller), *others], simulation, lanes=1)
        for batch in (alone, together):
            run([batch], given.problem.signals, simulation)
        assert same_bits(alone.final_states[:, 0], together.final_states[:, 0])
        assert not same_bits(together.final_states[:, 1], together.final_states[:, 2])
        assert alone.metrics(simulation).of_member(0) == together.metrics(simulation).of_member(0)


def moved(problem, share):
    """The given problem with a slightly different plant."""
    if isinstance(problem.plant, OutputPlant):
        plant = problem.plant.transfer_function
        return replace(problem, plant=replace(problem.plant, transfer_function=TransferFunction(share * plant.num, plant.den)))
    return replace(problem, plant=replace(problem.plant, theta=share * problem.plant.theta))
