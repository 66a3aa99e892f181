"""Bounds at the samples, compared with sums in exact arithmetic, for states of very different sizes and slowly decaying loops."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov

from barbalat.linear.sampled_norms import SampledNorms
from independent import refusal


def exact_sums(M, s, count):
    """The sum and the maximum of |M^k s| over k < count for each entry, as fractions."""
    state, rows = [Fraction(value) for value in s.tolist()], [[Fraction(v) for v in row] for row in M.tolist()]
    total, largest = [Fraction(0)] * len(state), [Fraction(0)] * len(state)
    for _ in range(count):
        total = [a + abs(b) for a, b in zip(total, state, strict=True)]
        largest = [max(a, abs(b)) for a, b in zip(largest, state, strict=True)]
        state = [sum(a * b for a, b in zip(row, state, strict=True)) for row in rows]
    return [np.array([float(value) for value in found]) for found in (total, largest)]


@pytest.mark.parametrize("far", [0, 20], ids=["alike", "of far sizes"])
@pytest.mark.parametrize("seed", range(4))
def test_the_bounds_are_above_the_sums_and_near(seed, far):
    """With a spectral radius of 0.9 the sum beyond 400 samples is 1e-18. The added remainder is at most 1e-3 of the largest
    entry."""
    random, n = np.random.default_rng(seed), 3
    M = random.normal(size=(n, n))
    M *= 0.9 / np.abs(np.linalg.eigvals(M)).max()
    scale = 2.0 ** random.integers(-far, far + 1, n)
    M, s = np.round(M * 2**20) / 2**20 * scale[:, None] / scale, random.normal(size=n) * scale
    total, largest = exact_sums(M, s, 400)
    norms = SampledNorms(M, np.eye(n))
    for found, expected in ((norms.summed(s), total), (norms.largest(s), largest)):
        assert (found >= expected).all()
        assert (found - expected <= 1.1e-3 * found.max()).all()


def test_the_root_of_the_sum_of_squares_is_the_stationary_deviation():
    """The deviation is computed independently from the discrete Lyapunov equation of the covariance."""
    random = np.random.default_rng(5)
    M, N = random.normal(size=(4, 4)), random.normal(size=(4, 2))
    M *= 0.95 / np.abs(np.linalg.eigvals(M)).max()
    expected = np.sqrt(np.diag(solve_discrete_lyapunov(M, N @ N.T)))
    norms = SampledNorms(M, np.eye(4))
    found = np.linalg.norm(norms.deviation(N, 0 * N), axis=1)
    assert (found >= expected * (1 - 1e-9)).all() and (found <= expected * 1.003).all()
    n, first, covariance, largest = N[:, :1], 3 * random.normal(size=(4, 1)), np.zeros((4, 4)), np.zeros(4)
    found, start = norms.deviation(n, first)[:, 0], first @ first.T
    for _ in range(400):
        largest = np.maximum(largest, np.sqrt(np.diag(covariance + start)))
        covariance, start = M @ covariance @ M.T + n @ n.T, M @ start @ M.T
    assert (found >= largest * (1 - 1e-9)).all() and (found <= largest * 1.003).all()
    assert (largest > 1.05 * np.sqrt(np.diag(solve_discrete_lyapunov(M, n @ n.T)))).all()


def test_a_loop_that_hardly_forgets_has_no_bound_rather_than_a_wrong_one():
    """The solution of its Lyapunov equation has no correct digit. SciPy warns, and the useless P is rejected in one sentence."""
    M = np.array([[1 - 1e-15, 1e3], [0.0, 1 - 1e-14]])
    assert "too close to instability" in refusal(lambda: SampledNorms(M, np.eye(2)).summed(np.ones(2)))
