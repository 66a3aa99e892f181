"""Theorem 1: bounds (9) and (10) compared with simulation on 10,000 random problems each (a tenth of them in the short tests),
and closed forms."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm

from barbalat import Mrac, Simulation, input_filter, simulate_ensemble
from barbalat.cases.load import load_case
from barbalat.certificates.bounds import theorem_1
from barbalat.certificates.bounds.model import model_bounds
from barbalat.linear.conditions import lyapunov_holds, smallest_eigenvalue
from certificates.bounds import random_problems


@pytest.mark.parametrize("n", range(1, 6))
@pytest.mark.short(kept=lambda n: n in (1, 3, 4))
def test_bound_9_is_never_violated(n, sample):
    few = sample(1, 8) == 1
    used = random_problems.used_of_9(n, random_problems.FEW_9 if few else random_problems.SYSTEMS_9)
    assert len(used.ratio) == (160 if few else 2000)
    assert np.all(used.ratio < 1)
    assert used.ratio.max() > 0.05  # some problem comes near the bound
    assert n == 1 or 0.2 < used.oscillating.mean() < 0.9 or len(used.ratio) < 2000  # few systems may all be of one kind


@pytest.mark.parametrize("n", range(1, 6))
@pytest.mark.short(kept=lambda n: n in (1, 2, 4))
def test_bound_10_is_never_violated(n, sample):
    """The bound with the norm of W_b (1 - C) holds for C(s) of order 1, 2 and 3. For order 1 the paper's form also holds, and is
    never smaller."""
    few = sample(1, 8) == 1
    used = random_problems.used_of_10(n, random_problems.FEW_10 if few else random_problems.SYSTEMS_10)
    assert len(used.ratio) == (240 if few else 2000)
    first_order = np.isfinite(used.constants)
    assert first_order.sum() == (160 if few else 1000)
    assert np.all(used.ratio < 1)
    assert np.all(used.constants[first_order] < 1)
    assert np.all(used.constants[first_order] <= used.ratio[first_order] * (1 + 1e-8))  # the width of the enclosures
    assert used.ratio[first_order].max() > 0.02 and used.ratio[~first_order].max() > 0.02
    assert n == 1 or 0.2 < used.oscillating.mean() < 0.9 or len(used.ratio) < 2000  # few systems may all be of one kind


def test_section_v_numbers():
    problem = load_case("paper").problem
    known, theta_max = problem.known, problem.uncertainty.theta_max
    assert theta_max == 10
    # P of the example by hand: P A + A'P = -I gives p12 = 1/0.6, p22 = p12 + 1/2, p11 = p12 + 0.3 p22
    p12 = 1 / 0.6
    p22 = p12 + 0.5
    np.testing.assert_allclose(known.P, [[p12 + 0.3 * p22, p12], [p12, p22]], rtol=1e-12)
    lambda_min = np.linalg.eigvalsh(known.P)[0]
    assert theorem_1.nu_0(5.0, known) == pytest.approx(5 / math.sqrt(lambda_min), rel=1e-9)
    assert smallest_eigenvalue(known.P) <= lambda_min
    assert 0.0495 < theorem_1.kappa_admissible(known, theta_max) < 0.05  # the paper: the condition holds for kappa < 0.05


def test_norms_against_quadrature():
    """||s W_b||_1 and ||W_b (1 - C)||_1 of Section V agree with an adaptive quadrature of the impulse responses."""
    known = load_case("paper").problem.known
    kappa = 0.02

    def impulse(t: float, i: int) -> float:  # W_b kappa s/(kappa s + 1): kappa (d/dt W_b) filtered by 1/(kappa s + 1)
        A = np.block([[known.A_m, known.b[:, None]], [np.zeros((1, 2)), np.array([[-1 / kappa]])]])
        return float((expm(A * t) @ np.array([*known.b, -1 / kappa]))[i])

    for i in range(2):
        direct = sum(
            quad(lambda t, i=i: abs(impulse(t, i)), a, b, limit=400, epsabs=1e-10)[0] for a, b in ((0, 0.2), (0.2, 5), (5, 60))
        )
        A, B, C, D = theorem_1.filtered_model(known, input_filter(kappa).realise())
        enclosure = theorem_1.l1_norm(A, B, C[i : i + 1], D[i : i + 1])
        assert enclosure.lower - 1e-8 < direct < enclosure.upper + 1e-8  # the quadrature's own tolerance


def test_kappa_zero_gives_the_best_bound():
    problem = load_case("paper").problem
    known, theta_max = problem.known, problem.uncertainty.theta_max
    model = model_bounds(problem)
    nu = theorem_1.nu_0(5.0, known)
    bounds = [
        theorem_1.l1_bound(
            nu, 1e4, theorem_1.filter_condition(known, input_filter(kappa).realise(), theta_max), theta_max, known.k_0, model
        )
        for kappa in (0.04, 0.02, 0.01, 0.001, 0.0001)
    ]
    assert bounds == sorted(bounds, reverse=True)
    assert theorem_1.mrac_bound(nu, 1e4) < bounds[-1]


def test_model_bounds_hold_along_the_model():
    problem = load_case("paper").problem
    bounds = model_bounds(problem)
    ones = simulate_ensemble([(problem, Mrac(gamma=1.0))], Simulation(t_end=60, dt=1e-3))
    assert 50 <= bounds.r < 50 * (1 + 1e-14)
    # |x| <= |x_m| + |e|, and the run's largest e is far below the model's size
    assert ones.metrics.max_abs_e.max() < 2
    t = np.arange(0, 60, 0.01)
    x = np.array([expm(problem.plant.A_m * s) @ problem.plant.x0 for s in t[::10]])
    assert np.abs(x).max() <= bounds.x_m


def test_a_matrix_that_is_not_positive_definite_is_noticed():
    with pytest.raises(ValueError, match="positive definite"):
        smallest_eigenvalue(np.array([[1.0, 2.0], [2.0, 1.0]]))
    assert not lyapunov_holds(np.eye(2), np.array([[0.0, 1.0], [-1.0, 0.0]]))
    assert lyapunov_holds(np.eye(2), -np.eye(2))
