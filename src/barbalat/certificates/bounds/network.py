"""Bounds that the modification of a network's law gives: of its weights, and of e on the plant (1).

With mu = e'P b, h = (1, tanh(z)), z = V_hat'x_bar, the law makes U = |W_hat|^2/gamma + |V_hat|^2/gamma_v change by
U' = 2 mu W_hat'h - 2 w (|W_hat|^2 + |V_hat|^2): x_bar drops out. What the network adds to (e'P e)' is -2 mu W_hat'h, so that with
e' = A e + b (f - W_hat'h), Q = -(P A + A'P) and L = e'P e + U

    L' = -e'Q e + 2 mu f - 2 w (|W_hat|^2 + |V_hat|^2):

whatever the network has learnt, it never makes L grow. With |f| <= F, lambda = lambda_min(Q) > 0, p = |P b| and s = |e|, L can
grow only where lambda s^2 + 2 w omega^2 <= 2 |mu| F, omega^2 = |W_hat|^2 + |V_hat|^2, so that it stays below its largest value
there, or where it starts. For w = nu |mu| the weights are bounded whatever the plant does: W_i' has the sign of
mu c_i - nu |mu| W_i with c_i = h_i - h_i' z_i in [-1, 1].
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from barbalat.certificates.bounds.model import command_bounds, require_lyapunov, state_bounds
from barbalat.certificates.bounds.regressor import largest_square
from barbalat.controllers.mrac_network import Equations
from barbalat.linear.definite import smallest_eigenvalue
from barbalat.linear.enclosure import OUTWARD_FACTOR
from barbalat.linear.l1_norms import l1_norm
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import BoundedSignal
from barbalat.validate import Array, InputError

ROUNDING = 1e-12
"""Of |P| |A|: far more than the few roundings of an entry of P A + A'P."""
MOST_TRIALS = 100
GROWTH = 1.02
"""From one tried bound of e to the next, beyond what the last one gave: MOST_TRIALS of them span more than all that is of use."""


NO_BOUND = (
    "without weights that are known to approximate theta'phi, its proof needs that A_m outweighs theta'phi by itself, "
    "and here it does not"
)


@dataclass(frozen=True)
class WeightBounds:
    """Of every component of e, of every outer weight, of |V_hat| in the Frobenius norm; None where none is found, and why."""

    error: float | None = None
    W_hat: float | None = None
    V_hat: float | None = None
    why: str = NO_BOUND


@dataclass(frozen=True, eq=False)
class NetworkLaw:
    """The numbers of a law's modification that the bounds need."""

    gamma: float
    gamma_v: float
    outer_weights: int
    start: float  # |V_hat(0)|^2/gamma_v, which is L(0) and U(0), rounded up
    sigma: float | None  # of the sigma-modification
    nu: float | None  # of the e-modification

    @classmethod
    def of(cls, equations: Equations) -> NetworkLaw:
        leakage = equations.leakage
        return cls(
            gamma=equations.gamma,
            gamma_v=equations.gamma_v,
            outer_weights=1 + equations.neurons,
            start=float(np.sum(equations.V_0**2)) / equations.gamma_v * OUTWARD_FACTOR,
            sigma=leakage.largest if leakage.per_error is None else None,
            nu=leakage.per_error,
        )

    def highest_level(self, F: float, lowest: float, highest: float, p: float) -> float:
        """At least sup L, from |f| <= F, lambda_min(Q) >= ``lowest``, lambda_max(P) <= ``highest``, |P b| <= p."""
        least, farthest = min(self.gamma, self.gamma_v), 2 * p * F / lowest  # |e|, beyond which L falls
        if self.nu is not None:  # omega^2 <= (F - lambda s/(2 p))/nu: convex in s, so largest at an end
            found = max(highest * farthest**2, F / (self.nu * least))
        else:  # omega^2 <= (2 p F s - lambda s^2)/(2 sigma)
            assert self.sigma is not None
            found = _largest(highest - lowest / (2 * self.sigma * least), p * F / (self.sigma * least), farthest)
        return max(self.start, found) * OUTWARD_FACTOR

    @property
    def whatever_acts(self) -> WeightBounds | None:
        """Of the weights alone, by the e-modification."""
        if self.nu is None:
            return None
        far = math.sqrt(self.outer_weights) / self.nu  # U falls where omega^2 > far |W_hat|
        level = max(self.start, _largest(1 / self.gamma - 1 / self.gamma_v, far / self.gamma_v, far))
        return WeightBounds(W_hat=OUTWARD_FACTOR / self.nu, V_hat=math.sqrt(self.gamma_v * level) * OUTWARD_FACTOR**2)


def _largest(a: float, b: float, end: float) -> float:
    """max a s^2 + b s for 0 <= s <= end, with b >= 0."""
    at = [end] if a >= 0 else [min(end, -b / (2 * a))]
    return max(0.0, *(a * s * s + b * s for s in at))


@dataclass(frozen=True, eq=False)
class ErrorBoundCase:
    """What of the problem the bound of e needs."""

    problem: Problem
    law: NetworkLaw
    x_m: Array  # (n,) bounds
    d: float

    @classmethod
    def of(cls, problem: Problem, equations: Equations) -> ErrorBoundCase:
        """InputError for signals without a bound."""
        d, bound = problem.disturbance, 0.0
        if d is not None:
            if not isinstance(d, BoundedSignal):
                raise InputError("the disturbance has no known bound")
            bound = d.bound
        return cls(problem, NetworkLaw.of(equations), np.array(state_bounds(problem)), bound)

    def uncertainty(self, reach: float) -> float:
        """At least |theta'phi(x) + d|, every |x_i| at most the model's bound plus ``reach``."""
        plant, far = self.problem.plant, self.x_m + reach
        if plant.is_linear:
            return (float(np.abs(plant.theta) @ far) + self.d) * OUTWARD_FACTOR
        square = largest_square(plant.regressor, -far, far)
        return (float(np.linalg.norm(plant.theta)) * math.sqrt(square) + self.d) * OUTWARD_FACTOR

    def level(self, A: Array, F: float) -> float:
        """At least sup L with |f| <= F and e' = A e + b (f - W_hat'h)."""
        known = self.problem.known
        P = known.P
        require_lyapunov(known)
        lowest = smallest_eigenvalue(-(P @ A + A.T @ P)) - ROUNDING * float(np.linalg.norm(P) * np.linalg.norm(A))
        if not lowest > 0:
            raise InputError("P A + A'P is not certainly negative definite")
        highest, p = float(np.linalg.eigvalsh(P)[-1]) * OUTWARD_FACTOR, float(np.linalg.norm(P @ known.b)) * OUTWARD_FACTOR
        return self.law.highest_level(F, lowest, highest, p)

    def error_of(self, level: float) -> float:
        return math.sqrt(level / smallest_eigenvalue(self.problem.known.P)) * OUTWARD_FACTOR

    def driven(self, A: Array, F: float) -> float:
        """By ||(sI - A)^-1 b||_1, with the network's output as a bounded disturbance: the e-modification's alone."""
        bound = self.law.whatever_acts
        if bound is None or bound.W_hat is None:
            return math.inf
        b, n, largest = self.problem.known.b[:, None], self.problem.known.n, F + self.law.outer_weights * bound.W_hat
        return l1_norm(A, b, np.eye(n), np.zeros((n, 1))).upper * largest * OUTWARD_FACTOR

    def globally(self) -> tuple[float, float | None] | None:
        """The bound of e, and of L where it follows from that, for phi(x) = x: the true A takes the place of A_m."""
        A, F = self.problem.plant.A, self.uncertainty(0.0)
        found: list[tuple[float, float | None]] = []
        try:
            level = self.level(A, F)
            found.append((self.error_of(level), level))
        except InputError:
            pass
        if np.linalg.eigvals(A).real.max() < 0:
            found.append((self.driven(A, F), None))
        finite = [each for each in found if math.isfinite(each[0])]
        return min(finite, key=lambda each: each[0]) if finite else None

    def trapped(self) -> tuple[float, float | None] | None:
        """The same for any phi: a bound E such that |e| <= E, while it lasts, keeps |e| below E."""
        A, reach = self.problem.known.A_m, 0.0
        for _ in range(MOST_TRIALS):
            F = self.uncertainty(reach)
            if not math.isfinite(F):
                return None
            level = self.level(A, F)
            by_level, by_norm = self.error_of(level), self.driven(A, F)
            following = min(by_level, by_norm)
            if following < reach:
                return following, level if by_level <= by_norm else None
            reach = GROWTH * following
        return None


def bounds(problem: Problem, equations: Equations) -> WeightBounds:
    """All that is found."""
    always = NetworkLaw.of(equations).whatever_acts
    try:
        case = ErrorBoundCase.of(problem, equations)
        found = case.globally() if problem.plant.is_linear else case.trapped()
    except InputError as refused:  # a command or a disturbance without a bound, an A_m too close to losing stability
        return replace(always or WeightBounds(), why=str(refused))
    error, level = found if found is not None else (None, None)
    if always is not None:
        return replace(always, error=error)
    if level is None:
        return WeightBounds(error=error)
    W_hat, V_hat = (math.sqrt(gain * level) * OUTWARD_FACTOR for gain in (equations.gamma, equations.gamma_v))
    return WeightBounds(error, W_hat, V_hat)


def control_bound(problem: Problem, equations: Equations, W_hat: float) -> float:
    """Of |u|, from that of every outer weight, or of all of them together by the sigma-modification."""
    together = equations.leakage.per_error is None
    weights = math.sqrt(1 + equations.neurons) if together else 1 + equations.neurons
    return (weights * W_hat + float(command_bounds(problem)[0])) * OUTWARD_FACTOR**2
