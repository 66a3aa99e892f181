"""The largest tolerated value: bisection in ratio, for single searches and for many in parallel.

The searches work for any quantity. A search finds *a* boundary between tolerated and untolerated values; if there are
several, the caller's steps determine which one.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from itertools import count

SMALLEST_FLOAT = sys.float_info.min
"""The smallest float with full precision; a downward search that reaches it has found no tolerated value."""

NEIGHBOUR_GAP = 4 * sys.float_info.epsilon
"""Relative distance at which a search for neighbouring floats ends; the geometric mean of closer floats may not lie between
them."""


SECANTS = 5
"""Every SECANTS-th step of a search by secants is a bisection, which bounds the search if the size jumps."""


def largest(tolerates: Callable[[float], bool], low: float, high: float, *, within: float = NEIGHBOUR_GAP) -> float:
    """Return a tolerated value between ``low``, which is tolerated or 0, and ``high``, which is not tolerated. The value larger
    by the fraction ``within`` is not tolerated.

    ``within`` is relative. The result is 0 if no positive value was found to be tolerated.
    """
    while high - low > within * high:
        middle = geometric_mean(low, high) if low > 0 else high / 16
        if not low < middle < high:  # already neighbours, or below the smallest float
            break
        low, high = (middle, high) if tolerates(middle) else (low, middle)
    return low


def largest_from(
    tolerates: Callable[[float], bool],
    start: float,
    *,
    factor: float = 2.0,
    within: float = NEIGHBOUR_GAP,
    least: float = SMALLEST_FLOAT,
) -> float:
    """Search without known ends: by steps of ``factor`` from ``start`` down to a tolerated value, then up to an untolerated
    value.

    The result is 0 if nothing is tolerated down to ``least``, and infinite if every float is tolerated.
    """
    low, high = _ends(tolerates, start, factor, least)
    return low if low == 0 or math.isinf(high) else largest(tolerates, low, high, within=within)


def largest_of_size(size: Callable[[float], float], start: float, *, within: float) -> float:
    """The search of ``largest_from`` for values that are tolerated if their ``size``, a smooth function of them, is below 1.

    It uses secants of the logarithms (the Illinois algorithm), which need about eight sizes, compared with 25 for bisection.

    Source: Dowell and Jarratt, A modified regula falsi method for computing the root of an equation, BIT 11 (1971).
    """
    logarithms: dict[float, float] = {}

    def tolerates(value: float) -> bool:
        logarithms[value] = math.log(max(size(value), SMALLEST_FLOAT))
        return logarithms[value] < 0

    low, high = _ends(tolerates, start, 2.0, SMALLEST_FLOAT)
    if low == 0 or math.isinf(high):
        return low
    below, above, raised = logarithms[low], logarithms[high], None
    for step in count(1):
        if high - low <= within * high:
            break
        middle = low * (high / low) ** (below / (below - above))
        # passes the root by a third of the requested width, towards the farther end, so that both ends approach the root
        middle *= 1 - within / 3 if middle > geometric_mean(low, high) else 1 + within / 3
        if step % SECANTS == 0 or not low < middle < high:
            middle = geometric_mean(low, high)
        if tolerates(middle):
            low, below, above, raised = middle, logarithms[middle], above / 2 if raised is True else above, True
        else:
            high, above, below, raised = middle, logarithms[middle], below / 2 if raised is False else below, False
    return low


def _ends(tolerates: Callable[[float], bool], start: float, factor: float, least: float) -> tuple[float, float]:
    """A tolerated value, and a value larger by ``factor`` that is not tolerated; the first is 0 if no value is tolerated,
    infinite if all are."""
    low = start
    while not tolerates(low):
        if low <= least:
            return 0.0, low
        low /= factor
    high = low * factor
    while tolerates(high):
        low, high = high, high * factor
        if math.isinf(high):
            return high, high
    return low, high


def largest_whole(tolerates: Callable[[int], bool], *, stride: int, most: int) -> int:
    """A tolerated whole number up to ``most`` such that the next one is not, by strides from 0, which is assumed to be
    tolerated, and then by bisection.

    The result is ``most`` if all tried numbers are tolerated.
    """
    high = next((trial for trial in range(stride, most + 1, stride) if not tolerates(trial)), None)
    if high is None:
        return most
    low = high - stride
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if tolerates(middle) else (low, middle)
    return low


def geometric_mean(low: float, high: float) -> float:
    """The geometric mean, even if the product of the two exceeds the floats' range."""
    product = low * high
    return math.sqrt(product) if SMALLEST_FLOAT < product < math.inf else math.sqrt(low) * math.sqrt(high)


def halvings(ratio: float, within: float) -> int:
    """Number of bisections in ratio until a bracket whose ends have this ratio is at most ``within`` wide, relative to its
    lower end."""
    return max(0, math.ceil(math.log2(math.log(ratio) / math.log1p(within)))) if ratio > 1 else 0
