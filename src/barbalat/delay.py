"""The exact input delay on a fixed grid: which remembered values a step needs, and how it interpolates between them.

Between steps the cubic through four neighbours is used, whose error is of fourth order in the step, as RK4's is. A jump of
the input, at t = 0 from the zero past or with the command, costs once an error of the order of the step.
"""

from __future__ import annotations

import numpy as np

from barbalat.lowering.shape import TAPS
from barbalat.validate import Array, InputError

LONGEST = 10_000_000
"""Steps that a member may remember: 80 MB each."""


def lag(delay: float, dt: float) -> int:
    """Steps back to the newest remembered value that a step needs; InputError for a delay below two steps."""
    if delay / dt > LONGEST:
        raise InputError(f"plant.input.delay must be at most {LONGEST:g} solver steps, got {delay:g} s at dt = {dt:g} s")
    whole = whole_steps(delay, dt)
    if whole < 2:
        raise InputError(f"plant.input.delay must be 0 or at least two solver steps, got {delay:g} s at dt = {dt:g} s")
    return whole - 1


def whole_steps(delay: float, dt: float) -> int:
    """floor(delay/dt); a delay within rounding of a whole number of steps counts as that number."""
    steps = delay / dt
    nearest = round(steps)
    return nearest if abs(steps - nearest) <= 1e-9 * max(1.0, steps) else int(np.floor(steps))


def weights(delay: float, dt: float, nodes: tuple[float, ...]) -> Array:
    """(nodes, TAPS): what to multiply the remembered values with, the newest first, to get the input at each stage.

    Seen from step k, the values stand at -d + 1, -d, -d - 1, -d - 2 with d = floor(delay/dt); a stage at node c asks for
    c - delay/dt, which lies between the first and the third of them.
    """
    whole = whole_steps(delay, dt)
    fraction = max(delay / dt - whole, 0.0)
    if fraction * dt <= 1e-9 * delay:
        fraction = 0.0
    places = 1.0 - np.arange(TAPS)
    result = np.empty((len(nodes), TAPS))
    for row, node in enumerate(nodes):
        for j in range(TAPS):
            others = np.delete(places, j)
            result[row, j] = np.prod((node - fraction - others) / (places[j] - others))
    return result
