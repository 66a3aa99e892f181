"""Gaussian numbers from counters: the same whatever the order in which they are drawn."""

from __future__ import annotations

import numpy as np

from barbalat.lowering.llvm.elementwise import evaluate
from barbalat.validate import Array

NUMBERS_PER_BLOCK = 4
"""Numbers that one count of a Philox counter makes."""


def standard_normal(seed: int, member: int, first: int, rows: int, channels: int) -> Array:
    """Rows first ... first + rows - 1 of a member's standard Gaussian numbers, (rows, channels).

    They are those of the operation list that pages have too: no library's logarithm is in them, and their bits are the same on
    every computer.
    """
    counts = -(-channels // NUMBERS_PER_BLOCK)  # every row starts on a count of its own
    generator = np.random.Philox(key=np.array([seed, member], dtype=np.uint64))
    generator.advance(first * counts)
    raw = generator.random_raw(rows * counts * NUMBERS_PER_BLOCK).reshape(rows, counts * NUMBERS_PER_BLOCK)[:, :channels]
    uniform = ((raw >> np.uint64(11)) + 0.5) * 2.0**-53
    return evaluate("ndtri", uniform)
