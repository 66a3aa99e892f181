"""Units as FMI states them: exponents of the base units of the SI and of rad, and a factor."""

from __future__ import annotations

import math
import re

BASES = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
NAMED: dict[str, tuple[float, dict[str, int]]] = {name: (1.0, {name: 1}) for name in BASES} | {
    "deg": (math.pi / 180, {"rad": 1}),
    "°": (math.pi / 180, {"rad": 1}),
    "rpm": (2 * math.pi / 60, {"rad": 1, "s": -1}),
    "%": (0.01, {}),
    "1": (1.0, {}),
    "mm": (1e-3, {"m": 1}),
    "cm": (1e-2, {"m": 1}),
    "km": (1e3, {"m": 1}),
    "ft": (0.3048, {"m": 1}),
    "ms": (1e-3, {"s": 1}),
    "Hz": (1.0, {"s": -1}),
    "N": (1.0, {"kg": 1, "m": 1, "s": -2}),
    "Nm": (1.0, {"kg": 1, "m": 2, "s": -2}),
    "J": (1.0, {"kg": 1, "m": 2, "s": -2}),
    "W": (1.0, {"kg": 1, "m": 2, "s": -3}),
    "Pa": (1.0, {"kg": 1, "m": -1, "s": -2}),
    "V": (1.0, {"kg": 1, "m": 2, "s": -3, "A": -1}),
}
"""The factors of which the units of cases consist. Other units are not declared, and neither is g, which may mean gram or
gravity."""
PART = re.compile(r"(/?)\s*([A-Za-z%°]+|1)(?:\^?(-?\d+)|([²³]))?\s*[·*]?\s*")


def base_unit(unit: str) -> dict[str, str] | None:
    """Attributes of FMI's BaseUnit for "rad/s", "m/s^2", "N m" or "deg"; None for an unknown unit."""
    factor, exponents, at = 1.0, dict.fromkeys(BASES, 0), 0
    while at < len(unit):
        found = PART.match(unit, at)
        if found is None or found[2] not in NAMED:
            return None
        power = int(found[3] or {"²": 2, "³": 3}.get(found[4], 1)) * (-1 if found[1] else 1)
        scale, of = NAMED[found[2]]
        factor *= scale**power
        for name, exponent in of.items():
            exponents[name] += power * exponent
        at = found.end()
    known = {name: str(exponent) for name, exponent in exponents.items() if exponent}
    return known | ({} if factor == 1 else {"factor": repr(factor)})
