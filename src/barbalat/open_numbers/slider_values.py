"""The numbers of a case that get a slider: where they stand, which values they may have, how they are called."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from barbalat.cases.build import Case
from barbalat.open_numbers.path import FieldPath, Key
from barbalat.validate import Array, InputError

MANTISSAS = (
    1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.8, 2.0, 2.2, 2.5, 2.7, 3.0, 3.3, 3.6, 4.0, 4.3, 4.7, 5.0, 5.5, 6.0, 6.5, 7.0, 7.5,
    8.0, 9.0,
)  # fmt: skip
"""Of a decade on a logarithmic slider: two digits, about evenly spread, those that people write among them."""
REACH_FACTORS = (100.0, 10.0, 3.0, 1.3)
"""Of a logarithmic slider to either side, as a factor; the first that constructors take at its ends."""
LINEAR_REACHES = (2.0, 1.0, 0.5, 0.1)
"""Of a linear one to either side, in sizes of the number itself; of a zero in units."""
LINEAR_STEPS = 40
"""To either side of a linear slider's beginning."""
FIXED_KEYS = ("name", "record_points", "seed", "sample_time", "solver")
"""Keys that hold no number of the loop, or say at which instants something happens."""
GRID_KEYS = ("t_end", "dt")
"""Keys of the simulation; their sliders are the page's own."""
DELAY_PATH = FieldPath(("plant", "input", "delay"))
"""A slider of the page's own too: it moves how far a module looks back, in whole steps."""
At = Callable[[FieldPath, float], Case]
"""The case with another number at one place; InputError where it can't be used."""

SYMBOLS = {
    "gamma": ("Γ", ""), "kappa": ("κ", "s"), "tau": ("τ", "s"), "theta": ("θ", ""), "x0": ("x(0)", ""), "k_0": ("k₀", ""),
    "amplitude": ("amplitude", ""), "frequency": ("frequency", "rad/s"), "phase": ("phase", "rad"), "t_end": ("horizon", "s"),
    "dt": ("step h", "s"), "c_0": ("c₀", ""), "covariance0": ("P(0)", ""), "alpha_0": ("α₀", ""), "delta_0": ("δ₀", "1/s"),
    "theta_hat0": ("θ̂(0)", ""), "sigma": ("σ", ""), "A_m": ("A_m", ""), "b": ("b", ""), "delay": ("delay", "s"),
    "gain": ("input gain", ""), "start": ("start", "s"), "sigma_bound": ("σ bound", ""), "lower": ("least", ""),
    "upper": ("greatest", ""), "input_gain": ("input gain", ""), "g_0": ("dead zone g₀", ""), "c_0_min": ("least c₀", ""),
    "frequencies": ("frequency", "rad/s"), "amplitudes": ("amplitude", ""), "rate_limit": ("rate limit", "1/s"),
    "lag": ("sensor lag", "s"), "std": ("noise, standard deviation", ""),
}  # fmt: skip
"""Symbol and unit by a number's key, where the key alone does not say it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Number:
    """A number of the case with the values that its slider has.

    values       (K,) increasing, the case's own among them
    whole        whether it is written without a point
    logarithmic  whether the slider's scale is
    without      between the least and the greatest, which would be another system
    """

    path: FieldPath
    value: float
    values: Array
    whole: bool
    logarithmic: bool
    without: tuple[float, ...] = ()

    @property
    def label(self) -> str:
        """Symbol, indices counted from 1, and unit."""
        keys = [key for key in self.path.keys if isinstance(key, str)]
        symbol, unit = SYMBOLS.get(keys[-1], (keys[-1].replace("_", " "), ""))
        if keys[-1] in ("num", "den"):
            symbol = f"{keys[-2].replace('_', ' ')} {keys[-1]}"
        after = self.path.keys[len(self.path.keys) - 1 - self.path.keys[::-1].index(keys[-1]) + 1 :]
        places = ",".join(str(int(index) + 1) for index in after)
        return symbol + (f" [{places}]" if places else "") + (f", {unit}" if unit else "")

    @property
    def group(self) -> tuple[Key, ...]:
        """The table that it stands in: a controller's keys are ("controller", i)."""
        first = self.path.keys[0]
        return self.path.keys[:2] if first in ("controller", "reference") and isinstance(self.path.keys[1], int) else (first,)


def in_tables(tables: dict[str, Any]) -> Iterator[tuple[FieldPath, float]]:
    """The numbers of a case file's tables with their places."""
    yield from ((FieldPath(keys), value) for keys, value in _within(tables, ()))


def _within(part: Any, keys: tuple[Key, ...]) -> Iterator[tuple[tuple[Key, ...], float]]:
    if isinstance(part, dict):
        for key, inner in part.items():
            if key not in FIXED_KEYS:
                yield from _within(inner, (*keys, key))
    elif isinstance(part, list):
        for i, inner in enumerate(part):
            yield from _within(inner, (*keys, i))
    elif isinstance(part, (int, float)) and not isinstance(part, bool) and np.isfinite(part):
        yield keys, part


def ranged(path: FieldPath, value: float, at: At) -> Number | None:
    """The number with the values that its case's constructors take; None where they take no other one."""
    whole = isinstance(value, int)
    if value > 0 and not _taken(path, [-value], at):
        for reach in REACH_FACTORS:
            values = _decades(value / reach, value * reach, value)
            if _taken(path, [values[0], values[-1]], at):
                return Number(path=path, value=value, values=values, whole=whole, logarithmic=True)
        return None
    size = abs(value) or 1.0
    for reach in LINEAR_REACHES:
        values = value + reach * size / LINEAR_STEPS * np.arange(-LINEAR_STEPS, LINEAR_STEPS + 1)
        values = np.unique([float(f"{v:.6g}") for v in values] + [float(value)])
        if value == 0 and not _taken(path, [-size], at):
            values = values[values >= 0]
        if _taken(path, [values[0], values[-1]], at):
            return Number(path=path, value=value, values=values, whole=whole, logarithmic=False)
    return None


def _decades(low: float, high: float, own: float) -> Array:
    exponents = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    found = [float(f"{mantissa}e{exponent}") for exponent in exponents for mantissa in MANTISSAS]
    return np.unique([v for v in found if 0.999 * low <= v <= 1.001 * high] + [float(own)])


def _taken(path: FieldPath, values: Sequence[float], at: At) -> bool:
    try:
        for value in values:
            at(path, float(value))
    except InputError:
        return False
    return True
