"""Records as a picture can show them: a line where a signal is resolved, an envelope where it oscillates faster than that."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from barbalat.validate import Array

COLUMNS = 400
"""Of a panel, which is some 600 dots wide: more points are hardly seen, only stored."""
AROUND = 9
"""Columns, an odd number: of a period that is half as long a line has four points and less, and shows no oscillation any more."""
SEEN, FLAT = 0.1, 0.05
"""An oscillation over less than this part of the signal's range is drawn as a line through it; a range counts as this part of
the largest value at least."""


class Drawn(NamedTuple):
    """t (K,) instants, value (K,) at them, low and high (K,): the extrema from each instant to the next.

    Where the signal oscillates too fast for a line ``value`` is NaN, and the extrema are those of the neighbourhood.
    """

    t: Array
    value: Array
    low: Array
    high: Array


def drawn(t: Array, value: Array, low: Array, high: Array) -> Drawn:
    """At most about ``COLUMNS`` of the instants t (K,); low and high (K - 1,) are the extrema between those: none is left out."""
    if len(t) < 2:
        return Drawn(t, value, value, value)
    starts = _starts(t)
    kept = np.append(starts, len(t) - 1)
    least = np.minimum.reduceat(np.minimum(low, np.minimum(value[:-1], value[1:])), starts)
    most = np.maximum.reduceat(np.maximum(high, np.maximum(value[:-1], value[1:])), starts)
    least, most = np.append(least, least[-1]), np.append(most, most[-1])
    around_low, around_high = _around(least, np.minimum), _around(most, np.maximum)
    span = max(most.max() - least.min(), FLAT * max(abs(most.max()), abs(least.min())))
    fast = _turns(value[kept], most - least) & (around_high - around_low > SEEN * span)
    return Drawn(
        t[kept],
        np.where(fast, np.nan, value[kept]),
        np.where(fast, around_low, least),
        np.where(fast, around_high, most),
    )


def largest(t: Array, values: Array) -> tuple[Array, Array]:
    """The same for what is at most so large from each instant to the next, values (K - 1,): the largest in each column."""
    if len(t) < 2:
        return t[:-1], values
    starts = _starts(t)
    return t[starts], np.maximum.reduceat(values, starts)


def _starts(t: Array) -> Array:
    """Where the columns begin."""
    return np.arange(0, len(t) - 1, max(-(-(len(t) - 1) // COLUMNS), 1))


def _turns(value: Array, width: Array) -> Array:
    """Whether, of the columns around, more than a third are turns of the line or hold far more than it shows."""
    steps = np.diff(value, append=value[-1:])
    turning = np.append(False, steps[1:] * steps[:-1] < 0)
    hidden = width > 2 * np.maximum(np.abs(steps), np.abs(np.append(0.0, steps[:-1])))
    return _around((turning | hidden).astype(float), np.add) > AROUND / 3


def _around(values: Array, combine: np.ufunc) -> Array:
    """Over the columns around each one; at the ends the outermost value goes on."""
    wide = np.pad(values, AROUND // 2, mode="edge")
    return combine.reduce(sliding_window_view(wide, AROUND), axis=1)
