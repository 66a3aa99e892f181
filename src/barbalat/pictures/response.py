"""A loop's response over frequency as data. ``frequency`` draws it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.validate import Array

NYQUIST_WINDOW = (-3.2, 1.6, -2.4, 2.4)
"""The displayed region around -1, the critical point. Loops with an integrator leave it towards infinity."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Response:
    """L(j w) of a loop, including a delay.

    w, L         (K,) rad/s, and complex
    caption      the loop's name and its margins
    at_phase     frequency of the phase margin in rad/s; ``None`` without a crossover
    at_gain      frequency of the gain margin in rad/s; ``None`` without a gain margin
    """

    w: Array
    L: Array
    caption: str
    at_phase: float | None
    at_gain: float | None

    def value(self, w: float) -> complex:
        """Return L at the frequency of the grid nearest to w."""
        return complex(self.L[int(np.abs(self.w - w).argmin())])

    @property
    def phase(self) -> Array:
        """The phase [degrees], which is continuous, and in (-360, 0] at the frequency of the phase margin."""
        phase = np.degrees(np.unwrap(np.angle(self.L)))
        at = int(np.abs(self.w - self.at_phase).argmin()) if self.at_phase is not None else 0
        return np.asarray(phase - 360 * np.ceil(phase[at] / 360))
