"""Gaussian numbers from counters: the same whatever the order in which they are drawn."""

from __future__ import annotations

from collections.abc import Sequence

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
    return _drawn(seed, member, [(first, rows)], channels)


def standard_normal_at(seed: int, member: int, rows: Array, channels: int) -> Array:
    """The same numbers of these rows, in any order, (K, channels)."""
    needed, place = np.unique(rows, return_inverse=True)
    return _drawn(seed, member, [(int(row), 1) for row in needed], channels)[place]


def _drawn(seed: int, member: int, parts: Sequence[tuple[int, int]], channels: int) -> Array:
    """The parts (first row, rows), in rising order, one after another."""
    counts = -(-channels // NUMBERS_PER_BLOCK)  # every row starts on a count of its own
    generator = np.random.Philox(key=np.array([seed, member], dtype=np.uint64))
    raw, passed = [], 0
    for first, rows in parts:
        generator.advance((first - passed) * counts)
        raw.append(generator.random_raw(rows * counts * NUMBERS_PER_BLOCK).reshape(rows, -1)[:, :channels])
        passed = first + rows
    uniform = ((np.concatenate(raw) >> np.uint64(11)) + 0.5) * 2.0**-53
    return evaluate("ndtri", uniform)
