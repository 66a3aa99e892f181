"""L1 norms in floating point, accurate to a few percent. They determine which norms are worth enclosing and are never
reported."""

from __future__ import annotations

import numpy as np

from barbalat.validate import Array

POINTS, MOST_BLOCKS = 128, 40
"""Instants of a block, a power of two, and the largest number of blocks; the steps of each block are twice as long as those of
the previous block."""
FIRST_STEP, LAST_TIME = 0.05, 6.0
"""The first step, in units of the inverse of the largest eigenvalue magnitude, and the earliest end, in units of the slowest time
constant."""
NEGLIGIBLE = 1e-4
"""The first block that contributes less than this fraction of each sum is the last one."""


def estimated_rows(A: Array, B: Array, C: Array) -> Array | None:
    """(p,) the integral of |C e^(A t) B| for each output, with B (n, 1); None if A has an eigenvalue that does not decay."""
    from scipy.linalg import expm

    poles = np.linalg.eigvals(A)
    slowest = -float(poles.real.max())
    if not slowest > 0:
        return None
    step, x, t = FIRST_STEP / float(np.abs(poles).max()), B[:, 0], 0.0
    powers = [expm(A * step)]
    total = np.zeros(len(C))
    for block in range(MOST_BLOCKS):
        count = int(np.log2(POINTS))
        while len(powers) <= block + count:
            powers.append(powers[-1] @ powers[-1])
        states = x[:, None]
        for k in range(count):
            states = np.hstack([states, powers[block + k] @ states])
        ahead = powers[block + count] @ x
        seen = np.abs(C @ np.column_stack([states, ahead]))
        part = step * (seen.sum(axis=1) - (seen[:, 0] + seen[:, -1]) / 2)
        total, x, t, step = total + part, ahead, t + POINTS * step, 2 * step
        if t * slowest > LAST_TIME and (part <= NEGLIGIBLE * total).all():
            break
    return total
