"""Exact gain, phase and delay margins of a linear loop, broken at the plant input, with or without a delay in the loop.

Source: Skogestad and Postlethwaite, Multivariable Feedback Control, section 2.4.3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.linear.crossings import Crossings
from barbalat.linear.rotation import phase_crossings
from barbalat.linear.systems import StateSpace, sensitivity
from barbalat.validate import Array, InputError

LARGEST_FACTOR = 1e6
"""Largest change of the gain, up or down: a loop that is practically open, or that tolerates this change, has no margin. A
crossing beyond it depends on the last bits of a cancellation in L or on a theta that is practically zero, and actuator gains do
not vary so much."""


@dataclass(frozen=True)
class Margins:
    """The margins of the loop L e^(-s d) closed by u = -L v; infinite where no change of that kind destabilises it.

    gain_up, gain_down  factors > 1 and < 1 at which the loop loses stability; infinite if there is none up to ``LARGEST_FACTOR``,
                        0 if there is none down to its inverse
    phase               the smallest phase lag or lead [rad] at which the loop loses stability, over all crossovers
    delay               the smallest additional delay [s] at which the loop loses stability, over all crossovers
    crossovers          (K,) frequencies [rad/s] with |L| = 1
    """

    gain_up: float
    gain_down: float
    phase: float
    delay: float
    crossovers: tuple[float, ...]


def margins(loop: Any, delay: float = 0.0) -> Margins:
    """Margins of a loop that is stable with the ``delay`` d [s] in it.

    loop   L(s): a StateSpace, a TransferFunction or a SISO python-control system

    Raises InputError if the loop is not stable; the message gives the largest real part of the closed loop, or the delay that it
    tolerates. A loop with |L(infinity)| >= 1 tolerates no delay.
    """
    loop, delay = StateSpace.accept("loop", loop), validate.not_negative("delay", delay)
    closed = sensitivity(loop).A
    largest = float(np.linalg.eigvals(closed).real.max()) if loop.order else -np.inf
    if largest >= 0:
        raise InputError(f"margins need a stable closed loop, but its largest eigenvalue has real part {largest:.6g}")
    crossings = Crossings(loop)
    crossovers = np.array(crossings.of_unit_circle())
    # in (0, 2 pi]: these lags rotate the values to the negative real axis
    lags = np.angle(-loop.response(crossovers)) % (2 * np.pi)
    lags = np.where(lags > 0, lags, 2 * np.pi)
    longest = float((lags / crossovers).min(initial=np.inf))
    if abs(loop.D) >= 1:  # |L| >= 1 up to infinite frequency: an arbitrarily small delay meets -1
        longest = 0.0
    if delay > 0 and longest <= delay:
        raise InputError(f"unstable: the loop tolerates a delay of {longest:.4g} s, but has a delay of {delay:.4g} s")
    lags = lags - delay * crossovers
    phase = float(np.minimum(lags, 2 * np.pi - lags).min(initial=np.inf))
    at = phase_crossings(crossings, delay, crossovers) if delay > 0 else np.array(crossings.of_real_axis())
    up, down = _gain_factors(loop, delay, at)
    return Margins(up, down, phase, longest - delay, tuple(crossovers.tolist()))


def _gain_factors(loop: StateSpace, delay: float, at: Array) -> tuple[float, float]:
    """The factors closest to 1, up to ``LARGEST_FACTOR``, that bring L e^(-s d) to -1 at some w of ``at``, at 0 or at
    infinity."""
    values = (loop.response(at) * np.exp(-1j * at * delay)).real.tolist()
    if loop.order == 0 or np.linalg.cond(loop.A) < 1 / np.finfo(float).eps:
        values.append(float(loop.response(np.zeros(1))[0].real))
    values.append(-abs(loop.D) if delay > 0 else loop.D)  # with a delay, L(infinity) rotates through all phases
    factors = [-1 / value for value in values if 1 / LARGEST_FACTOR <= -value <= LARGEST_FACTOR]
    up = min((k for k in factors if k > 1), default=np.inf)
    down = max((k for k in factors if k < 1), default=0.0)
    return float(up), float(down)
