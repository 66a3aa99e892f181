"""Theorem 1's bounds against simulation on 10,000 random problems, and its ingredients against closed forms."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm

from barbalat import (
    L1Adaptive,
    Mrac,
    ParameterBox,
    Plant,
    Problem,
    ReferenceModel,
    Simulation,
    Sine,
    input_filter,
    simulate_ensemble,
)
from barbalat.cases.load import load_case
from barbalat.certify import theorem1

REFERENCE = Sine(amplitude=1.3, frequency=1.1)
SYSTEMS, MEMBERS = 50, 20
"""For each n and scheme: 50 random (A_m, b, C, k_0), each with 20 random theta, gain, start and initial estimate."""


def random_known(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """A Hurwitz A_m with time constants of 0.2 to 2 s and a b that reaches it."""
    poles = -rng.uniform(0.5, 5, n) * 1.0
    T = np.linalg.qr(rng.normal(size=(n, n)))[0] + 0.3 * rng.normal(size=(n, n))
    return T @ np.diag(poles) @ np.linalg.inv(T), rng.normal(size=n)


def problems(rng: np.random.Generator, n: int) -> list[Problem]:
    A_m, b = random_known(rng, n)
    k_0 = rng.uniform(0.5, 2)
    result = []
    for _ in range(MEMBERS):
        half = rng.uniform(0.1, 1.0, n)
        theta = rng.uniform(-half, half)
        x0 = rng.uniform(-1, 1, n) * rng.integers(0, 2)
        plant = Plant(A_m=A_m, b=b, theta=theta, x0=x0)
        box = ParameterBox(lower=-half, upper=half)
        result.append(Problem(plant=plant, reference_model=ReferenceModel(k_0=k_0), reference=REFERENCE, uncertainty=box))
    return result


@pytest.mark.parametrize("n", range(1, 6))
def test_bound_9_is_never_violated(n):
    rng = np.random.default_rng(n)
    members, bounds = [], []
    for _ in range(SYSTEMS):
        for problem in problems(rng, n):
            gamma, start = 10 ** rng.uniform(-1, 2), rng.uniform(problem.uncertainty.lower, problem.uncertainty.upper)
            members.append((problem, Mrac(gamma=gamma, theta_hat0=start)))
            nu = theorem1.nu_0(theorem1.initial_parameter_error(start, problem.plant.theta), problem.known)
            bounds.append(theorem1.mrac_bound(nu, gamma))
    metrics = simulate_ensemble(members, Simulation(t_end=10, dt=1e-3)).metrics
    ratio = metrics.max_abs_e.max(axis=1) / np.array(bounds)
    assert len(ratio) == SYSTEMS * MEMBERS
    assert np.all(ratio < 1)
    assert ratio.max() > 0.05  # some problem comes near: the bound is not empty


@pytest.mark.parametrize("n", range(1, 6))
def test_bound_10_is_never_violated(n):
    rng = np.random.default_rng(100 + n)
    members, bounds = [], []
    while len(members) < SYSTEMS * MEMBERS:
        group = problems(rng, n)
        known = group[0].known
        largest = max(p.uncertainty.theta_max for p in group)
        admissible = theorem1.kappa_max(theorem1.derivative_norm(known), largest)
        kappa = admissible * rng.uniform(0.05, 0.9)
        if kappa < 0.004:  # four steps: a faster filter would test the step instead of the theorem
            continue
        C = input_filter(kappa)
        condition = theorem1.filter_condition(known, C.realise(), 1.0)
        for problem in group:
            gamma, theta_max = 10 ** rng.uniform(-1, 3), problem.uncertainty.theta_max
            members.append((problem, L1Adaptive(gamma=gamma, filter=C)))
            model = theorem1.model_bounds(problem) if problem.plant.x0.any() else shared_bounds(problem)
            scaled = theorem1.FilterCondition(condition.norm, condition.norm.upper * theta_max * theorem1.OUTWARD, True)
            nu = theorem1.nu_0(theorem1.initial_parameter_error(np.zeros(n), problem.plant.theta), known)
            bounds.append(theorem1.l1_bound(nu, gamma, scaled, theta_max, known.k_0, model))
    metrics = simulate_ensemble(members, Simulation(t_end=10, dt=1e-3)).metrics
    ratio = metrics.max_abs_e.max(axis=1) / np.array(bounds)
    assert len(ratio) >= SYSTEMS * MEMBERS
    assert np.all(ratio < 1)
    assert ratio.max() > 0.02


_BOUNDS: dict[bytes, theorem1.ModelBounds] = {}


def shared_bounds(problem: Problem) -> theorem1.ModelBounds:
    key = problem.plant.A_m.tobytes()
    if key not in _BOUNDS:
        _BOUNDS[key] = theorem1.model_bounds(problem)
    return _BOUNDS[key]


def test_section_v_numbers():
    problem = load_case("paper").problem
    known, theta_max = problem.known, problem.uncertainty.theta_max
    assert theta_max == 10
    # P of the example by hand: P A + A'P = -I gives p12 = 1/0.6, p22 = p12 + 1/2, p11 = p12 + 0.3 p22
    p12 = 1 / 0.6
    p22 = p12 + 0.5
    np.testing.assert_allclose(known.P, [[p12 + 0.3 * p22, p12], [p12, p22]], rtol=1e-12)
    lambda_min = np.linalg.eigvalsh(known.P)[0]
    assert theorem1.nu_0(5.0, known) == pytest.approx(5 / math.sqrt(lambda_min), rel=1e-9)
    assert theorem1.smallest_eigenvalue(known.P) <= lambda_min
    assert 0.0495 < theorem1.kappa_admissible(known, theta_max) < 0.05  # the paper: the condition holds for kappa < 0.05


def test_norms_against_quadrature():
    """||s W_b||_1 and ||W_b (1 - C)||_1 of Section V by adaptive quadrature of the impulse responses."""
    known = load_case("paper").problem.known
    kappa = 0.02

    def impulse(t: float, i: int) -> float:  # W_b kappa s/(kappa s + 1): kappa (d/dt W_b) filtered by 1/(kappa s + 1)
        A = np.block([[known.A_m, known.b[:, None]], [np.zeros((1, 2)), np.array([[-1 / kappa]])]])
        return float((expm(A * t) @ np.array([*known.b, -1 / kappa]))[i])

    for i in range(2):
        direct = sum(
            quad(lambda t, i=i: abs(impulse(t, i)), a, b, limit=400, epsabs=1e-10)[0] for a, b in ((0, 0.2), (0.2, 5), (5, 60))
        )
        A, B, C, D = theorem1.filtered_model(known, input_filter(kappa).realise())
        enclosure = theorem1.l1_norm(A, B, C[i : i + 1], D[i : i + 1])
        assert enclosure.lower - 1e-8 < direct < enclosure.upper + 1e-8  # the quadrature's own tolerance


def test_kappa_zero_gives_the_best_bound():
    problem = load_case("paper").problem
    known, theta_max = problem.known, problem.uncertainty.theta_max
    model = theorem1.model_bounds(problem)
    nu = theorem1.nu_0(5.0, known)
    bounds = [
        theorem1.l1_bound(
            nu, 1e4, theorem1.filter_condition(known, input_filter(kappa).realise(), theta_max), theta_max, known.k_0, model
        )
        for kappa in (0.04, 0.02, 0.01, 0.001, 0.0001)
    ]
    assert bounds == sorted(bounds, reverse=True)
    assert theorem1.mrac_bound(nu, 1e4) < bounds[-1]


def test_model_bounds_hold_along_the_model():
    problem = load_case("paper").problem
    bounds = theorem1.model_bounds(problem)
    ones = simulate_ensemble([(problem, Mrac(gamma=1.0))], Simulation(t_end=60, dt=1e-3))
    assert 50 <= bounds.r < 50 * (1 + 1e-14)
    # |x| <= |x_m| + |e|; the run's largest e is far below the model's size
    assert ones.metrics.max_abs_e.max() < 2
    t = np.arange(0, 60, 0.01)
    x = np.array([expm(problem.plant.A_m * s) @ problem.plant.x0 for s in t[::10]])
    assert np.abs(x).max() <= bounds.x_m


def test_a_matrix_that_is_not_positive_definite_is_noticed():
    with pytest.raises(ValueError, match="positive definite"):
        theorem1.smallest_eigenvalue(np.array([[1.0, 2.0], [2.0, 1.0]]))
    assert not theorem1.lyapunov_holds(np.eye(2), np.array([[0.0, 1.0], [-1.0, 0.0]]))
    assert theorem1.lyapunov_holds(np.eye(2), -np.eye(2))
