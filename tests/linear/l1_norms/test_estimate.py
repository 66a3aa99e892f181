"""Estimates of L1 norms, compared with their enclosures."""

import numpy as np

from barbalat.linear.l1_norms.estimate import estimated_rows
from barbalat.linear.l1_norms.norm import row_norms


def test_estimates_lie_within_a_few_percent_of_enclosures(sample):
    """The systems have stiff, oscillating and double poles."""
    rng = np.random.default_rng(1)
    for number in range(sample(20, 300)):
        n = int(rng.integers(1, 6))
        A = rng.normal(size=(n, n)) * 10.0 ** rng.uniform(-1, 2, size=(n, 1))
        A -= np.eye(n) * (np.linalg.eigvals(A).real.max() + 10.0 ** rng.uniform(-1, 1))
        if number % 3 == 0:
            A = np.block([[A, np.eye(n)], [np.zeros((n, n)), A]])  # double poles, as in a loop with its variation
        B, C = rng.normal(size=(len(A), 1)), rng.normal(size=(3, len(A)))
        enclosures, _ = row_norms(A, B, C, np.zeros((3, 1)), relative_width=1e-6)
        np.testing.assert_allclose(estimated_rows(A, B, C), enclosures, rtol=0.05, atol=1e-4 * max(enclosures))


def test_without_decay_there_is_none():
    assert estimated_rows(np.array([[0.0, 1.0], [-1.0, 0.0]]), np.ones((2, 1)), np.eye(2)) is None
