"""Attacks on the bound for the case's own command: random theta and theta from a search, every kind of command, and every
step."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import barbalat_check
from barbalat import (
    Adrc,
    DirectMrac,
    L1Adaptive,
    Mrac,
    MracClosedLoop,
    ParameterBox,
    Problem,
    Simulation,
    certify,
    input_filter,
    simulate_ensemble,
)
from barbalat.certificates.proof import proof
from barbalat.designs import pi_feedback
from barbalat.papers.jafari_2013 import section_v
from barbalat.plants import ParameterBall, PlantInput
from barbalat.protocols import Controller
from barbalat.signals import Chirp, Constant, Sine
from certificates.bounds import random_problems

KEY = "error_bound_command"
SIMULATION = Simulation(t_end=8.0, dt=1e-3)


def bound_of(problem: Problem, controller: Controller, simulation: Simulation = SIMULATION):
    return certify(problem, [controller], simulation, keys=(KEY,))[controller.name].entry(KEY)


def worst_run(problem: Problem, controller: Controller, rng: np.random.Generator, simulation: Simulation = SIMULATION) -> float:
    """The largest |e_i| at any step for 16 thetas, some of them vertices, and then twice for 16 thetas around the worst three."""
    box = problem.uncertainty
    thetas = np.vstack([box.extreme_points(rng, 8), box.drawn(rng, 8)])
    largest, width = 0.0, 0.3
    for _ in range(3):
        members = [(replace(problem, plant=replace(problem.plant, theta=theta)), controller) for theta in thetas]
        peaks = simulate_ensemble(members, simulation).metrics.max_abs_e.max(axis=1)
        largest = max(largest, float(peaks.max()))
        best = thetas[np.argsort(-peaks)[:3]]
        moved = best[rng.integers(0, 3, 16)] + width * (box.upper - box.lower) * rng.normal(size=(16, box.size))
        thetas, width = box.brought_in(moved), width / 3
    return largest


def schemes(problem: Problem, start: np.ndarray, gamma: float, C) -> list[Controller]:
    L = -0.5 * np.eye(problem.known.n)
    return [
        L1Adaptive(gamma=gamma, filter=C, theta_hat0=start, name="L1"),
        Mrac(gamma=gamma, theta_hat0=start, name="MRAC"),
        MracClosedLoop(gamma=gamma, theta_hat0=start, model_feedback=L, name="closed"),
        DirectMrac(gamma=gamma, theta_hat0=start, name="direct"),
    ]


@pytest.mark.parametrize("command", [*random_problems.COMMANDS, Constant(1.1)], ids=lambda one: type(one).__name__)
@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.short(kept=lambda n, command: n == 2)
def test_no_run_exceeds_it(n, command):
    """Estimates start anywhere in the set. The bound holds for this start, this command and every theta."""
    rng = np.random.default_rng(40 + n)
    group, C = None, None
    while C is None:
        group = random_problems.system(rng, n, command)
        C = random_problems.admissible_filter(rng, group, 1)
    problem = max(group, key=lambda one: one.uncertainty.theta_max)
    for controller in schemes(problem, random_problems.start_of(rng, problem), 10 ** rng.uniform(0, 2), C):
        entry = bound_of(problem, controller)
        assert entry.kind == "guaranteed", (controller.name, entry.why)
        assert worst_run(problem, controller, rng) <= entry.value, controller.name


@pytest.mark.parametrize("command", [*random_problems.COMMANDS, Constant(1.1)], ids=lambda one: type(one).__name__)
@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.short(kept=lambda n, command: n == 1)
def test_the_checker_accepts_it_and_nothing_smaller(n, command):
    """The test covers scalar and diagonal gains, random plants and every kind of command."""
    rng = np.random.default_rng(60 + n)
    group, C = None, None
    while C is None:
        group = random_problems.system(rng, n, command)
        C = random_problems.admissible_filter(rng, group, 1)
    problem, simulation = max(group, key=lambda one: one.uncertainty.theta_max), Simulation(t_end=4.0, dt=1e-3)
    start, gamma = random_problems.start_of(rng, problem), 10 ** rng.uniform(0, 2, n)
    controllers = [*schemes(problem, start, float(gamma[0]), C), Mrac(gamma=gamma, theta_hat0=start, name="diagonal")]
    controllers += [L1Adaptive(gamma=gamma, filter=C, theta_hat0=start, name="L1, diagonal")]
    refuse_what_is_smaller(problem, controllers, simulation)


def refuse_what_is_smaller(problem: Problem, controllers: list[Controller], simulation: Simulation) -> None:
    """The checker accepts the proof of each controller's bound and rejects a bound that is smaller by one part in ten million."""
    certificates = certify(problem, controllers, simulation, keys=(KEY, "norms"))
    document = json.loads(json.dumps(proof("random", problem, controllers, simulation, certificates)))
    for name, one in document["controllers"].items():
        assert not one["not in the proof"], name
        (line,) = [line for line in one["lines"] if line["key"] == KEY]
        alone = document | {"controllers": {name: one}}
        barbalat_check.check(alone)
        line["value"] *= 1 - 1e-7
        with pytest.raises(barbalat_check.Refused, match=KEY):
            barbalat_check.check(alone)


@pytest.mark.parametrize(
    "command", [*random_problems.COMMANDS, section_v.problem().reference], ids=lambda one: type(one).__name__
)
@pytest.mark.short(kept=lambda command: command == section_v.problem().reference)
@pytest.mark.dear
def test_the_checker_follows_linear_loops(command):
    """The checker follows loops with a PI controller and with an observer through jumps and along sines, with the state away from
    the model's."""
    given, simulation = section_v.problem(), Simulation(t_end=5.0, dt=1e-3)
    slow = Adrc(bandwidth=60.0, b_0=1.0, name="ADRC")
    problem = replace(given, reference=command)
    refuse_what_is_smaller(problem, [pi_feedback(given.known, unmodelled_delay=0.01), slow], simulation)


def test_section_v_is_tight():
    """The goal is a factor of three between the bound and the worst run found by a search. The bound for every |r| <= 50 is
    521."""
    given, rng = section_v.problem(), np.random.default_rng(1)
    slow = Simulation(t_end=20.0, dt=1e-3)
    for controller, simulation, most in (
        (L1Adaptive(gamma=100.0, filter=input_filter(section_v.KAPPA), name="L1"), replace(slow, dt=2e-4), 1.3),
        (Mrac(gamma=1.0, name="MRAC"), slow, 2.0),
        (replace(pi_feedback(given.known, unmodelled_delay=0.01), name="PI"), slow, 1.5),
    ):
        bound, found = bound_of(given, controller, simulation).value, worst_run(given, controller, rng, simulation)
        assert found <= bound <= most * found, controller.name


def test_it_is_within_the_bound_for_all_commands():
    given, simulation = section_v.problem(), Simulation(t_end=60.0, dt=1e-4)
    found = certify(given, [section_v.l1("L1", 1e4), Mrac(gamma=1.0, name="MRAC")], simulation)
    assert found["L1"].values[KEY] < 0.12 * found["L1"].values["error_bound"]
    assert found["MRAC"].values[KEY] < found["MRAC"].values["error_bound_worst"]


def test_fewer_seconds_never_need_more():
    given, controller = section_v.problem(), section_v.l1("L1", 1e4)
    values = [bound_of(given, controller, Simulation(t_end=t, dt=1e-3)).value for t in (1.0, 5.0, 25.0)]
    assert values == sorted(values)


@pytest.mark.dear
def test_where_it_is_not_known_the_reason_is_said():
    given, controller = section_v.problem(), section_v.l1("L1", 1e4)
    swept = replace(given, reference=Chirp(amplitude=1.0, frequency_start=0.1, frequency_end=1.0, duration=5.0))
    assert "sums of sines" in bound_of(swept, controller).why
    ball = replace(given, uncertainty=ParameterBall(center=np.zeros(2), radius=5.0))
    assert "ball" in bound_of(ball, controller).why
    delayed = replace(given, plant=replace(given.plant, input=PlantInput(delay=0.01)))
    assert "delay" in bound_of(delayed, controller).why
    disturbed = replace(given, disturbance=Sine(amplitude=1.0, frequency=1.0))
    assert "disturbance" in bound_of(disturbed, controller).why
    outside = replace(given, uncertainty=ParameterBox(lower=[-3.0, -3.0], upper=[3.0, 3.0]))
    assert "outside" in bound_of(outside, controller).why
