"""Lemma 1 (ii) without a plant: one parameter, piecewise constant phi and eta, and m^2 = 1 + phi^2, all in closed form.

With least squares, p = 1/P and q = p theta_tilde are integrals with p' = phi^2/m^2 and q' = phi eta/m^2, and V = q^2/p changes
by V' = -(epsilon m)^2 + eta^2/m^2. With the gradient law, theta_tilde tends to eta/phi as exp(-gamma phi^2/m^2 t). The
estimates stay inside the known set.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from barbalat.papers.claim import Listing, span, table
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.validate import Array

BIASED_TIMES = (10.0, 100.0, 1000.0)
"""Durations [s] of eta = 1 with phi = 1. Afterwards eta is zero."""
WEAK_REGRESSORS = (0.3, 0.1, 0.03)
"""Values of phi for which eta = phi LEARNT_BIAS leads to a wrong estimate until phi = 1 reveals the error."""
LEARNT_BIAS = 5.0
"""The learnt bias, which is smaller than the width of Section V's set."""
GRADIENT_GAIN = 10.0
BOUNDED_GROWTH = 1.5
"""Constants count as bounded if they grow by at most this factor from one signal to the next. The constants of pure least squares
grow tenfold."""


class Piece(NamedTuple):
    """Constant signals over an interval of time [s]."""

    duration: float
    phi: float
    eta: float

    @property
    def m_squared(self) -> float:
        return 1 + self.phi**2


class ScalarLaw(Protocol):
    """An adaptive law: its initial state, and the effect of a piece on the state."""

    def initial(self) -> tuple[float, float]: ...

    def over(self, state: tuple[float, float], piece: Piece) -> tuple[tuple[float, float], float]:
        """Return the state at the end of the piece, and the integral of (epsilon m)^2 over it."""
        ...


class ScalarLeastSquares(NamedTuple):
    """Law (15) with P(0). The state is p = 1/P and q = theta_tilde/P, and starts from theta_tilde = 0."""

    covariance0: float = section_v.COVARIANCE0

    def initial(self) -> tuple[float, float]:
        return 1 / self.covariance0, 0.0

    def over(self, state: tuple[float, float], piece: Piece) -> tuple[tuple[float, float], float]:
        p, q = state
        then = p + piece.phi**2 / piece.m_squared * piece.duration, q + piece.phi * piece.eta / piece.m_squared * piece.duration
        spent = q**2 / p - then[1] ** 2 / then[0] + piece.eta**2 / piece.m_squared * piece.duration
        return then, spent


class ScalarGradient(NamedTuple):
    """The law theta_hat' = gamma epsilon phi. The state is theta_tilde, which starts from 0, and an unused entry."""

    gamma: float = GRADIENT_GAIN

    def initial(self) -> tuple[float, float]:
        return 0.0, 0.0

    def over(self, state: tuple[float, float], piece: Piece) -> tuple[tuple[float, float], float]:
        goal = piece.eta / piece.phi
        apart = state[0] - goal
        left = float(np.exp(-self.gamma * piece.phi**2 / piece.m_squared * piece.duration))
        return (goal + left * apart, 0.0), apart**2 * (1 - left**2) / (2 * self.gamma)


def spent_in_the_last(law: ScalarLaw, pieces: tuple[Piece, ...]) -> float:
    """Return the integral of (epsilon m)^2 over the last piece."""
    state, spent = law.initial(), 0.0
    for piece in pieces:
        state, spent = law.over(state, piece)
    return spent


def biased(duration: float) -> tuple[Piece, Piece]:
    """Return a lasting modelling error, followed by no error until the estimate has converged."""
    return Piece(duration, 1.0, 1.0), Piece(1e6 * duration, 1.0, 0.0)


def weakly_taught(phi: float) -> tuple[tuple[Piece, Piece], float]:
    """Return a weak regressor from which a bias is learnt, a strong one without error, and mu, the largest eta^2/m^2 of both.

    The second piece lasts T = 1/mu. The first is so long that phi^2/m^2 times its duration is T/2, as for the second. Least
    squares then has evidence T/2 for the bias, and the integral of (epsilon m)^2 over the second piece is LEARNT_BIAS^2 T/4,
    where mu T + 1 = 2.
    """
    first = Piece(1.0, phi, phi * LEARNT_BIAS)
    mu = first.eta**2 / first.m_squared
    T = 1 / mu
    return (first._replace(duration=T / 2 * first.m_squared / phi**2), Piece(T, 1.0, 0.0)), mu


def constants(law: ScalarLaw) -> Array:
    """Return for each of WEAK_REGRESSORS the smallest nu of the paper's definition, integral <= nu (mu T + 1), over the last
    piece."""
    taught = [weakly_taught(phi) for phi in WEAK_REGRESSORS]
    return np.array([spent_in_the_last(law, pieces) / (mu * pieces[1].duration + 1) for pieces, mu in taught])


def readings() -> tuple[Reading, Reading]:
    """Return the readings for any signals of (13): one with the paper's constant mu, and one with the integral of eta^2/m_s^2
    over the same interval."""
    taught, left = _of_both(constants), _of_both(_left)
    return (
        SENTENCES["lemma-1-small"].reads(
            _bounded(taught[0]),
            f"if a bias of {LEARNT_BIAS:g} is learnt with phi = {WEAK_REGRESSORS[0]:g} down to {WEAK_REGRESSORS[-1]:g} before "
            f"phi = 1, pure least squares (15) needs nu = {taught[0][0]:.3g} to {taught[0][-1]:.3g} for epsilon m_s, and the "
            f"gradient law needs {span(taught[1])}",
        ),
        Reading(
            "with the integral of eta^2/m_s^2 over the same interval, for any signals of (13)",
            _bounded(left[0]),
            f"phi = 1, m_s^2 = 2, eta = 1 on [0, T_1], then 0. With pure least squares (15) the integral of (epsilon m_s)^2 "
            f"after T_1 goes from {left[0][0]:.3g} at T_1 = {BIASED_TIMES[0]:g} s to {left[0][-1]:.3g} at {BIASED_TIMES[-1]:g} "
            f"s; with the gradient law it is {span(left[1])}",
            "beside",
        ),
    )


def listings() -> tuple[Listing, Listing]:
    """Return the values behind the two readings, signal by signal."""
    taught, left = _of_both(constants), _of_both(_left)
    mus = [weakly_taught(phi)[1] for phi in WEAK_REGRESSORS]
    return (
        table(
            f"The smallest nu for epsilon m_s with the paper's constant mu, after a bias of {LEARNT_BIAS:g} "
            "was learnt with a weak regressor phi",
            {"phi": WEAK_REGRESSORS, "mu": mus, "least squares (15)": taught[0], "gradient": taught[1]},
        ),
        table(
            "The integral of (epsilon m_s)^2 after T_1, following a modelling error eta = 1 that lasted until T_1",
            {"T_1 [s]": BIASED_TIMES, "least squares (15)": left[0], "gradient": left[1]},
        ),
    )


def _of_both(measure: Callable[[ScalarLaw], Array]) -> tuple[Array, Array]:
    """Return the results for pure least squares and for the gradient law."""
    return measure(ScalarLeastSquares()), measure(ScalarGradient())


def _left(law: ScalarLaw) -> Array:
    return np.array([spent_in_the_last(law, biased(T)) for T in BIASED_TIMES])


def _bounded(found: Array) -> bool:
    return bool((found[1:] <= BOUNDED_GROWTH * found[:-1]).all())
