"""Exact gain, phase and delay margins of a linear loop, broken at the plant input.

Source: Skogestad and Postlethwaite, Multivariable Feedback Control, section 2.4.3; the crossovers are found as zeros of
1 - L(-s)L(s) and L(s) - L(-s) on the imaginary axis, so that none is missed between the points of a frequency grid.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from barbalat.linear import StateSpace
from barbalat.validate import Array, InputError


@dataclass(frozen=True)
class Margins:
    """Of the loop L with u = -L v around it; infinite where nothing of that kind destabilises.

    gain_up, gain_down  factors > 1 and < 1 at which the loop loses stability
    phase               the smallest phase lag or lead [rad] that does, over all crossovers
    delay               the smallest delay [s] that does, over all crossovers
    crossovers          (K,) frequencies [rad/s] with |L| = 1
    """

    gain_up: float
    gain_down: float
    phase: float
    delay: float
    crossovers: tuple[float, ...]


def margins(loop: StateSpace) -> Margins:
    """Margins of a loop that is stable when closed; InputError with the closed loop's largest real part if it is not.

    A loop with |L(j w)| -> 1 for w -> infinity has no delay margin and is refused too.
    """
    closed = sensitivity(loop).A
    largest = float(np.linalg.eigvals(closed).real.max()) if loop.order else -np.inf
    if largest >= 0:
        raise InputError(f"margins need a stable closed loop, but its largest eigenvalue has real part {largest:.6g}")
    crossovers = _crossings(loop, lambda w: np.abs(loop.response(w)) - 1, one_minus_magnitude(loop))
    phases = [_phase_to_minus_one(loop, w) for w in crossovers]
    delays = [phase / w for phase, w in zip(phases, crossovers, strict=True)]
    delay = min(delays, default=np.inf)
    if abs(loop.D) >= 1:  # |L| >= 1 up to infinite frequency: an arbitrarily small delay meets -1
        delay = 0.0
    nearest = [min(phase, 2 * np.pi - phase) for phase in phases]
    up, down = _gain_factors(loop)
    return Margins(up, down, min(nearest, default=np.inf), float(delay), tuple(crossovers))


def sensitivity(loop: StateSpace) -> StateSpace:
    """S = 1/(1 + L); InputError where 1 + L(infinity) = 0."""
    return_difference = 1 + loop.D
    if abs(return_difference) < 1e-12:
        raise InputError(f"the closed loop is not well posed: 1 + L(infinity) = {return_difference:.3g}")
    closed = loop.A - np.outer(loop.B, loop.C) / return_difference
    return StateSpace(closed, loop.B / return_difference, -loop.C / return_difference, 1 / return_difference)


def complementary_sensitivity(loop: StateSpace) -> StateSpace:
    """T = 1 - S = L/(1 + L)."""
    S = sensitivity(loop)
    return StateSpace(S.A, S.B, -S.C, 1 - S.D)


def _phase_to_minus_one(loop: StateSpace, w: float) -> float:
    """The lag in (0, 2 pi] that turns L(j w) to the negative real axis."""
    lag = float(np.angle(-loop.response(np.array([w]))[0])) % (2 * np.pi)
    return lag if lag > 0 else 2 * np.pi


def _gain_factors(loop: StateSpace) -> tuple[float, float]:
    """The factors next to 1, above and below, that bring L(j w) to -1 at some w, zero and infinity included."""
    at = _crossings(loop, lambda w: loop.response(w).imag, _imaginary_part(loop))
    values = [float(loop.response(np.array([w]))[0].real) for w in at]
    if loop.order == 0 or np.linalg.cond(loop.A) < 1 / np.finfo(float).eps:
        values.append(float(loop.response(np.zeros(1))[0].real))
    values.append(loop.D)
    factors = [-1 / value for value in values if value < 0]
    up = min((k for k in factors if k > 1), default=np.inf)
    down = max((k for k in factors if k < 1), default=0.0)
    return float(up), float(down)


def one_minus_magnitude(loop: StateSpace) -> StateSpace:
    """1 - L(-s)L(s): L(-s) is (-A', -C', B', D), in series behind L. On the imaginary axis it is 1 - |L|^2."""
    A, B, C, D = loop.A, loop.B, loop.C, loop.D
    n = loop.order
    behind = np.block([[A, np.zeros((n, n))], [-np.outer(C, C), -A.T]])
    return StateSpace(behind, np.concatenate([B, -C * D]), -np.concatenate([D * C, B]), 1 - D * D)


def _imaginary_part(loop: StateSpace) -> StateSpace:
    """L(s) - L(-s): on the imaginary axis it is 2j Im L."""
    A, B, C = loop.A, loop.B, loop.C
    n = loop.order
    beside = np.block([[A, np.zeros((n, n))], [np.zeros((n, n)), -A.T]])
    return StateSpace(beside, np.concatenate([B, -C]), np.concatenate([C, -B]), 0.0)


def _crossings(loop: StateSpace, function: Callable[[Array], Array], system: StateSpace) -> list[float]:
    """All w > 0 with function(w) = 0: zeros of ``system`` on the axis, and sign changes on a grid laid around the poles.

    The zeros miss nothing between grid points; the grid holds against the rounding of zeros beside lightly damped poles.
    Both are bracketed and refined on the function itself, so that no spurious one is returned.
    """
    from scipy.optimize import brentq

    candidates = axis_zeros(system)
    points = np.unique(np.concatenate([frequency_grid(loop), *(w * (1 + _SPREAD) for w in candidates)]))
    values = function(points)
    found = [float(w) for w, value in zip(points, values, strict=True) if value == 0]
    for k in np.flatnonzero(values[:-1] * values[1:] < 0):
        found.append(
            float(brentq(lambda w: float(function(np.array([w]))[0]), points[k], points[k + 1], xtol=1e-300, rtol=1e-13))
        )
    return sorted(found)


_SPREAD = np.concatenate([-np.logspace(-2, -12, 21), np.logspace(-12, -2, 21)])
"""Relative distances around a computed zero that bracket the true one whatever rounding did to it."""


def frequency_grid(loop: StateSpace) -> Array:
    """Frequencies from far below to far above the poles, dense where a lightly damped one makes a narrow peak."""
    poles = np.linalg.eigvals(loop.A)
    sizes = np.abs(poles[np.abs(poles) > 0])
    low, high = (sizes.min(), sizes.max()) if len(sizes) else (1.0, 1.0)
    gain = max(1.0, float(np.linalg.norm(loop.C) * np.linalg.norm(loop.B)) / low)
    wide = np.geomspace(low * 1e-4, high * 10 * gain, 2000)
    offsets = np.concatenate([-np.geomspace(1e-3, 1e3, 60)[::-1], [0.0], np.geomspace(1e-3, 1e3, 60)])
    peaks = [p.imag + max(abs(p.real), 1e-12 * abs(p.imag)) * offsets for p in poles if p.imag > 0]
    grid = np.concatenate([wide, *peaks])
    return np.asarray(grid[grid > 0])


def axis_zeros(system: StateSpace) -> Array:
    """The positive w near which the system vanishes at s = j w: generalised eigenvalues of its pencil."""
    from scipy.linalg import eig

    n = system.order
    if n == 0:
        return np.zeros(0)
    pencil = np.block([[system.A, system.B[:, None]], [system.C[None, :], np.array([[system.D]])]])
    zeros = eig(pencil, np.diag([1.0] * n + [0.0]), right=False)
    zeros = zeros[np.isfinite(zeros)]
    # wide: a doubtful zero costs some evaluations, a lost one a wrong margin
    return np.asarray(zeros[(np.abs(zeros.real) <= 1e-3 * np.abs(zeros)) & (zeros.imag > 0)].imag)
