"""Measured data as a signal."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from barbalat import validate
from barbalat.signals.piecewise import between
from barbalat.signals.smooth import Continuous, outward
from barbalat.validate import Array, InputError


@dataclass(frozen=True, eq=False)
class Recorded(Continuous):
    """Linear interpolation of (times, values); the first and last value are held outside. Times in s, increasing."""

    times: Array
    values: Array

    def __post_init__(self) -> None:
        times = validate.vector("times", self.times)
        values = validate.vector("values", self.values, len(times))
        late = np.flatnonzero(np.diff(times) <= 0)
        if len(late):
            i = int(late[0])
            raise InputError(f"times must be increasing, but entry {i + 2} is {times[i + 1]:g} after {times[i]:g}")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "values", values)

    @classmethod
    def from_csv(cls, file: str | Path) -> Recorded:
        """Read a column of times [s] and a column of values, separated by commas; one header line may stand on top.

        Raises InputError that names the file and, where there is one, the line.
        """
        if not isinstance(file, (str, Path)):
            raise InputError(f"file must be a path, got {validate.show(file)}")
        path = Path(file)
        try:
            lines = path.read_text(encoding="utf-8-sig").splitlines()
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or "it is not a text file"
            raise InputError(f"the data file {validate.show(str(path))} cannot be read: {reason}") from None
        rows: list[tuple[float, float]] = []
        for position, line in enumerate(lines, start=1):
            if not line.strip():
                continue
            cells = line.split(",")
            try:
                time, value = (float(cell) for cell in cells)
            except ValueError:
                if position == 1 and not any(_is_number(cell) for cell in cells):
                    continue  # the header
                raise InputError(f"{path}, line {position}: expected a time and a value, got {validate.show(line)}") from None
            rows.append((time, value))
        if not rows:
            raise InputError(f"the data file {validate.show(str(path))} has no rows of a time and a value")
        data = np.array(rows)
        try:
            return cls(data[:, 0], data[:, 1])
        except InputError as error:
            raise InputError(f"{path}: {error}") from None

    def __call__(self, t: Array) -> Array:
        return np.interp(t, self.times, self.values)

    def breaks(self, start: float, stop: float) -> Array:
        slopes = np.diff(self.values) / np.diff(self.times)
        return between(start, stop, self.times[np.diff(slopes, prepend=0.0, append=0.0) != 0])

    @property
    def bound(self) -> float:
        return outward(float(np.abs(self.values).max()))


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
