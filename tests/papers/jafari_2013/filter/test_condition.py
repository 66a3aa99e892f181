"""The range of kappa: the two inequalities are compared with norms in between, the limit with a quadrature."""

import math

import numpy as np
import pytest
from scipy.linalg import expm

from barbalat.certificates.bounds import theorem_1
from barbalat.linear.systems import input_filter
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.filter import condition

KNOWN = section_v.problem().known


def norm_by_trapezoids(kappa: float) -> float:
    """||W_b (1 - C)||_1 of Section V from 400 000 samples of the impulse response, with a relative error below 1e-6."""
    A, B, C, _ = theorem_1.filtered_model(KNOWN, input_filter(kappa).realise())
    h = 2e-4
    step, state = expm(A * h), B[:, 0]
    states = np.empty((400_001, len(A)))
    for i in range(len(states)):
        states[i], state = state, step @ state
    return float(np.trapezoid(np.abs(states @ C.T), dx=h, axis=0).max())


def test_the_condition_flips_below_the_printed_limit():
    largest, least = theorem_1.kappa_admissible(KNOWN, 10.0), condition.fails_down_to(KNOWN, 0.05)
    assert largest < least < 0.05
    # d(norm)/d(kappa) is near norm/kappa, so 1e-5 in either direction is far more than the quadrature's error
    assert 10 * norm_by_trapezoids(largest - 1e-5) < 1 < 10 * norm_by_trapezoids(least + 1e-5)
    assert condition.holds_up_to(KNOWN, largest)
    assert not condition.holds_up_to(KNOWN, least)
    assert condition.fails_down_to(KNOWN, largest) == math.inf


def test_what_is_said_between_the_points_holds_there():
    """N(k)/k does not grow, and N(k1) <= (2 - k1/k2) N(k2). Both inequalities are sharp enough to be useful."""
    kappas = np.geomspace(1e-3, 0.2, 25)
    norms = [theorem_1.filter_condition(KNOWN, input_filter(float(k)).realise(), 1.0).norm for k in kappas]
    for i in range(len(kappas)):
        for j in range(i + 1, len(kappas)):
            ratio = kappas[i] / kappas[j]
            assert norms[j].lower * ratio <= norms[i].upper
            assert norms[i].lower <= (2 - ratio) * norms[j].upper
    assert norms[1].upper / norms[0].lower == pytest.approx(kappas[1] / kappas[0], rel=0.05)  # near zero N ~ k
