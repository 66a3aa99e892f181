"""MRAC with a closed-loop reference model: against the standard MRAC at L = 0, and its bound against runs."""

from dataclasses import replace

import numpy as np
import pytest

from barbalat import Mrac, MracClosedLoop, ParameterBall, ParameterBox, Plant, PlantInput, Sine, Terms, certify, simulate
from barbalat.solvers.simulation import Simulation
from independent import refusal

SIMULATION = Simulation(t_end=10.0, dt=1e-3)


def test_without_feedback_it_is_the_standard_mrac(problems):
    """With L = 0 the model is (2); equal but for the order of roundings."""
    runs = simulate(problems[2], [Mrac(gamma=2.0), MracClosedLoop(gamma=2.0, model_feedback=np.zeros((2, 2)))], SIMULATION)
    plain, closed = runs.values()
    np.testing.assert_allclose(closed.theta_hat, plain.theta_hat, atol=1e-12)
    np.testing.assert_allclose(closed.e, plain.e, atol=1e-12)


def random_member(problems, seed):
    """Orders 1 to 3, scalar, diagonal and matrix gains, a box, a ball or no known set."""
    rng = np.random.default_rng(seed)
    n = 1 + seed % 3
    given, theta = problems[n], rng.uniform(-1.0, 1.0, n)
    box, ball = ParameterBox(lower=-2 * np.ones(n), upper=2 * np.ones(n)), ParameterBall(center=np.zeros(n), radius=2.0)
    root = rng.normal(size=(n, n))
    sizes = (10 ** rng.uniform(0, 2), 10 ** rng.uniform(0, 2, n), 5 * (root @ root.T + 0.3 * np.eye(n)))
    problem = replace(
        given,
        plant=Plant(A_m=given.plant.A_m, b=given.plant.b, theta=theta, x0=rng.normal(size=n)),
        uncertainty=(box, ball, None)[seed // 3 % 3],
        reference=Sine(amplitude=rng.uniform(0.1, 5), frequency=10 ** rng.uniform(-1, 1)),
    )
    L = -rng.uniform(0, 5) * np.eye(n) + 0.2 * rng.normal(size=(n, n))
    return problem, MracClosedLoop(gamma=sizes[seed // 9 % 3], model_feedback=L)


EACH_PAIR = [n + 3 * known_set + 9 * ((n + known_set) % 3) for n in range(3) for known_set in range(3)]
"""Seeds with every pair of an order, a known set and a kind of gain among them; the first 27 have every triple."""


def test_the_bound_holds_along_runs(problems, sample):
    for seed in EACH_PAIR if sample(9, 1000) == 9 else range(1000):
        problem, controller = random_member(problems, seed)
        if np.linalg.eigvals(problem.plant.A_m + controller.model_feedback).real.max() > -0.01:
            continue
        (found,) = certify(problem, [controller], SIMULATION).values()
        (run,) = simulate(problem, [controller], SIMULATION).values()
        assert "error_bound" in found.guaranteed
        assert max(run.figures["max_abs_e"]) <= found.values["error_bound"], seed


TERMS = {1: ("sin(x1)",), 2: ("x1*x2", "sin(x2)"), 3: ("x1*x2", "x3", "tanh(x1)")}


def test_the_bound_holds_for_another_regressor_too(problems, sample):
    """V does not ask what phi(x) is; no margins and no limits are claimed there."""
    for seed in range(sample(9, 300)):
        problem, controller = random_member(problems, seed)
        problem = replace(problem, plant=replace(problem.plant, regressor=Terms(terms=TERMS[problem.plant.n])))
        if np.linalg.eigvals(problem.plant.A_m + controller.model_feedback).real.max() > -0.01:
            continue
        (found,) = certify(problem, [controller], SIMULATION).values()
        (run,) = simulate(problem, [controller], SIMULATION).values()
        assert "error_bound" in found.guaranteed and "delay_margin" not in found.values
        assert max(run.figures["max_abs_e"]) <= found.values["error_bound"], seed


def test_the_worst_theta_of_a_box_is_a_vertex(problems):
    """nu_0 is convex in theta, so the largest of the bounds at the vertices is that of the set. 1e-9: roundings outward."""
    given, controller = problems[2], MracClosedLoop(gamma=3.0, model_feedback=-np.eye(2))
    box = ParameterBox(lower=[-1.0, -2.0], upper=[4.0, 0.5])
    vertices = [[a, b] for a in (-1.0, 4.0) for b in (-2.0, 0.5)]
    found = []
    for theta in vertices:
        problem = replace(given, plant=replace(given.plant, theta=np.array(theta)), uncertainty=box)
        found.append(certify(problem, [controller], SIMULATION)[controller.name].values)
    assert max(values["nu_0"] for values in found) == pytest.approx(found[0]["nu_0_worst"], rel=1e-9)
    assert max(values["error_bound"] for values in found) == pytest.approx(found[0]["error_bound_worst"], rel=1e-9)


def test_nothing_is_claimed_beside_a_delay(problems):
    plant = replace(problems[2].plant, input=PlantInput(delay=0.1))
    (found,) = certify(
        replace(problems[2], plant=plant), [MracClosedLoop(gamma=1.0, model_feedback=-np.eye(2))], SIMULATION
    ).values()
    assert "error_bound" not in found.values and "delay 0.1 s" in found.entry("error_bound").why


def test_an_unstable_model_is_refused(problems):
    controller = MracClosedLoop(gamma=1.0, model_feedback=5.0 * np.eye(2))
    assert "A_m + model_feedback must be Hurwitz" in refusal(lambda: controller.bind(problems[2].known))
