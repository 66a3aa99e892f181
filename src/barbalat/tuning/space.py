"""The fields that a tuning turns: their ranges, and where a scheme's own knobs stand in a case file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from barbalat import validate
from barbalat.controllers.knobs import Knobs
from barbalat.open_numbers.path import FieldPath, Key
from barbalat.validate import Array, InputError

SIGNIFICANT_DIGITS = 4
"""Of a tuned number: a case file stays readable, and what is judged is what stands in it."""


@dataclass(frozen=True)
class Range:
    """From ``low`` to ``high``, turned in the logarithm where asked."""

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
        """A range as START:STOP[:log]; InputError for another text."""
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
        """Values of shares of the way, of few digits."""
        if self.logarithmic:
            found = np.exp(np.log(self.low) + (np.log(self.high) - np.log(self.low)) * share)
        else:
            found = self.low + (self.high - self.low) * share
        return np.clip([float(f"{value:.{SIGNIFICANT_DIGITS}g}") for value in found], self.low, self.high)

    def share(self, value: float) -> float | None:
        """Where a value lies; None outside."""
        if not self.low <= value <= self.high:
            return None
        if self.logarithmic:
            return float(np.log(value / self.low) / np.log(self.high / self.low))
        return (value - self.low) / (self.high - self.low)

    def __str__(self) -> str:
        return f"{self.low:g}:{self.high:g}{':log' if self.logarithmic else ''}"


@dataclass(frozen=True)
class Space:
    """Ranges by the paths of what they are of."""

    ranges: Mapping[FieldPath, Range]

    def __len__(self) -> int:
        return len(self.ranges)

    @property
    def paths(self) -> tuple[FieldPath, ...]:
        return tuple(self.ranges)

    def rows(self, shares: Array) -> Array:
        """(K, d) numbers for shares of each range."""
        return np.column_stack([one.at(shares[:, i]) for i, one in enumerate(self.ranges.values())])

    def shares(self, row: Array) -> Array | None:
        """(d,) where a tuning lies; None outside."""
        found = [one.share(float(value)) for one, value in zip(self.ranges.values(), row, strict=True)]
        return None if any(share is None for share in found) else np.array(found, dtype=float)


BEYOND_GRID = 100.0
"""Factor by which a search goes beyond the grid's ends, of a knob that nothing else bounds."""


def of_knobs(knobs: Knobs, tables: object, controller: int) -> Space:
    """The scheme's knobs that stand in the controller's table, each where its name stands once; InputError where none does."""
    found: dict[FieldPath, Range] = {}
    for name, values in knobs.values.items():
        places = list(_places(tables, name))
        if len(places) == 1:
            path = FieldPath(("controller", controller, *places[0]))
            beyond = BEYOND_GRID if name in knobs.open else 1.0
            found[path] = Range(float(values.min()) / beyond, float(values.max()) * beyond, logarithmic=True)
    if not found:
        raise InputError(
            f"none of the knobs of {knobs.scheme}, {', '.join(knobs.values)}, stands as a number in the case: say what is tuned, "
            f"--vary controller[{controller}].KEY=START:STOP[:log]"
        )
    return Space(found)


def _places(part: object, name: str) -> Iterator[tuple[Key, ...]]:
    """Where a number of that name stands."""
    if isinstance(part, dict):
        for key, value in part.items():
            if key == name and isinstance(value, (int, float)) and not isinstance(value, bool):
                yield (key,)
            else:
                yield from ((key, *rest) for rest in _places(value, name))
