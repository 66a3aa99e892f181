"""The robust MRAC with frozen estimates: a linear loop, and the modelling error that this loop tolerates.

With theta_hat constant, xi, Xi and Q(s) are linear in x and u, and so is the control. For phi(x) = x the loop from the plant's
input v to -u is, with F = 1/(tau s + 1)^n* and G = (sI - A_m - b theta')^-1 b:

    L = [F + (theta_hat + F (theta - theta_hat))'G]/(1 - F),    affine in theta_hat;
    T = L/(1 + L) = (F + theta'G)/(1 + theta'G)                 where theta_hat = theta.

The loop is computed by the exact Jacobians of the scheme's equations; tests compare it with the formula. A modelling error
Delta_m at the plant's input closes a loop around T, which is stable for every Delta_m with |Delta_m(j w)| |T(j w)| < 1, by the
small-gain theorem. None of this is a guarantee for the adapting loop.

Source: Theorem 2; Ioannou and Sun, section 8.2; Skogestad and Postlethwaite, section 7.5.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.certificates.linear_loops.ideal import open_jacobians
from barbalat.certificates.linear_loops.worst_case import MOST_EXTREMES, points_inside
from barbalat.controllers import NormalizedMrac, RobustMrac
from barbalat.linear.brent import least_between
from barbalat.linear.crossings import frequency_grid
from barbalat.linear.systems import StateSpace, complementary_sensitivity, sensitivity, series
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import signals_at_rest
from barbalat.loop.packing import flatten
from barbalat.problem.modelling_error import ModellingError
from barbalat.problem.state_feedback import Problem
from barbalat.validate import Array, InputError

POINTS_INSIDE, FREQUENCY_STRIDE = 100, 4
"""Number of seeded points inside the known set, in addition to the extreme points, and the stride of the frequency grid at these
points. The result is an estimate in any case."""


@dataclass(frozen=True, eq=False)
class FrozenLoops:
    """The loops of one robust MRAC on one problem, broken at the plant's input, for any constant theta_hat.

    They include the linear dynamics at the plant's input. Raises InputError for a problem whose frozen loop is not rational:
    phi(x) other than x, several inputs, limits, quantisation or a delay at the plant's input.
    """

    problem: Problem
    controller: RobustMrac | NormalizedMrac

    def __post_init__(self) -> None:
        validate.instance("problem", self.problem, Problem)
        validate.instance("controller", self.controller, (RobustMrac, NormalizedMrac))
        plant = self.problem.plant
        if plant.inputs > 1:
            raise InputError(f"the frozen loop has one input, but plant.b has {plant.inputs} columns")
        if not plant.is_linear:
            raise InputError("the frozen loop is linear only for phi(x) = x: plant.regressor must be left out")
        path = plant.paths[0]
        if not path.is_linear or path.delay > 0:
            raise InputError(
                "the frozen loop is rational only without saturation, rate_limit, quantization and delay in plant.input, "
                f"got {validate.show(path)}"
            )

    def at(self, theta_hat: Array) -> StateSpace:
        """L with the estimates frozen at ``theta_hat`` (n,); its states are x, the states of the sensor and of a baseline, zeta,
        and the state of Q.

        The control depends on xi and Xi only through zeta = xi + Xi theta_hat, with zeta' = A_m zeta + b (theta_hat'x + u).
        """
        n = self.problem.plant.n
        theta_hat = validate.vector("theta_hat", theta_hat, n)
        A, B, C = self._jacobians(theta_hat)
        identity = np.eye(len(A))
        rest = [k for k in range(len(A)) if not n <= k < n + n * n]  # xi and then Xi come first
        combined = identity[rest]
        combined[:n, n : n + n * n] = np.kron(np.eye(n), theta_hat)
        loop = StateSpace(combined @ A[:, rest], combined @ B[:, 0], -C[0, rest], 0.0)
        dynamics = self.problem.plant.paths[0].dynamics
        return loop if dynamics is None else series(dynamics.realise(), loop)

    @cached_property
    def at_theta(self) -> StateSpace:
        """L with the estimates frozen at the true parameters."""
        return self.at(self.problem.plant.theta)

    @cached_property
    def gain_over_set(self) -> tuple[Array, Array] | None:
        """Frequencies (K,) and the largest |T| found over the known set, infinite if a loop is unstable; ``None`` without a set.

        L and the matrix of the closed loop are affine in theta_hat, so n + 1 loops determine the loops at all points.
        """
        known_set, n = self.problem.uncertainty, self.problem.plant.n
        if known_set is None:
            return None
        rng = np.random.default_rng(0)
        thetas = np.concatenate(
            [known_set.extreme_points(rng, MOST_EXTREMES), points_inside(known_set, rng, known_set.middle, 1.0, POINTS_INSIDE)]
        )
        origin, units = self.at(np.zeros(n)), [self.at(unit) for unit in np.eye(n)]
        w = np.unique(frequency_grid(complementary_sensitivity(self.at_theta)))[::FREQUENCY_STRIDE]
        closed = sensitivity(origin).A
        slopes = np.array([sensitivity(unit).A - closed for unit in units])
        if np.linalg.eigvals(closed + np.tensordot(thetas, slopes, 1)).real.max() >= 0:
            return w, np.full(len(w), np.inf)
        L_0 = origin.response(w)
        L = L_0 + thetas @ np.array([unit.response(w) - L_0 for unit in units])
        return w, np.abs(L / (1 + L)).max(axis=0)

    @cached_property
    def _jacobians(self) -> Any:
        """theta_hat -> A, B, C of the states that change while the estimates are frozen: xi, Xi, x, the sensor and Q's state.

        Their rates are linear in these states and v, so the Jacobians at zero are exact. The rate of the law enters only the
        swapping term, which stays zero; x_m and n_d do not affect the control.
        """
        loop = replace(ClosedLoop.of(self.problem, self.controller), paths=(None,), delayed=False)
        at_zero = signals_at_rest(loop, 0.0)
        jacobians = open_jacobians(loop, lambda state, v: loop.derivative_given_input(state, at_zero, v))
        marked = loop.unpack(np.arange(loop.size))
        parts: Any = marked.controller
        kept = flatten((parts.xi, parts.Xi, marked.x, marked.sensor, marked.baseline, parts.filter)).astype(int).tolist()
        rest, rows = np.zeros(loop.size), loop.theta_hat_rows

        def at(theta_hat: Array) -> Any:
            rest[rows] = theta_hat
            A, B, C = (np.array(part) for part in jacobians(rest, 0.0))
            return A[np.ix_(kept, kept)], B[kept], C[:, kept]

        return at


@dataclass(frozen=True, eq=False, kw_only=True)
class ToleratedSizes:
    """Sizes of a modelling error that a frozen loop tolerates.

    small_gain  below this size the loop with theta_hat = theta is stable by the small-gain theorem
    limit       the exact size at which that loop loses stability; infinite if it never loses stability
    over_set    the small-gain size for the worst theta_hat of the known set that was found: an estimate. 0 if the loop is
                unstable with one of them without any modelling error; ``None`` without a known set
    Both small-gain sizes are minima over a grid of frequencies, the first one refined.
    """

    small_gain: float
    limit: float
    over_set: float | None


def tolerated(loops: FrozenLoops, error: ModellingError) -> ToleratedSizes:
    """The sizes, for one family of modelling errors, that the loop with frozen estimates tolerates."""
    over_set = None
    if loops.gain_over_set is not None:
        w, gain = loops.gain_over_set
        over_set = float(error.allowed(w, gain).min()) if np.isfinite(gain).all() else 0.0
    return ToleratedSizes(small_gain=small_gain(loops.at_theta, error), limit=error.limit(loops.at_theta), over_set=over_set)


def small_gain(loop: StateSpace, error: ModellingError) -> float:
    """The size below which |Delta_m| |T| < 1 at all frequencies: computed on a grid around the poles of T, with the lowest minima
    refined.

    Raises InputError if the loop is unstable without any modelling error.
    """
    T = complementary_sensitivity(loop)
    largest = float(np.linalg.eigvals(T.A).real.max())
    if largest >= 0:
        raise InputError(
            f"the small-gain theorem needs a loop that is stable without modelling error, but an eigenvalue has real part "
            f"{largest:.6g}"
        )
    w = np.unique(frequency_grid(T))

    def allowed(at: Array) -> Array:
        return error.allowed(at, np.abs(T.response(at)))

    sizes = allowed(w)
    least = float(sizes.min())
    valleys = np.flatnonzero((sizes[1:-1] <= sizes[:-2]) & (sizes[1:-1] <= sizes[2:]) & (sizes[1:-1] < 1.1 * least)) + 1
    for k in valleys:
        _, found = least_between(lambda point: float(allowed(np.array([point]))[0]), w[k - 1], w[k + 1], absolute=1e-9 * w[k])
        least = min(least, found)
    return least
