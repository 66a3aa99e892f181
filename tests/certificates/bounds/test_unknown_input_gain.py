"""MRAC's bounds with an input gain in an interval, attacked at the ends of the interval and the box and inside them."""

from __future__ import annotations

import json

import numpy as np
import pytest

import barbalat_check
from barbalat import Mrac, ParameterBox, Plant, Problem, ReferenceModel, Simulation, certify, simulate_ensemble
from barbalat.certificates.proof import proof
from barbalat.plants import PlantInput
from certificates.bounds import random_problems

SIMULATION = Simulation(t_end=8.0, dt=5e-4)
KEYS = ("error_bound", "error_bound_worst", "error_bound_command")


def drawn(rng: np.random.Generator, n: int, command: object) -> tuple[list[Problem], Mrac]:
    """One system and one controller. Half of the members have theta and the gain at the ends of their sets."""
    A_m, b = random_problems.random_known(rng, n)
    half, low = rng.uniform(0.2, 2.0, n), rng.uniform(0.3, 1.0)
    high, x0 = low * rng.uniform(1.2, 4.0), rng.uniform(-1, 1, n) * rng.integers(0, 2)
    model, box = ReferenceModel(k_0=rng.uniform(0.5, 2)), ParameterBox(lower=-half, upper=half)
    members = []
    for k in range(16):
        theta = rng.choice([-1, 1], n) * half if k < 8 else rng.uniform(-half, half)
        omega = rng.choice([low, high]) if k < 8 else rng.uniform(low, high)
        plant = Plant(A_m=A_m, b=b, theta=theta, x0=x0, input=PlantInput(gain=omega))
        members.append(Problem(plant=plant, reference_model=model, reference=command, uncertainty=box, input_gain=(low, high)))
    start = np.append(rng.uniform(-half, half), rng.choice([low, high]))
    return members, Mrac(gamma=10 ** rng.uniform(-1, 1.5), theta_hat0=start, name="MRAC")


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.short(kept=lambda n: n == 2)
def test_no_gain_and_no_theta_exceeds_them(n):
    rng, nearest = np.random.default_rng(60 + n), 0.0
    for command in random_problems.COMMANDS:
        members, controller = drawn(rng, n, command)
        peaks = simulate_ensemble([(one, controller) for one in members], SIMULATION).metrics.max_abs_e.max(axis=1)
        found = [certify(one, [controller], SIMULATION, keys=KEYS)["MRAC"] for one in members]
        assert set(KEYS) <= found[0].guaranteed
        assert len({one.values["error_bound_worst"] for one in found}) == 1  # depends on the sets alone
        bounds = np.array([[one.values[key] for key in KEYS] for one in found])
        assert (peaks[:, None] <= bounds).all()
        assert (bounds[:, [0, 2]] <= bounds[:, [1]] * (1 + 1e-9)).all()  # outward roundings
        nearest = max(nearest, float((peaks / bounds[:, 0]).max()))
    assert nearest > 0.1  # the statement concerns these runs


@pytest.mark.parametrize("key", KEYS)
def test_the_checker_knows_them(key):
    (problem, *_), controller = drawn(np.random.default_rng(70), 2, random_problems.COMMANDS[0])
    found = certify(problem, [controller], SIMULATION, keys=KEYS)
    document = json.loads(json.dumps(proof("a case", problem, [controller], SIMULATION, found)))
    said, _ = barbalat_check.check(document)
    assert any(key in one for one in said)
    [line] = [line for line in document["controllers"]["MRAC"]["lines"] if line["key"] == key]
    line["value"] *= 1 - 1e-6
    with pytest.raises(barbalat_check.Refused, match="must be at least"):
        barbalat_check.check(document)
