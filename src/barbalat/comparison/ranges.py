"""The ranges of the fields that a tuning varies, and the positions of a scheme's knobs in a case file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from barbalat import validate
from barbalat.controllers.tuning_grid import TuningGrid
from barbalat.open_numbers.path import FieldPath, Key
from barbalat.validate import Array, InputError

SIGNIFICANT_DIGITS = 4
"""Number of digits of a tuned number. The case file stays readable, and the evaluated value is the one in the file."""


@dataclass(frozen=True)
class Range:
    """A range from ``low`` to ``high``, on a logarithmic scale if requested."""

    low: float
    high: float
    logarithmic: bool = False

    def __post_init__(self) -> None:
        low, high = validate.number("START", self.low), validate.number("STOP", self.high)
        if not low < high:
            raise InputError(f"START must be below STOP, got {low:g} and {high:g}")
        if self.logarithmic and low <= 0:
            raise InputError(f"START must be positive for log, got {low:g}")

    @classmethod
    def parse(cls, text: str) -> Range:
        """Parse a range such as START:STOP[:log]. Raises InputError for a different text."""
        parts = text.split(":")
        if len(parts) not in (2, 3) or (len(parts) == 3 and parts[2] != "log"):
            raise InputError(f"a range must be START:STOP or START:STOP:log, got {validate.show(text)}")
        try:
            return cls(float(parts[0]), float(parts[1]), len(parts) == 3)
        except ValueError as error:
            if isinstance(error, InputError):
                raise
            raise InputError(f"START and STOP must be numbers, got {validate.show(text)}") from None

    def at(self, share: Array) -> Array:
        """Return the values at these fractions of the range, with few digits."""
        if self.logarithmic:
            found = np.exp(np.log(self.low) + (np.log(self.high) - np.log(self.low)) * share)
        else:
            found = self.low + (self.high - self.low) * share
        return np.clip([float(f"{value:.{SIGNIFICANT_DIGITS}g}") for value in found], self.low, self.high)

    def share(self, value: float) -> float | None:
        """Return the fraction of the range at which a value lies; None if it is outside."""
        if not self.low <= value <= self.high:
            return None
        if self.logarithmic:
            return float(np.log(value / self.low) / np.log(self.high / self.low))
        return (value - self.low) / (self.high - self.low)

    def __str__(self) -> str:
        return f"{self.low:g}:{self.high:g}{':log' if self.logarithmic else ''}"


@dataclass(frozen=True)
class Space:
    """The ranges of the varied fields, by their paths."""

    ranges: Mapping[FieldPath, Range]

    def __len__(self) -> int:
        return len(self.ranges)

    @property
    def paths(self) -> tuple[FieldPath, ...]:
        return tuple(self.ranges)

    def rows(self, shares: Array) -> Array:
        """Return the numbers (K, d) that correspond to these fractions of each range."""
        return np.column_stack([one.at(shares[:, i]) for i, one in enumerate(self.ranges.values())])

    def shares(self, row: Array) -> Array | None:
        """Return the fractions (d,) of a tuning; None if it is outside."""
        found = [one.share(float(value)) for one, value in zip(self.ranges.values(), row, strict=True)]
        return None if any(share is None for share in found) else np.array(found, dtype=float)


BEYOND_GRID = 100.0
"""Factor by which a search extends the range of the grid, for parameters without other bounds."""


def of_knobs(knobs: TuningGrid, tables: object, controller: int) -> Space:
    """Return the scheme's knobs in the controller's table, each at the only place where its name occurs. Raises InputError if
    there are no knobs."""
    found: dict[FieldPath, Range] = {}
    for name, values in knobs.values.items():
        places = list(_places(tables, name))
        if len(places) == 1:
            path = FieldPath(("controller", controller, *places[0]))
            beyond = BEYOND_GRID if name in knobs.open else 1.0
            found[path] = Range(float(values.min()) / beyond, float(values.max()) * beyond, logarithmic=True)
    if not found:
        raise InputError(
            f"none of the parameters of {knobs.scheme}, {', '.join(knobs.values)}, is a number in the case: name the numbers to "
            f"tune with --vary controller[{controller}].KEY=START:STOP[:log]"
        )
    return Space(found)


def _places(part: object, name: str) -> Iterator[tuple[Key, ...]]:
    """Yield the positions of numbers with this name."""
    if isinstance(part, dict):
        for key, value in part.items():
            if key == name and isinstance(value, (int, float)) and not isinstance(value, bool):
                yield (key,)
            else:
                yield from ((key, *rest) for rest in _places(value, name))
