"""Peak gains over all frequencies: H-infinity norms of SISO systems, Ms and Mt of a loop.

Source: Boyd, Balakrishnan, Kabamba (1989) and Bruinsma, Steinbuch (1990): a level is above the peak where no zero of
level^2 - G(-s)G(s) lies on the imaginary axis; so no peak between the points of a grid is missed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from barbalat.linear.crossings import axis_zeros, frequency_grid, one_minus_magnitude
from barbalat.linear.systems import StateSpace
from barbalat.validate import InputError

PEAK_PRECISION = 1e-6
"""Relative: how far the peak may lie below the level that is returned."""


class Peak(NamedTuple):
    """The largest gain, and where it was found [rad/s]; infinite frequency where it is approached there."""

    gain: float
    frequency: float


def peak_gain(system: StateSpace) -> Peak:
    """sup over w of |G(j w)| of a stable system, to ``PEAK_PRECISION``; InputError for an unstable one."""
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
