"""Peak gains over all frequencies: H-infinity norms of SISO systems, Ms and Mt of a loop.

Source: Boyd, Balakrishnan, Kabamba (1989) and Bruinsma, Steinbuch (1990): a level is above the peak if no zero of level^2 -
G(-s)G(s) is on the imaginary axis, so peaks between grid points are not missed.

For a loop with a delay, the peaks of |S| and |T| are found by branch and bound over frequency, which does not miss peaks either.

|S| = 1/|1 + X| with X = L e^(-j w d), and |T| = 1/|1 + X| with X = 1/(L e^(-j w d)). With the zeros and poles r_i of X, the
middle w_m of an interval and half its width delta,
    |X(w)/X(w_m) - 1| <= q = (1 + delta d) prod (1 + delta/|j w_i - r_i|) - 1.
For a zero w_i = w_m; for a pole w_i is the w of the interval nearest to it. So |1 + X| >= |1 + X(w_m)| - q |X(w_m)| over the
interval.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from barbalat.linear.crossings import Crossings, axis_zeros, frequency_grid, one_minus_magnitude
from barbalat.linear.rotation import HALVING_STEPS, Rotation
from barbalat.linear.systems import StateSpace
from barbalat.validate import Array, InputError

PEAK_PRECISION = 1e-6
"""Relative precision; the true peak is at most this much below the returned level."""


class Peak(NamedTuple):
    """The largest gain, and its frequency [rad/s]; infinite if it is approached at infinite frequency."""

    gain: float
    frequency: float


def peak_gain(system: StateSpace) -> Peak:
    """sup over w of |G(j w)| of a stable system, to ``PEAK_PRECISION``; raises InputError for an unstable one."""
    poles = np.linalg.eigvals(system.A) if system.order else np.array([-1.0])
    if poles.real.max() >= 0:
        raise InputError(f"a peak gain needs a stable system, but a pole has real part {poles.real.max():.6g}")
    gain, at = abs(system.D), np.inf
    points = np.append(0.0, frequency_grid(system))
    while True:
        values = np.abs(system.response(points))
        if values.max() > gain:
            gain, at = float(values.max()), float(points[values.argmax()])
        if gain == 0:
            return Peak(0.0, at)
        level = gain * (1 + PEAK_PRECISION)
        scaled = StateSpace(system.A, system.B / level, system.C, system.D / level)
        crossed = axis_zeros(one_minus_magnitude(scaled))
        points = np.concatenate([crossed, np.sqrt(crossed[:-1] * crossed[1:])])
        if not len(points) or np.abs(system.response(points)).max() <= level:
            return Peak(level, at)


class Peaks(NamedTuple):
    """Upper bounds on the peaks, which are at most ``PEAK_PRECISION`` lower."""

    sensitivity: float
    complementary: float


def delayed_peaks(loop: StateSpace, delay: float) -> Peaks:
    """sup |1/(1 + L e^(-j w d))| and sup |L/(1 + L e^(-j w d))| of a loop that is stable with the delay d > 0 [s].

    Raises InputError for a loop that is not strictly proper: its peaks recur up to infinite frequency.
    """
    if loop.D != 0:
        raise InputError(f"peaks with a delay need a strictly proper loop, but L(infinity) = {loop.D:.6g}")
    crossings, rotation = Crossings(loop), Rotation(loop, delay)
    low = rotation.low
    w = np.concatenate([np.geomspace(low, 10 / delay, 400), crossings.of_unit_circle()])
    L = rotation.value(w)
    S, T = max(1.0, float((1 / np.abs(1 + L)).max())), float(np.abs(L / (1 + L)).max())
    if T == 0:
        return Peaks(1.0, 0.0)
    # above the last w with |L| at such a level, |S| <= 1/(1 - |L|) and |T| <= |L|/(1 - |L|) are below the values found so far
    levels = 1 - 1 / (S * (1 + PEAK_PRECISION)), T / (1 + T)
    ends = [max([*crossings.of_unit_circle(1 / level), low]) for level in levels]
    S = _search(rotation, low, ends[0], S, inverse=False)
    T = _search(rotation, low, ends[1], T, inverse=True)
    return Peaks(S * (1 + PEAK_PRECISION), T * (1 + PEAK_PRECISION))


def _search(rotation: Rotation, low: float, high: float, peak: float, *, inverse: bool) -> float:
    """The largest 1/|1 + X| over [low, high], within ``PEAK_PRECISION``; at least ``peak``."""
    edges = np.geomspace(low, high, 400)
    left, right = edges[:-1], edges[1:]
    for _ in range(HALVING_STEPS):
        if not len(left):
            break
        middle = (left + right) / 2
        X = rotation.value(middle)
        if inverse:
            X = 1 / X
        distance = np.abs(1 + X)
        peak = max(peak, float((1 / distance).max()))
        nearest = distance - np.abs(X) * _change(rotation, left, right, inverse)
        kept = nearest < 1 / (peak * (1 + PEAK_PRECISION))
        left, right = np.concatenate([left[kept], middle[kept]]), np.concatenate([middle[kept], right[kept]])
    return peak


def _change(rotation: Rotation, left: Array, right: Array, inverse: bool) -> Array:
    """q for each interval."""
    zeros, poles = (rotation.poles, rotation.zeros) if inverse else (rotation.zeros, rotation.poles)
    middle, half = (left + right) / 2, (right - left) / 2
    q = 1 + half * rotation.delay
    for zero in zeros:
        q = q * (1 + half / np.abs(1j * middle - zero))
    for pole in poles:
        nearest = np.abs(1j * np.clip(pole.imag, left, right) - pole)
        q = q * (1 + half / np.maximum(nearest, 1e-300))
    return np.asarray(q - 1)
