"""The largest value that something bears: bisection in ratio, for searches of one value and of many side by side.

Nothing here knows what is borne. A search finds *a* boundary between what is borne and what is not; where there are several,
it is the caller's steps that decide which.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable

SMALLEST_FLOAT = sys.float_info.min
"""The smallest float with all its digits: a search downward that has come this far has found nothing that is borne."""

NEIGHBOUR_GAP = 4 * sys.float_info.epsilon
"""Relative distance at which a search for neighbouring floats ends; between closer ones a geometric mean may not fall."""


def largest(bears: Callable[[float], bool], low: float, high: float, *, within: float = NEIGHBOUR_GAP) -> float:
    """Between ``low``, which is borne or 0, and ``high``, which is not: a value that is borne, one ``within`` above it is not.

    ``within`` is relative. 0 where nothing above 0 was found to be borne.
    """
    while high - low > within * high:
        middle = geometric_mean(low, high) if low > 0 else high / 16
        if not low < middle < high:  # neighbours already, or below the smallest float
            break
        low, high = (middle, high) if bears(middle) else (low, middle)
    return low


def largest_from(
    bears: Callable[[float], bool],
    start: float,
    *,
    factor: float = 2.0,
    within: float = NEIGHBOUR_GAP,
    least: float = SMALLEST_FLOAT,
) -> float:
    """Search without known ends: by steps of ``factor`` from ``start`` down to what is tolerated, then up to what is not.

    0 where nothing is borne down to ``least``; infinite where every float is.
    """
    low = start
    while not bears(low):
        if low <= least:
            return 0.0
        low /= factor
    high = low * factor
    while bears(high):
        low, high = high, high * factor
        if math.isinf(high):
            return high
    return largest(bears, low, high, within=within)


def largest_whole(bears: Callable[[int], bool], *, stride: int, most: int) -> int:
    """A number up to ``most`` that is borne, the one above it is not: by strides from 0, which is taken as borne, then by halves.

    ``most`` where all that were tried are borne.
    """
    high = next((trial for trial in range(stride, most + 1, stride) if not bears(trial)), None)
    if high is None:
        return most
    low = high - stride
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if bears(middle) else (low, middle)
    return low


def geometric_mean(low: float, high: float) -> float:
    """The geometric mean, also where the product of the two is beyond the floats' range."""
    product = low * high
    return math.sqrt(product) if SMALLEST_FLOAT < product < math.inf else math.sqrt(low) * math.sqrt(high)


def halvings(ratio: float, within: float) -> int:
    """Bisections in ratio until a bracket whose ends have this ratio is at most ``within`` wide, relative to its lower end."""
    return max(0, math.ceil(math.log2(math.log(ratio) / math.log1p(within)))) if ratio > 1 else 0
