"""The closed forms, compared with the package's own laws integrated with SciPy, and the sums, compared with theory."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from barbalat.adaptation.law import Estimation
from barbalat.adaptation.laws import Gradient, LeastSquares
from barbalat.papers.jafari_2013.robustness import scalar_lemma
from barbalat.papers.jafari_2013.robustness.scalar_lemma import Piece, ScalarGradient, ScalarLeastSquares

PIECES = (Piece(3.0, 0.4, 1.0), Piece(2.0, 1.5, -0.3), Piece(1.0, 1.0, 0.0))


def integrated(law, pieces):
    """theta_tilde and the integral of (epsilon m)^2 over each piece, for a law of the package with theta = 0."""
    memory = law.initial(1)
    state, spent = np.concatenate([[0.0], np.ravel(memory[0]) if memory else []]), []
    for piece in pieces:

        def slope(_, y, piece=piece):
            now = type(memory)(np.array(y[1:-1]).reshape(1, 1)) if memory else memory
            epsilon = (piece.eta - y[0] * piece.phi) / piece.m_squared
            found = law.rates(y[:1], now, Estimation(np.array([piece.phi]), piece.m_squared, epsilon), None)
            grown = np.ravel(found.memory[0]) if memory else []
            return np.concatenate([np.ravel(found.theta_hat), grown, [epsilon**2 * piece.m_squared]])

        end = solve_ivp(slope, (0, piece.duration), [*state, 0.0], rtol=1e-10, atol=1e-13).y[:, -1]
        state = end[:-1]
        spent.append(end[-1])
    return state[0], np.array(spent)


@pytest.mark.parametrize(
    ("closed", "law", "theta_tilde"),
    [
        (ScalarLeastSquares(covariance0=20.0), LeastSquares(covariance0=20.0), lambda state: state[1] / state[0]),
        (ScalarGradient(gamma=3.0), Gradient(gamma=3.0), lambda state: state[0]),
    ],
)
def test_the_closed_forms_are_the_laws(closed, law, theta_tilde):
    end, spent = integrated(law, PIECES)
    state, found = closed.initial(), []
    for piece in PIECES:
        state, part = closed.over(state, piece)
        found.append(part)
    assert theta_tilde(state) == pytest.approx(end, rel=1e-7)
    np.testing.assert_allclose(found, spent, rtol=1e-7)


def test_pure_least_squares_spends_what_the_error_has_taught():
    """With phi = 1, m^2 = 2 and eta = 1 until T_1, V(T_1) = T_1/2 except for 1/P(0), and all of it is dissipated afterwards."""
    spent = [scalar_lemma.spent_in_the_last(ScalarLeastSquares(), scalar_lemma.biased(T)) for T in (10.0, 100.0, 1000.0)]
    np.testing.assert_allclose(spent, [5.0, 50.0, 500.0], rtol=1e-3)
    by_gradient = scalar_lemma.spent_in_the_last(ScalarGradient(gamma=10.0), scalar_lemma.biased(10.0))
    assert by_gradient == pytest.approx(1 / (2 * 10), rel=1e-6)  # V(T_1) = theta_tilde^2/(2 gamma)


def test_no_constant_of_the_papers_definition_serves_all_signals():
    """LEARNT_BIAS^2 T/4 divided by mu T + 1 = 2 at T = 1/mu with mu = LEARNT_BIAS^2 phi^2/(1 + phi^2) is (1 + phi^2)/(8
    phi^2)."""
    phi = np.array(scalar_lemma.WEAK_REGRESSORS)
    np.testing.assert_allclose(scalar_lemma.constants(ScalarLeastSquares()), (1 + phi**2) / (8 * phi**2), rtol=0.02)
    assert scalar_lemma.constants(ScalarGradient()).max() <= scalar_lemma.LEARNT_BIAS**2 / (4 * scalar_lemma.GRADIENT_GAIN)
    for weak in phi:
        pieces, _ = scalar_lemma.weakly_taught(float(weak))
        p, q = ScalarLeastSquares().over(ScalarLeastSquares().initial(), pieces[0])[0]
        assert 0 < q / p <= scalar_lemma.LEARNT_BIAS  # within Section V's set, so no bound is reached
