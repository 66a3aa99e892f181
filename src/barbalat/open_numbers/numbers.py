"""The numbers of a case, the admissible values of each, and the values that are tried to find its effect."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np

from barbalat.cases.build import Case
from barbalat.open_numbers.path import WRAPPED, FieldPath, Key, wrapped_in
from barbalat.protocols import InterpolatedSignal
from barbalat.validate import Array, InputError

NO_NUMBERS = ("name", "record_points", "seed", "sample_time", "solver")
"""Keys and fields that contain no number of the loop, or that determine when something happens."""
MANTISSAS = (
    1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.8, 2.0, 2.2, 2.5, 2.7, 3.0, 3.3, 3.6, 4.0, 4.3, 4.7, 5.0, 5.5, 6.0, 6.5, 7.0, 7.5,
    8.0, 9.0,
)  # fmt: skip
"""Values per decade on a logarithmic slider: roughly evenly spaced, with two digits, including the usual round values."""
REACH_FACTORS = (100.0, 10.0, 3.0, 1.3)
"""Range of a logarithmic slider to either side, as a factor; the first factor for which constructors accept the ends is used."""
LINEAR_REACHES = (2.0, 1.0, 0.5, 0.1)
"""Range of a linear slider to either side, relative to the number; absolute for a zero."""
LINEAR_STEPS = 40
"""Number of steps to either side of the start of a linear slider."""
SPECIAL_VALUES = (-1.0, 0.0, 1.0)
"""Values on which a structure may depend: zeros determine which states are coupled, and a gain of one is omitted."""
At = Callable[[FieldPath, float], Case]
"""The case with a different number at one place; raises InputError if that case can't be used."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Number:
    """A number of the case with the values of its slider.

    values       (K,) increasing, including the value in the case
    whole        whether the number is written without a decimal point
    logarithmic  whether the slider's scale is logarithmic
    without      excluded values in between, which would change the structure
    """

    path: FieldPath
    value: float
    values: Array
    whole: bool
    logarithmic: bool
    without: tuple[float, ...] = ()

    @property
    def tried(self) -> Array:
        """The values that are tried: the present value, some over the whole range, and values on which a structure may depend."""
        values, last = self.values, len(self.values) - 1
        special = [value for value in SPECIAL_VALUES if values[0] <= value <= values[last] and value not in self.without]
        return np.unique([self.value, *values[[0, last // 5, last // 2, last]], *special])


def neighbours(value: float) -> tuple[float, float]:
    """Two values near a number without a known range, one on each side, which are tried instead."""
    return 1.125 * value + 0.0625 * (value == 0), 0.875 * value - 0.0625 * (value == 0)


def in_tables(tables: dict[str, Any]) -> Iterator[tuple[FieldPath, float]]:
    """The numbers of a case file's tables with their places; for a physical parameter, its simulated value."""
    declared, truth = tables.get("parameters"), tables.get("truth")
    given = declared if isinstance(declared, dict) else {}
    own = truth.get("parameters", {}) if isinstance(truth, dict) else {}
    for name, one in given.items():
        if name not in own:
            yield FieldPath(("parameters", name)), one["value"] if isinstance(one, dict) else one
    others = {key: value for key, value in tables.items() if key != "parameters"} if given else tables
    yield from ((FieldPath(keys), value) for keys, value in _within(others, ()))


def _within(part: Any, keys: tuple[Key, ...]) -> Iterator[tuple[tuple[Key, ...], float]]:
    if isinstance(part, dict):
        for key, inner in part.items():
            if key not in NO_NUMBERS:
                yield from _within(inner, (*keys, key))
    elif isinstance(part, list):
        for i, inner in enumerate(part):
            yield from _within(inner, (*keys, i))
    elif isinstance(part, (int, float)) and not isinstance(part, bool) and np.isfinite(part):
        yield keys, part


def in_case(case: Case) -> Iterator[tuple[FieldPath, float]]:
    """The numbers of a problem, of its controllers and of the simulation, each with its path in ``VariedObjects``."""
    parts = [((), case.problem), *((("controller", i), one) for i, one in enumerate(case.controllers))]
    for keys, part in (*parts, (("simulation",), case.simulation)):
        yield from ((FieldPath.of_field(place), value) for place, value in in_object(part, keys))


def in_object(part: Any, keys: tuple[Key, ...]) -> Iterator[tuple[tuple[Key, ...], float]]:
    """The numbers among the fields of an object; for a controller that contains another controller, the numbers of both."""
    if isinstance(part, (bool, InterpolatedSignal)):  # recorded data are not varied
        return
    if isinstance(part, (int, float)):
        if np.isfinite(part):
            yield keys, part
    elif isinstance(part, np.ndarray) and part.dtype.kind == "f":
        for index in np.ndindex(part.shape):
            yield (*keys, *index), float(part[index])
    elif isinstance(part, (tuple, list)):
        for i, inner in enumerate(part):
            yield from in_object(inner, (*keys, i))
    elif is_dataclass(part) and not isinstance(part, type):
        runs_another = wrapped_in(part) is not None
        for one in fields(part):
            if one.init and one.name not in NO_NUMBERS:
                within = keys if runs_another and one.name == WRAPPED else (*keys, one.name)
                yield from in_object(vars(part).get(one.name), within)


def ranged(path: FieldPath, value: float, at: At) -> Number | None:
    """The number with the values that the constructors of its case accept; None if they accept no other value."""
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
