"""Theorem 1 beside bounded disturbances, attacked by a program that shares no code with the package: plain NumPy and RK4."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

import barbalat_check
from barbalat import L1Adaptive, Mrac, ParameterBox, Plant, Problem, ReferenceModel, Simulation, certify, input_filter
from barbalat.certificates.proof import proof
from barbalat.laws import CompositeLearning
from barbalat.problem.tracking import Disturbance
from barbalat.signals import Sine

SIMULATION = Simulation(t_end=10.0, dt=1e-3)


def random_problem(rng: np.random.Generator, n: int, *, unmatched: bool) -> Problem:
    """A companion A_m, theta at a vertex of its box, and a disturbance as large as what r does."""
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


def attacked(problem: Problem, gamma: float, kappa: float | None, *, worst: bool) -> float:
    """The largest |e_i| under a disturbance of the stated size: the sign of e'P E, or a square wave at the model's own pace."""
    plant = problem.plant
    A_m, b, theta, n = plant.A_m, plant.b, plant.theta, len(plant.b)
    P = solve_continuous_lyapunov(A_m.T, -np.eye(n))
    matched = problem.disturbance is not None
    E = b if matched else problem.unmatched[0].direction
    size = (problem.disturbance if matched else problem.unmatched[0].signal).amplitude
    r, box, pace = problem.reference, problem.uncertainty, float(np.abs(np.linalg.eigvals(A_m)).min())

    def rates(t, x, x_m, x_hat, theta_hat, v):
        command, seen = r.amplitude * np.sin(r.frequency * t), x - (x_m if kappa is None else x_hat)
        asked = command - theta_hat @ x
        u = asked if kappa is None else v
        push = np.sign((x - x_m) @ P @ E) if worst else np.sign(np.sin(pace * t))
        rate = gamma * (seen @ P @ b) * x
        rate = np.where((theta_hat >= box.upper) & (rate > 0) | (theta_hat <= box.lower) & (rate < 0), 0.0, rate)
        of_filter = 0.0 if kappa is None else (asked - v) / kappa
        return (
            A_m @ x + b * (theta @ x + u) + E * size * push,
            A_m @ x_m + b * command,
            A_m @ x_hat + b * (theta_hat @ x + u),
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
        controllers = [Mrac(gamma=gamma, name="MRAC"), L1Adaptive(gamma=gamma, filter=input_filter(kappa), name="L1")]
        found = certify(problem, controllers, SIMULATION, keys=("error_bound",))
        for name, lag in (("MRAC", None), ("L1", kappa)):
            bound = found[name].entry("error_bound")
            if bound.kind != "guaranteed":
                continue
            spoken += 1
            for worst in (True, False):
                assert attacked(problem, gamma, lag, worst=worst) <= bound.value
    assert spoken >= 3


def test_the_checker_accepts_the_bound_and_refuses_one_below_it():
    problem, controller = random_problem(np.random.default_rng(5), 2, unmatched=False), Mrac(gamma=10.0, name="MRAC")
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
    assert certify(problem, [projected], SIMULATION)["MRAC"].entry("error_bound").kind == "does not apply"
