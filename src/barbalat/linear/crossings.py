"""All frequencies at which a linear loop's response crosses the unit circle or the real axis; crossings between grid points are
not missed.

Source: the crossings are zeros of 1 - L(-s)L(s) and of L(s) - L(-s) on the imaginary axis, as in Boyd, Balakrishnan, Kabamba
(1989).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from barbalat.linear.brent import zero_between
from barbalat.linear.systems import StateSpace
from barbalat.validate import Array


class Crossings:
    """The crossings of one loop, with cached frequency responses."""

    def __init__(self, loop: StateSpace) -> None:
        self.loop = loop
        grid = frequency_grid(loop)
        below = _below(loop, float(grid.min()))
        self._grid = np.concatenate([below, grid])
        self._response = np.concatenate([loop.response(below), loop.response(grid)])

    def of_unit_circle(self, factor: float = 1.0) -> list[float]:
        """The w > 0 with factor |L(j w)| = 1."""
        scaled = StateSpace(self.loop.A, self.loop.B * factor, self.loop.C, self.loop.D * factor)
        return self._zeros(lambda L: factor * np.abs(L) - 1, one_minus_magnitude(scaled))

    def of_real_axis(self) -> list[float]:
        """The w > 0 with L(j w) real."""
        return self._zeros(np.imag, _imaginary_part(self.loop))

    def _zeros(self, function: Callable[[Array], Array], system: StateSpace) -> list[float]:
        """All w > 0 with function(L(j w)) = 0, from the zeros of ``system`` on the axis and from sign changes on a grid around
        the poles.

        The zeros cover the frequencies between grid points; the grid covers rounding errors of zeros near lightly damped poles.
        Both kinds are bracketed and refined on the function itself, so no spurious crossing is returned.
        """
        beside = np.concatenate([np.zeros(0), *(w * (1 + _SPREAD) for w in axis_zeros(system))])
        points, order = np.unique(np.concatenate([self._grid, beside]), return_index=True)
        values = function(np.concatenate([self._response, self.loop.response(beside)])[order])
        found = [float(w) for w in points[values == 0]]
        # the ends of a bracket are requested repeatedly
        at = cache(lambda w: float(function(self.loop.response(np.array([w])))[0]))
        for k in np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0):
            left, right = float(points[k]), float(points[k + 1])
            if at(left) * at(right) < 0:
                found.append(zero_between(at, left, right, absolute=1e-300, relative=1e-13))
            else:  # single values differ from those on the grid in the last bits, which determine the sign near a zero
                found.append(min(left, right, key=lambda w: abs(at(w))))
        return sorted(found)


_SPREAD = np.concatenate([-np.logspace(-2, -12, 21), np.logspace(-12, -2, 21)])
"""Relative distances around a computed zero; they bracket the true zero whatever the rounding error."""


_ROUNDING = 1e-15
"""Relative distance within which a pole counts as being on the axis, and a frequency as being at the pole."""


_AROUND_A_PEAK = np.concatenate([-np.geomspace(1e-3, 1e3, 60)[::-1], [0.0], np.geomspace(1e-3, 1e3, 60)])
"""Distances from a pole's frequency, in units of its damping."""


_LARGE_RESPONSE = 1e3
"""Growth ratio that shows that L is c/s or c/s^2 towards lower frequencies."""
_LEAST_SHARE = 1e-15
"""Fraction of the lowest frequency below which rounding errors of an integrator exceed the responses of the other poles."""


def frequency_grid(loop: StateSpace) -> Array:
    """Frequencies from far below to far above the poles, dense near the narrow peaks of lightly damped poles."""
    poles = np.linalg.eigvals(loop.A)
    sizes = np.abs(poles)
    sizes = sizes[sizes > _ROUNDING * np.linalg.norm(loop.A)]  # an integrator's pole is zero up to rounding
    low, high = (sizes.min(), sizes.max()) if len(sizes) else (1.0, 1.0)
    gain = max(1.0, float(np.linalg.norm(loop.C) * np.linalg.norm(loop.B)) / low)
    wide = np.geomspace(low * 1e-4, high * 10 * gain, 500)
    peaks = [p.imag + max(abs(p.real), 1e-12 * abs(p.imag)) * _AROUND_A_PEAK for p in poles if p.imag > 0]
    grid = np.concatenate([wide, *peaks])
    on_axis = np.array([p.imag for p in poles if p.imag > 0 and abs(p.real) <= _ROUNDING * p.imag])
    at_pole = (np.abs(grid[:, None] - on_axis) <= _ROUNDING * on_axis).any(
        axis=1
    )  # excludes a frequency at which the response is infinite
    return np.asarray(grid[(grid > 0) & ~at_pole])


def _below(loop: StateSpace, lowest: float) -> Array:
    """Frequencies below ``lowest``, down to where an integrator has made the response large; none if the response is already
    large.

    The response of a slow integrator with fast poles crosses the unit circle far below all these poles.
    """
    sizes = np.abs(np.linalg.eigvals(loop.A))
    if not (sizes <= _ROUNDING * np.linalg.norm(loop.A)).any():
        return np.zeros(0)
    at_lowest = float(np.abs(loop.response(np.array([lowest])))[0])
    if at_lowest >= _LARGE_RESPONSE:
        return np.zeros(0)
    share = max(at_lowest / _LARGE_RESPONSE, _LEAST_SHARE)
    return np.geomspace(lowest * share, lowest, 20 * int(np.ceil(-np.log10(share))), endpoint=False)


def one_minus_magnitude(loop: StateSpace) -> StateSpace:
    """1 - L(-s)L(s), where L(-s) is (-A', -C', B', D), in series after L. On the imaginary axis it is 1 - |L|^2."""
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


def zeros(system: StateSpace) -> Array:
    """The finite zeros of the system, as generalised eigenvalues of its pencil; rounding may add very large ones."""
    from scipy.linalg import eig

    n = system.order
    if n == 0:
        return np.zeros(0, dtype=complex)
    pencil = np.block([[system.A, system.B[:, None]], [system.C[None, :], np.array([[system.D]])]])
    found = eig(pencil, np.diag([1.0] * n + [0.0]), right=False)
    return np.asarray(found[np.isfinite(found)])


def axis_zeros(system: StateSpace) -> Array:
    """The positive w near which the system vanishes at s = j w."""
    found = zeros(system)
    # a wide band, because a spurious zero costs only a few evaluations, but a missed zero gives a wrong margin
    return np.asarray(found[(np.abs(found.real) <= 1e-3 * np.abs(found)) & (found.imag > 0)].imag)
