"""The structured singular value of the matched family (1), (11): real parameters and complex dynamics at the plant's input.

Everything uncertain of x' = (A_m + b theta') x + b (1 + W Delta)[u] enters where the control does, so the matrix that the
uncertainty sees has rank one and mu has a closed form (Young, 1994: for rank one the upper bound of mu is exact): with
a_i = w_i e_i'(jw I - A)^-1 b S(jw), the responses of the states to a perturbation at the plant's input, and rho = |W T|,

    mu = max {t real: t = sum delta_i a_i + rho z, |delta_i| <= 1, |z| <= 1}
       = min over m of  sum |Re a_i + m Im a_i| + rho sqrt(1 + m^2).

Every m gives an upper bound; the minimum is convex and is taken exactly, among the breakpoints and the points between them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from barbalat.validate import Array

REAL_TO_ROUNDING = 1e-9
"""An imaginary part below this fraction of its number counts as zero: a real parameter alone matters only where it is."""


class Mu(NamedTuple):
    """At K frequencies: mu (K,), and the minimising m (K,)."""

    value: Array
    m: Array


def mu_of_family(a: Array, rho: Array) -> Mu:
    """mu for the responses ``a`` (K, n), complex, and the radius of the dynamic uncertainty ``rho`` (K,), not negative."""
    alpha, beta = a.real, np.where(np.abs(a.imag) <= REAL_TO_ROUNDING * np.abs(a), 0.0, a.imag)
    with np.errstate(divide="ignore", invalid="ignore"):
        breakpoints = np.where(beta != 0, -alpha / beta, 0.0)  # (K, n)
    order = np.argsort(breakpoints, axis=1)
    steps = 2 * np.take_along_axis(np.abs(beta), order, axis=1)
    start = -np.abs(beta).sum(axis=1, keepdims=True)
    slopes = np.concatenate([start, start + np.cumsum(steps, axis=1)], axis=1)  # of the sum of moduli, between breakpoints
    room = rho[:, None] ** 2 - slopes**2
    between = np.where(room > 0, -slopes / np.sqrt(np.where(room > 0, room, 1.0)), 0.0)  # where rho sqrt(1 + m^2) balances it
    candidates = np.concatenate([breakpoints, between], axis=1)  # (K, 2 n + 1), the minimiser among them
    moduli = np.abs(alpha[:, None, :] + candidates[:, :, None] * beta[:, None, :]).sum(axis=2)
    values = moduli + rho[:, None] * np.sqrt(1 + candidates**2)
    best = values.argmin(axis=1)[:, None]
    return Mu(*(np.take_along_axis(part, best, axis=1)[:, 0] for part in (values, candidates)))


def destabilising(a: Array, m: float) -> Array:
    """The delta (n,) in [-1, 1] that attains mu = sum delta_i a_i at one frequency, for real parameters alone.

    Where alpha_i + m beta_i vanishes delta_i is free and cancels the imaginary part.
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
