"""Theorem 1 with bounded disturbances: the resulting bound on V if the estimates are projected.

With w = b d + sum_j E_j d_j, |P w| <= p and q <= lambda_min(-(P A_m + A_m'P)), V' <= -q |e|^2 + 2 p |e|: V falls wherever
|e| > 2 p/q. Over the set theta_tilde'Gamma^-1 theta_tilde <= D^2, so V <= lambda_max(P) (2 p/q)^2 + D^2 at all times.
docs/proofs.md, "Theorem 1 (i)", has the proof.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from flint import arb_mat

from barbalat.certificates.bounds import laws
from barbalat.certificates.bounds.model import require_lyapunov
from barbalat.linear.conditions import exact_matrix, is_positive_definite, smallest_eigenvalue
from barbalat.linear.enclosure import OUTWARD_FACTOR, float_above
from barbalat.problem.known_set import EstimateSet, ParameterProduct
from barbalat.problem.state_feedback import Known, Problem
from barbalat.protocols import BoundedSignal
from barbalat.validate import Array, InputError


@dataclass(frozen=True)
class Level:
    """A bound on |e|_2, or on |x_tilde|_2 of a predictor: sqrt(of_estimates^2 + pushed^2).

    nu            |theta_tilde|_2/sqrt(lambda_min(P)) at the start; with disturbances the largest value in the set
    of_estimates  nu divided by the square root of the gain
    pushed        the contribution of disturbances; 0 if there are none
    """

    nu: float
    of_estimates: float
    pushed: float = 0.0

    @property
    def value(self) -> float:
        return math.hypot(self.of_estimates, self.pushed) * OUTWARD_FACTOR if self.pushed else self.of_estimates


def is_disturbed(problem: Problem) -> bool:
    """Whether a matched or an unmatched disturbance acts."""
    return problem.disturbance is not None or bool(problem.unmatched)


def level(problem: Problem, controller: laws.LyapunovScheme, nu_0: float, closed: Known | None = None) -> Level:
    """The bound from V, with the P of ``closed`` if given.

    If a disturbance is unbounded or no estimate is projected, this is the bound without disturbances.
    """
    known = closed or problem.known
    bound_of_push, known_set = push(problem, known), controller.bind(problem.known).estimate_set
    if bound_of_push is None or known_set is None or not known_set.bounds_theta:
        return Level(nu_0, laws.error_level(problem, controller, nu_0, closed))
    require_lyapunov(known)
    least = smallest_eigenvalue(known.P)
    q, highest = decay(known), largest_eigenvalue(known.P)
    nu = farthest(known_set, problem.parameters) / math.sqrt(least) * OUTWARD_FACTOR**2
    pushed = math.sqrt(highest / least) * 2 * bound_of_push / q * OUTWARD_FACTOR**3
    return Level(nu, nu / math.sqrt(laws.least_gain(controller.gamma)) * OUTWARD_FACTOR, pushed)


def push(problem: Problem, known: Known) -> float | None:
    """p, a bound on |P w|_2, with the P of ``known``.

    None if there is no disturbance, if one is unbounded, or if there is a baseline, which has a different V.
    """
    if problem.plant.baseline is not None:
        return None
    P, columns = known.P, known.b.reshape(known.n, -1)
    acting = [] if problem.disturbance is None else [(columns[:, 0], problem.disturbance)]
    acting += [(np.asarray(one.direction), one.signal) for one in problem.unmatched]
    total = 0.0
    for direction, signal in acting:
        if not isinstance(signal, BoundedSignal):
            return None
        pushed = exact_matrix(P) * exact_matrix(direction[:, None])
        total += float_above((pushed.transpose() * pushed)[0, 0].sqrt()) * signal.bound
    return total * OUTWARD_FACTOR if acting else None


def decay(known: Known) -> float:
    """q, a lower bound on lambda_min(-(P A_m + A_m'P)), verified in ball arithmetic."""
    product = exact_matrix(known.P) * exact_matrix(known.A_m)
    Q = -(product + product.transpose())
    return _verified(float(np.linalg.eigvalsh(-(known.P @ known.A_m + known.A_m.T @ known.P))[0]), -1, lambda q: (Q, q))


def largest_eigenvalue(P: Array) -> float:
    """An upper bound on lambda_max(P), verified in ball arithmetic."""
    return _verified(float(np.linalg.eigvalsh(P)[-1]), 1, lambda largest: (-exact_matrix(P), -largest))


def _verified(value: float, side: int, definite: Callable[[float], tuple[arb_mat, float]]) -> float:
    """The candidate nearest to an approximate eigenvalue among those for which the shifted matrix is provably positive
    definite."""
    for slack in (1e-13, 1e-10, 1e-7, 1e-4, 1e-2):
        candidate = value * (1 + side * slack)
        if candidate > 0 and is_positive_definite(*definite(candidate)):
            return candidate
    raise InputError(f"an eigenvalue near {value:.3g} could not be verified")


def farthest(known_set: EstimateSet, parameters: Array) -> float:
    """The largest |theta_hat - theta|_2 over the set, rounded up."""
    if isinstance(known_set, ParameterProduct):
        theta, gains = known_set.parts(parameters)
        of_theta = 0.0 if known_set.theta is None else known_set.theta.farthest(theta)
        return math.hypot(of_theta, known_set.gains.farthest(gains)) * OUTWARD_FACTOR
    return known_set.farthest(parameters) * OUTWARD_FACTOR
