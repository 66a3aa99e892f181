"""Theorem 1 with bounded disturbances, attacked by plain NumPy and RK4, which share no code with the package."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

import barbalat_check
from barbalat import (
    DirectMrac,
    L1Adaptive,
    Mrac,
    MracClosedLoop,
    ParameterBox,
    Plant,
    Problem,
    ReferenceModel,
    Simulation,
    certify,
    input_filter,
)
from barbalat.certificates.proof import proof
from barbalat.controllers.control_gains import sets_of_ideal_gains
from barbalat.laws import CompositeLearning
from barbalat.plants import ParameterBall, PlantInput
from barbalat.problem.tracking import Disturbance
from barbalat.signals import Sine

SIMULATION = Simulation(t_end=10.0, dt=1e-3)


def random_problem(rng: np.random.Generator, n: int, *, unmatched: bool) -> Problem:
    """A companion A_m, theta at a vertex of its box, and a disturbance whose effect is as large as that of r."""
    poles = -rng.uniform(0.5, 4.0, n)
    A_m = np.vstack([np.eye(n)[1:], -np.poly(poles)[:0:-1]]) if n > 1 else np.array([[poles[0]]])
    b, half = np.eye(n)[-1] * rng.uniform(0.5, 2.0), rng.uniform(0.1, 1.0, n)
    size, direction = rng.uniform(0.1, 2.0), rng.normal(size=n)
    acting = Sine(amplitude=size, frequency=1.0)
    return Problem(
        plant=Plant(A_m=A_m, b=b, theta=half * rng.choice([-1, 1], n), x0=np.zeros(n)),
        reference_model=ReferenceModel(k_0=1.0),
        reference=Sine(amplitude=rng.uniform(0.1, 2.0), frequency=rng.uniform(0.2, 3.0)),
        uncertainty=ParameterBox(lower=-half, upper=half),
        disturbance=None if unmatched else acting,
        unmatched=(Disturbance(direction=direction, signal=acting),) if unmatched else (),
    )


def attacked(problem: Problem, gamma: float, kappa: float | None, *, worst: bool, ell: float = 0.0) -> float:
    """The largest |e_i| under a disturbance of the stated size, whose sign is that of e'P E or of a square wave at the model's
    frequency.

    With ``ell`` the model is a closed-loop one with L = -ell I.
    """
    plant = problem.plant
    A_m, b, theta, n = plant.A_m, plant.b, plant.theta, len(plant.b)
    P = solve_continuous_lyapunov((A_m - ell * np.eye(n)).T, -np.eye(n))
    matched = problem.disturbance is not None
    E = b if matched else problem.unmatched[0].direction
    size = (problem.disturbance if matched else problem.unmatched[0].signal).amplitude
    r, box, pace = problem.reference, problem.uncertainty, float(np.abs(np.linalg.eigvals(A_m)).min())

    def rates(t, x, x_m, x_hat, theta_hat, v):
        command, seen = r.amplitude * np.sin(r.frequency * t), x - x_hat
        asked = command - theta_hat @ x
        u = asked if kappa is None else v
        push = np.sign((x - x_m) @ P @ E) if worst else np.sign(np.sin(pace * t))
        rate = gamma * (seen @ P @ b) * x
        rate = np.where((theta_hat >= box.upper) & (rate > 0) | (theta_hat <= box.lower) & (rate < 0), 0.0, rate)
        of_filter = 0.0 if kappa is None else (asked - v) / kappa
        return (
            A_m @ x + b * (theta @ x + u) + E * size * push,
            A_m @ x_m + b * command,
            A_m @ x_hat + b * (theta_hat @ x + u) if kappa is not None else A_m @ x_hat + b * command + ell * seen,
            rate,
            of_filter,
        )

    state, h, largest = (np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), 0.0), 2e-3, 0.0
    for k in range(2000):
        t = k * h
        k1 = rates(t, *state)
        k2 = rates(t + h / 2, *(a + h / 2 * d for a, d in zip(state, k1, strict=True)))
        state = tuple(a + h * d for a, d in zip(state, k2, strict=True))
        state = (*state[:3], np.clip(state[3], box.lower, box.upper), state[4])
        largest = max(largest, float(np.abs(state[0] - state[1]).max()))
    return largest


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("unmatched", [False, True])
def test_no_disturbance_breaks_the_bounds(n, unmatched):
    rng, spoken = np.random.default_rng(31 * n + unmatched), 0
    for _ in range(3):
        problem, gamma = random_problem(rng, n, unmatched=unmatched), 10 ** rng.uniform(0, 2)
        kappa = 10 ** rng.uniform(-2, -1)
        ell = rng.uniform(0.2, 3.0)
        closed = MracClosedLoop(gamma=gamma, model_feedback=-ell * np.eye(n), name="closed")
        controllers = [Mrac(gamma=gamma, name="MRAC"), L1Adaptive(gamma=gamma, filter=input_filter(kappa), name="L1"), closed]
        found = certify(problem, controllers, SIMULATION, keys=("error_bound",))
        for name, lag, feedback in (("MRAC", None, 0.0), ("L1", kappa, 0.0), ("closed", None, ell)):
            bound = found[name].entry("error_bound")
            if bound.kind != "guaranteed":
                continue
            spoken += 1
            for worst in (True, False):
                assert attacked(problem, gamma, lag, worst=worst, ell=feedback) <= bound.value
    assert spoken >= 6  # the controllers that are MRACs


@pytest.mark.parametrize("closed", [False, True])
def test_the_checker_accepts_the_bound_and_refuses_one_below_it(closed):
    problem, controller = random_problem(np.random.default_rng(5), 2, unmatched=False), Mrac(gamma=10.0, name="MRAC")
    if closed:
        controller = MracClosedLoop(gamma=10.0, model_feedback=-np.eye(2), name="MRAC")
    found = certify(problem, [controller], SIMULATION)
    document = json.loads(json.dumps(proof("a case", problem, [controller], SIMULATION, found)))
    barbalat_check.check(document)
    [line] = [line for line in document["controllers"]["MRAC"]["lines"] if line["key"] == "error_bound"]
    right = line["value"]
    line["value"] = right * 0.999
    with pytest.raises(barbalat_check.Refused):
        barbalat_check.check(document)
    line["value"] = right
    for name, factor in (("decay", 1.01), ("largest", 0.99)):
        facts = document["controllers"]["MRAC"]["facts"]["carried"]
        kept, facts[name] = facts[name], facts[name] * factor
        with pytest.raises(barbalat_check.Refused):
            barbalat_check.check(document)
        facts[name] = kept


@pytest.mark.parametrize("learning", [None, CompositeLearning(gamma_c=1.0, time_constant=0.3, capacity=1.0)])
def test_nothing_is_guaranteed_where_the_proof_does_not_hold(learning):
    given = random_problem(np.random.default_rng(6), 2, unmatched=False)
    projected = Mrac(gamma=10.0, name="MRAC", learning=learning)
    free = Problem(
        plant=given.plant, reference_model=given.reference_model, reference=given.reference, disturbance=given.disturbance
    )
    problem = free if learning is None else given
    assert certify(problem, [projected], SIMULATION, keys=("error_bound",))["MRAC"].entry("error_bound").kind == "does not apply"


def direct_problem(rng: np.random.Generator, n: int) -> tuple[Problem, float]:
    """A random problem with an unknown input gain, and the value of this gain."""
    omega = float(rng.uniform(0.6, 1.8))
    given = random_problem(rng, n, unmatched=bool(rng.integers(2)))
    plant = replace(given.plant, input=PlantInput(gain=omega))
    known = (
        ParameterBall(center=np.zeros(n), radius=1.01 * float(np.linalg.norm(given.plant.theta)))
        if rng.integers(2)
        else given.uncertainty
    )
    return replace(given, plant=plant, uncertainty=known, input_gain=(0.5, 2.0)), omega


def attacked_direct(problem: Problem, omega: float, gamma: float) -> float:
    """The largest |e_i| of the direct MRAC, integrated here, under a disturbance that increases V."""
    plant, n, k_0 = problem.plant, len(problem.plant.b), 1.0
    A_m, b, theta, P = plant.A_m, plant.b, plant.theta, solve_continuous_lyapunov(plant.A_m.T, -np.eye(n))
    E = b if problem.disturbance is not None else problem.unmatched[0].direction
    size = (problem.disturbance or problem.unmatched[0].signal).amplitude
    low, high = sets_of_ideal_gains(problem.known)[1].lower[0], sets_of_ideal_gains(problem.known)[1].upper[0]
    onto, r, h, largest = sets_of_ideal_gains(problem.known)[0], problem.reference, 2e-3, 0.0
    x, x_m, k_x, k_r = np.zeros(n), np.zeros(n), np.zeros(n), min(max(k_0, low), high)
    for k in range(3000):
        command, e = r.amplitude * np.sin(r.frequency * k * h), x - x_m
        u, s = k_r * command - k_x @ x, e @ P @ b
        x = x + h * (A_m @ x + b * (theta @ x + omega * u) + E * size * np.sign(e @ P @ E))
        x_m = x_m + h * (A_m @ x_m + b * k_0 * command)
        k_x = np.asarray(onto.limit(k_x + h * gamma * s * x))
        k_r = min(max(k_r - h * gamma * s * command, low), high)
        largest = max(largest, float(np.abs(x - x_m).max()))
    return largest


@pytest.mark.parametrize("n", [1, 2, 3])
def test_no_disturbance_breaks_the_bound_of_the_direct_mrac(n):
    rng = np.random.default_rng(n)
    for _ in range(3):
        (problem, omega), gamma = direct_problem(rng, n), 10 ** rng.uniform(0, 2)
        controller = DirectMrac(gamma=gamma, name="direct")
        found = certify(problem, [controller], SIMULATION)
        entry = found["direct"].entry("error_bound")
        assert entry.kind == "guaranteed" and not found["direct"].entry("error_bound_worst").applies
        assert 0.02 * entry.value < attacked_direct(problem, omega, gamma) <= entry.value
        document = json.loads(json.dumps(proof("a case", problem, [controller], SIMULATION, found)))
        barbalat_check.check(document)
        [line] = [line for line in document["controllers"]["direct"]["lines"] if line["key"] == "error_bound"]
        line["value"] *= 0.9999
        with pytest.raises(barbalat_check.Refused):
            barbalat_check.check(document)


def test_a_feedforward_that_is_not_projected_has_no_bound_beside_a_disturbance():
    problem, _ = direct_problem(np.random.default_rng(1), 2)
    problem = replace(problem, plant=replace(problem.plant, input=PlantInput()), input_gain=None)
    found = certify(problem, [DirectMrac(gamma=10.0, name="direct")], SIMULATION, keys=("error_bound",))
    entry = found["direct"].entry("error_bound")
    assert entry.kind == "does not apply" and "feedforward" in entry.why
