"""At which values a number is tried together with others, turn by turn."""

from __future__ import annotations

import numpy as np

from barbalat.open_numbers.numbers import Number

Place = tuple[float, int]
"""A value of a slider, and where it stands among those that are tabulated, if it does."""
NEAR_SHARES = (0.04, 0.12)
"""Of a slider's length: how far off to either side it is tried together with others; each slider somewhere between, lest two that
stand in a difference move by as much. So near the case all pairs should make one."""
FAR_SHARES = ((0.1, 0.4), (0.1, 0.4), (0.4, 1.0), (0.4, 1.0))
"""How far off to one side, another one each time: some pairs make other numbers in a last bit, and at some values only."""
GOLDEN_RATIO = 0.6180339887498949
"""Its multiples' fractions are spread evenly, however many there are."""
TRIED_TURNS = 1 + len(FAR_SHARES)


def places_tried(number: Number, k: int, turn: int, *, copied: bool, handed: bool) -> list[Place]:
    """Of the k-th slider: near the case one value to either side of its own, farther off one, unlike the known ones if it may be.

    What modules are not ``handed`` is in the signals alone: of such numbers many may exclude each other, and each is tried once.

    copied  whether any value can be taken, not only those that are tabulated
    """
    low, high = (NEAR_SHARES, *FAR_SHARES)[turn]
    last = len(number.values) - 1
    own = int(np.searchsorted(number.values, number.value))
    step = max(1, round(last * (low + (high - low) * ((k + 1 + turn) * GOLDEN_RATIO % 1))))
    ways = [way for way in (-1, 1) if 0 <= own + way <= last]
    if turn > 0 or not handed:
        ways = [ways[(k + turn) % len(ways)]] if turn == 0 or handed else []
    values = [number.values[int(np.clip(own + way * step, 0, last))] for way in ways]
    if turn > 0 and copied and not number.whole:
        values = [number.value + GOLDEN_RATIO * (value - number.value) for value in values]
    return [(float(value), int(np.searchsorted(number.values, value))) for value in values]
