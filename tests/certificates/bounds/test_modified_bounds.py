"""(9) and (10) with matrix gains, balls and boxes, a switching sigma and composite learning, for plants of random dimension."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barbalat import L1Adaptive, Mrac, ParameterBox, Plant, Problem, ReferenceModel, Simulation, input_filter, simulate_ensemble
from barbalat.certificates.bounds import laws, theorem_1
from barbalat.certificates.bounds.model import model_bounds
from barbalat.laws import CompositeLearning, LeastSquares, SwitchingSigma
from barbalat.plants import ParameterBall
from certificates.bounds.random_problems import COMMANDS, random_known

SIMULATION = Simulation(t_end=20.0, dt=2.0**-8)
SYSTEMS, MEMBERS = 4, 25
"""Systems of each kind and dimension, one in the short tests; 1600 runs in all."""
KINDS = ("matrix gain", "switching sigma", "learning", "L1, learning")


def random_set(rng: np.random.Generator, n: int, *, ball: bool) -> tuple[ParameterBall | ParameterBox, np.ndarray]:
    """A known set and a theta at its boundary, on the sphere or near a corner."""
    center = rng.uniform(-0.5, 0.5, n)
    if ball:
        radius, direction = rng.uniform(0.3, 1.0), rng.normal(size=n)
        return ParameterBall(center=center, radius=radius), center + 0.999 * radius * direction / np.linalg.norm(direction)
    half = rng.uniform(0.2, 0.8, n)
    return ParameterBox(lower=center - half, upper=center + half), center + 0.999 * half * rng.choice([-1, 1], n)


def random_member(rng, kind: str, n: int, plant: Plant, kappa: float, *, ball: bool) -> tuple[Problem, Mrac | L1Adaptive]:
    known_set, theta = random_set(rng, n, ball=ball)
    x0 = rng.uniform(-0.5, 0.5, n)
    given = Problem(
        plant=Plant(A_m=plant.A_m, b=plant.b, theta=theta, x0=x0),
        reference_model=ReferenceModel(k_0=1.0),
        reference=COMMANDS[n % len(COMMANDS)],
        uncertainty=known_set,
    )
    root = rng.normal(size=(n, n))
    gamma = 10 ** rng.uniform(0, 2) * (root @ root.T + 0.1 * np.eye(n))
    learning = CompositeLearning(gamma_c=1.0, time_constant=0.3, capacity=1.0)
    start = known_set.middle
    if kind == "L1, learning":
        return given, L1Adaptive(gamma=gamma, filter=input_filter(kappa), theta_hat0=start, learning=learning)
    if kind == "switching sigma":
        M_0 = known_set.farthest(np.zeros(n)) * (1 + 1e-9)
        return given, Mrac(gamma=gamma, theta_hat0=start, leakage=SwitchingSigma(sigma=0.5, M_0=M_0))
    return given, Mrac(gamma=gamma, theta_hat0=start, learning=learning if kind == "learning" else None)


def random_plant(rng: np.random.Generator, n: int) -> tuple[Plant, float]:
    """A plant and a kappa of at least five steps for which (10) applies to every set that can be drawn."""
    while True:
        A_m, b = random_known(rng, n)
        plant = Plant(A_m=A_m, b=b, theta=np.zeros(n), x0=np.zeros(n))
        problem = Problem(plant=plant, reference_model=ReferenceModel(k_0=1.0), reference=COMMANDS[0])
        kappa = 0.9 * theorem_1.kappa_max(theorem_1.derivative_norm(problem.known), 1.5 * n)
        if kappa > 5 * SIMULATION.dt:
            return plant, kappa


def bound_of(problem: Problem, controller: Mrac | L1Adaptive) -> float:
    """The certificate of ``certify`` without the margins, which need most of the time."""
    assert laws.why_no_bound(controller, problem) is None
    level = laws.error_level(problem, controller, 0.0)
    if isinstance(controller, Mrac):
        return level
    known, theta_max = problem.known, problem.uncertainty.theta_max
    found = theorem_1.filter_condition(known, controller.filter.realise(), theta_max)
    return theorem_1.l1_bound(level, 1.0, found, theta_max, known.k_0, model_bounds(problem))


@pytest.mark.parametrize("n", range(1, 5))
@pytest.mark.parametrize("kind", KINDS)
def test_no_bound_is_exceeded(kind, n, sample):
    rng = np.random.default_rng(10 * n + KINDS.index(kind))
    ball = n > 2 or (n + KINDS.index(kind)) % 2 == 0  # a box in more dimensions: see below
    members = []
    for _ in range(sample(1, SYSTEMS)):
        plant, kappa = random_plant(rng, n)
        members += [random_member(rng, kind, n, plant, kappa, ball=ball) for _ in range(MEMBERS)]
    bounds = np.array([bound_of(*member) for member in members])
    peaks = simulate_ensemble(members, SIMULATION).metrics.max_abs_e.max(axis=1)
    assert np.isfinite(bounds).all()
    assert (peaks <= bounds).all()
    assert (peaks / bounds).max() > 0.02  # a bound that is not trivial


@pytest.mark.parametrize("n", [3, 4])
def test_a_gain_matrix_in_the_corners_of_a_box(n, sample):
    """In these problems a projection face by face increased V without bound. The step is 2^-10 s, because reaching a face within
    a step causes an error of a fraction of a step."""
    rng = np.random.default_rng(41)
    members = []
    for _ in range(sample(1, SYSTEMS)):
        plant, kappa = random_plant(rng, n)
        members += [random_member(rng, "matrix gain", n, plant, kappa, ball=False) for _ in range(MEMBERS)]
    bounds = np.array([bound_of(*member) for member in members])
    peaks = simulate_ensemble(members, Simulation(t_end=20.0, dt=2.0**-10)).metrics.max_abs_e.max(axis=1)
    assert (peaks <= bounds).all()
    assert (peaks / bounds).max() > 0.02


def test_where_the_projection_is_not_exact_no_bound_is_given():
    """With a gain matrix in a box of five parameters there is no bound."""
    rng = np.random.default_rng(41)
    plant, kappa = random_plant(rng, 5)
    problem, controller = random_member(rng, "matrix gain", 5, plant, kappa, ball=False)
    assert "box of more than 4" in laws.why_no_bound(controller, problem)
    for kept in (
        replace(controller, gamma=np.diag(controller.gamma).copy()),
        replace(controller, gamma=np.diag(np.diag(controller.gamma))),
        replace(controller, projection=False),
    ):
        assert laws.why_no_bound(kept, problem) is None
    law = LeastSquares(covariance0=1.0)
    cut = law.guarantee(problem.uncertainty)
    assert "corners" in laws.kept_from_zero(cut) and not cut.bounded
    assert law.guarantee(None).bounded and law.guarantee(None).error_to_zero
