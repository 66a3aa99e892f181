"""The certificate of active disturbance rejection: its bound and its margins, each compared with runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barbalat import Adrc, ParameterBox, Plant, TransferFunction, certify, load_case, simulate
from barbalat.certificates.certificates import table_1
from barbalat.plants import PlantInput
from barbalat.signals import Sine, Step
from barbalat.solvers.simulation import Simulation

SIMULATION = Simulation(t_end=10.0, dt=1e-3)


def certified(problem, controller, keys=None):
    found = certify(problem, [controller], SIMULATION, keys=keys)
    (column,) = table_1(problem, [controller], found).columns
    return found[controller.name], column


def random_member(problems, seed):
    """A random problem of order 1 to 3 with either observer, nominal parameters and a known input gain other than 1."""
    rng = np.random.default_rng(seed)
    n = 1 + seed % 3
    given, b_0 = problems[n], 10 ** rng.uniform(-0.5, 0.5)
    middle = rng.uniform(-0.5, 0.5, n)
    box = ParameterBox(lower=middle - 0.3, upper=middle + 0.3)
    problem = replace(
        given,
        plant=replace(given.plant, theta=rng.uniform(box.lower, box.upper), x0=rng.normal(size=n), input=PlantInput(gain=b_0)),
        uncertainty=box,
        reference=Sine(amplitude=rng.uniform(0.1, 5), frequency=10 ** rng.uniform(-1, 1)),
    )
    output = None if seed % 2 else np.eye(n)[0]
    return problem, Adrc(bandwidth=10 ** rng.uniform(1, 2), output=output, nominal=middle, b_0=b_0)


@pytest.mark.dear
def test_the_bound_holds_along_runs(problems, sample):
    bounds = []
    for seed in range(sample(8, 60)):
        problem, controller = random_member(problems, seed)
        found, _ = certified(problem, controller, ("error_bound",))
        (run,) = simulate(problem, [controller], SIMULATION).values()
        if "error_bound" in found.guaranteed:
            bounds.append(found.values["error_bound"])
            assert max(run.figures["max_abs_e"]) <= bounds[-1], seed
    assert len(bounds) > 4  # the bound applies to most of them


def test_the_bound_by_hand(problems):
    """For x' = -x + 2 (u + theta x) and omega_o = 9, T = 2 s/((s + 1)(s + 9)), and the integral of |g| is 2 * 2 * the largest
    step response.

    The step response (e^-t - e^-9t)/4 is largest at t* = ln(9)/8. The tolerance 1e-5 is the enclosure's width.
    """
    box = ParameterBox(lower=[-1.0], upper=[1.0])
    problem = replace(problems[1], plant=replace(problems[1].plant, theta=[0.5], x0=[0.0]), uncertainty=box)
    found, column = certified(problem, Adrc(bandwidth=9.0))
    t = np.log(9) / 8
    N = 2 * 2 * (np.exp(-t) - np.exp(-9 * t)) / 8
    assert found.values["condition"]["value_upper"] == pytest.approx(N, rel=1e-5)
    x_m = 2 * 0.5 * 2.0  # the L1 norm of 2/(s + 1), k_0 = 0.5, |r| <= 2
    assert found.values["error_bound"] == pytest.approx(N * x_m / (1 - N), rel=1e-5)
    assert column.cells["transient"].applies and not column.cells["tracking"].applies  # a sine
    _, column = certified(replace(problem, reference=Step(1.0, start=1.0)), Adrc(bandwidth=9.0))
    assert column.cells["tracking"].applies


@pytest.mark.parametrize("output", [None, [1.0, 0.0]])
def test_the_delay_margin_is_where_runs_are_lost(problems, output):
    """With an actuator and half of the input gain, runs of 200 s with delays 5 % below and above the margin are stable and
    unstable."""
    path = PlantInput(gain=0.5, actuator=TransferFunction([30.0], [1.0, 30.0]))
    plant = replace(problems[2].plant, theta=[3.0, 2.0], input=path)
    problem, controller = replace(problems[2], plant=plant, uncertainty=None), Adrc(bandwidth=8.0, output=output)
    margin = certified(problem, controller, ("delay_margin",))[0].values["delay_margin"]
    lost = []
    for factor in (0.95, 1.05):
        delayed = replace(problem, plant=replace(plant, input=replace(path, delay=factor * margin)))
        (run,) = simulate(delayed, [controller], Simulation(t_end=200.0, dt=2e-3)).values()
        lost.append(run.diverged_at is not None or max(run.figures["tail_max_abs_e"]) > 10)
    assert lost == [False, True]


def test_a_wrong_gain_leaves_the_margins_and_the_bound_of_the_case_s_loop_alone(problems):
    problem = replace(problems[2], plant=replace(problems[2].plant, theta=[0.1, 0.1], input=PlantInput(gain=0.8)))
    found, column = certified(problem, Adrc(bandwidth=60.0))
    assert "b_0 = 1 is assumed" in found.entry("error_bound_worst").why
    assert "theta and the input gain are those given in the case" in found.entry("error_bound").assumptions
    assert (
        "for every r and d within the case's bounds, with the case's theta and input gain only" in column.cells["stability"].text
    )
    assert "delay_margin" in found.values
    found, _ = certified(problem, Adrc(bandwidth=60.0, b_0=0.8), ("error_bound",))
    assert "error_bound" in found.guaranteed


def test_the_step_that_a_fast_observer_tolerates(problems):
    """The step is the limit for RK4. With a step longer by a fifth, the loop is outside the solver's stability region."""
    problem, controller = replace(problems[1], uncertainty=None), Adrc(bandwidth=900.0)
    step = certified(problem, controller, ("step_max",))[0].values["step_max"]
    labels = []
    for factor in (0.9, 1.2):
        (run,) = simulate(problem, [controller], Simulation(t_end=100 * factor * step, dt=factor * step)).values()
        labels.append(run.label is not None)
    assert labels == [False, True]


def test_an_aircraft_whose_gain_is_unknown_has_margins_too():
    """The case is f16-short-period, at 70 % effectiveness. With several inputs and other regressors the margins come from
    linearisation."""
    case = load_case("f16-short-period")
    found, _ = certified(case.problem, Adrc(bandwidth=3.0), ("delay_margin", "error_bound"))
    assert found.values["delay_margin"] > 0 and "error_bound" not in found.values
    rocking = load_case("wing-rock")
    found, column = certified(rocking.problem, Adrc(bandwidth=3.0))
    assert found.values["delay_margin"] > 0 and not column.cells["stability"].applies


def test_nothing_is_claimed_of_an_unstable_loop(problems):
    """A theta_0 with which A is far from Hurwitz causes no problem, but an observer that is too slow for the plant does."""
    plant = Plant(A_m=[[0.0, 1.0], [-1.0, -1.0]], b=[0.0, 1.0], theta=[5.0, 5.0])
    box = ParameterBox(lower=[4.9, 4.9], upper=[5.1, 5.1])
    problem = replace(problems[2], plant=plant, uncertainty=box)
    assert "error_bound" in certified(problem, Adrc(bandwidth=5.0, nominal=[5.0, 5.0]), ("error_bound",))[0].guaranteed
    found, column = certified(problem, Adrc(bandwidth=0.5, nominal=[0.0, 0.0]))
    assert "error_bound" not in found.values and not column.cells["stability"].applies
