"""The uncertainty that a linear loop tolerates: mu of the matched family over all frequencies, and the parameters that
destabilise it.

A grid proves nothing between its points. Therefore every peak of mu is refined, the frequencies at which a single real parameter
could destabilise the loop are computed, and the destabilising parameters found by mu are verified by eigenvalues.

The family is the matched one, (1) and (11): real parameters, and complex dynamics at the plant's input.

All uncertainty in x' = (A_m + b theta') x + b (1 + W Delta)[u] enters at the control input, so the matrix between the
uncertainty's ports has rank one and mu has a closed form (Young, 1994: for rank one the upper bound of mu is exact). With a_i =
w_i e_i'(jw I - A)^-1 b S(jw), the responses of the states to a perturbation at the plant's input, and rho = |W T|,

    mu = max {t real: t = sum delta_i a_i + rho z, |delta_i| <= 1, |z| <= 1}
       = min over m of  sum |Re a_i + m Im a_i| + rho sqrt(1 + m^2).

Every m gives an upper bound. The function is convex, and its minimum is computed exactly among the breakpoints and the points
between them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from barbalat.linear.brent import least_between, zero_between
from barbalat.linear.crossings import frequency_grid
from barbalat.linear.systems import StateSpace, TransferFunction, sensitivity, states_response
from barbalat.validate import Array, InputError

REAL_TO_ROUNDING = 1e-9
"""An imaginary part below this fraction of its number counts as zero: only then can a real parameter act alone."""


class Mu(NamedTuple):
    """Values at K frequencies: mu (K,), and the minimising m (K,)."""

    value: Array
    m: Array


def mu_of_family(a: Array, rho: Array) -> Mu:
    """mu for the complex responses ``a`` (K, n) and the nonnegative radius ``rho`` (K,) of the dynamic uncertainty."""
    alpha, beta = a.real, np.where(np.abs(a.imag) <= REAL_TO_ROUNDING * np.abs(a), 0.0, a.imag)
    with np.errstate(divide="ignore", invalid="ignore"):
        breakpoints = np.where(beta != 0, -alpha / beta, 0.0)  # (K, n)
    order = np.argsort(breakpoints, axis=1)
    steps = 2 * np.take_along_axis(np.abs(beta), order, axis=1)
    start = -np.abs(beta).sum(axis=1, keepdims=True)
    slopes = np.concatenate([start, start + np.cumsum(steps, axis=1)], axis=1)  # of the sum of moduli, between breakpoints
    room = rho[:, None] ** 2 - slopes**2
    # the point between breakpoints at which rho sqrt(1 + m^2) balances the slope
    between = np.where(room > 0, -slopes / np.sqrt(np.where(room > 0, room, 1.0)), 0.0)
    candidates = np.concatenate([breakpoints, between], axis=1)  # (K, 2 n + 1), the minimiser among them
    moduli = np.abs(alpha[:, None, :] + candidates[:, :, None] * beta[:, None, :]).sum(axis=2)
    values = moduli + rho[:, None] * np.sqrt(1 + candidates**2)
    best = values.argmin(axis=1)[:, None]
    return Mu(*(np.take_along_axis(part, best, axis=1)[:, 0] for part in (values, candidates)))


def destabilising(a: Array, m: float) -> Array:
    """The delta (n,) in [-1, 1] that attains mu = sum delta_i a_i at a frequency, for real parameters alone.

    If alpha_i + m beta_i vanishes, delta_i is free and cancels the imaginary part.
    """
    alpha, beta = a.real, a.imag
    slope = alpha + m * beta
    free = np.abs(slope) <= 1e-12 * np.abs(a)
    delta = np.where(free, 0.0, np.sign(slope))
    missing = -float(delta @ beta)
    for i in np.flatnonzero(free & (beta != 0)):
        delta[i] = np.clip(missing / beta[i], -1.0, 1.0)
        missing -= delta[i] * beta[i]
    return np.asarray(delta)


@dataclass(frozen=True, eq=False, kw_only=True)
class MatchedFamily:
    """x' = A_m x + b (theta'x + (1 + W Delta)[u]), theta in a box, |Delta(j w)| <= 1, with one linear controller.

    loop    the loop broken at the plant's input, with theta at the centre of the box; its first n states are those of the plant
    width   (n,) half widths of the box
    weight  W(s), the size of the unmodelled dynamics; ``None`` without unmodelled dynamics

    Raises InputError if the loop is unstable at the centre: mu is then meaningless.
    """

    loop: StateSpace
    width: Array
    weight: TransferFunction | None = None

    def __post_init__(self) -> None:
        largest = float(np.linalg.eigvals(sensitivity(self.loop).A).real.max())
        if largest >= 0:
            raise InputError(
                f"mu needs a loop that is stable at the centre of the known set, but an eigenvalue has real part {largest:.6g}"
            )

    def channels(self, w: Array) -> tuple[Array, Array]:
        """a (K, n), the responses of the states to a perturbation at the plant's input, times the half widths; rho (K,) = |W
        T|."""
        S = sensitivity(self.loop)
        a = states_response(S.A, S.B, w)[:, : len(self.width)] * self.width
        if self.weight is None:
            return a, np.zeros(len(a))
        return a, np.abs(self.weight.at(1j * w) * (1 - S.response(w)))


@dataclass(frozen=True, eq=False, kw_only=True)
class RobustStability:
    """mu over frequency.

    w, mu      (K,) the frequencies tried [rad/s], including the refined peaks, and the exact mu at each
    peak       the largest of them: the family is stable up to 1/peak of its size, as far as these frequencies show
    frequency  its frequency
    delta      (n,) for real parameters alone: theta = centre + width delta is the nearest point found on the stability boundary
    """

    w: Array
    mu: Array
    peak: float
    frequency: float
    delta: Array | None

    @property
    def scale(self) -> float:
        """The factor by which the uncertainty may grow before the loop can lose stability; infinite if it never loses
        stability."""
        return 1 / self.peak if self.peak > 0 else np.inf


def robust_stability(family: MatchedFamily) -> RobustStability:
    """mu of the family, on a grid around the closed-loop poles and at the critical frequencies, with each peak refined."""
    grid = np.unique(np.concatenate([[0.0], frequency_grid(sensitivity(family.loop))]))
    w = np.unique(np.concatenate([grid, _real_crossings(family, grid)]))
    w = np.unique(np.concatenate([w, _refined(family, w)]))
    a, rho = family.channels(w)
    found = mu_of_family(a, rho)
    k = int(found.value.argmax())
    peak = float(found.value[k])
    delta = None
    if family.weight is None and peak > 0:
        delta = destabilising(a[k], float(found.m[k])) / peak
    return RobustStability(w=w, mu=found.value, peak=peak, frequency=float(w[k]), delta=delta)


def _refined(family: MatchedFamily, w: Array) -> Array:
    """The maximisers between the neighbours of every local maximum that is at least half of the largest."""
    values = mu_of_family(*family.channels(w)).value
    inside = np.flatnonzero((values[1:-1] >= values[:-2]) & (values[1:-1] >= values[2:]) & (values[1:-1] > values.max() / 2)) + 1

    def negative(point: float) -> float:
        return -float(mu_of_family(*family.channels(np.array([point]))).value[0])

    return np.array([least_between(negative, w[k - 1], w[k + 1], absolute=1e-9 * w[k])[0] for k in inside])


def _real_crossings(family: MatchedFamily, grid: Array) -> Array:
    """Frequencies at which some a_i is real: a parameter can act alone at these frequencies, and mu of real parameters may
    jump."""

    def imaginary(point: float, i: int) -> float:
        return float(family.channels(np.array([point]))[0][0, i].imag)

    values = family.channels(grid)[0].imag
    found = []
    for i in np.flatnonzero(family.width > 0):
        for k in np.flatnonzero(values[:-1, i] * values[1:, i] < 0):
            found.append(zero_between(partial(imaginary, i=int(i)), grid[k], grid[k + 1], absolute=1e-300, relative=1e-14))
    return np.array(found)
