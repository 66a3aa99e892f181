"""Measured data as a signal."""

from __future__ import annotations

import re
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from barbalat import validate
from barbalat.settings import Settings, one_line
from barbalat.signals.piecewise import between
from barbalat.signals.smooth import Continuous, outward
from barbalat.validate import Array, InputError


@dataclass(frozen=True, eq=False)
class Recorded(Continuous, Settings):
    """Linear interpolation of (times, values); the first and last value are held outside. Times in s, increasing."""

    times: Array
    values: Array

    __repr__ = one_line

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
    def from_csv(cls, file: str | Path, *, separator: str | None = None) -> Recorded:
        """Read a column of times [s] and a column of values; one header line may stand on top.

        separator  between the two: a comma, a semicolon, a tab or spaces, found out where it is not given. Beside any but the
                   comma, numbers may have a decimal comma

        Raises InputError that names the file and, where there is one, the line.
        """
        path = _path(file)
        if separator is not None:
            validate.instance("separator", separator, str)
        try:
            lines = path.read_text(encoding="utf-8-sig").splitlines()
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or "it is not a text file"
            raise InputError(f"the data file {validate.show(str(path))} cannot be read: {reason}") from None
        between_cells = _separator(lines) if separator is None else separator
        rows: list[tuple[float, float]] = []
        for position, line in enumerate(lines, start=1):
            if not line.strip():
                continue
            cells = _cells(line, between_cells)
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
        return cls._of_file(path, data[:, 0], data[:, 1])

    @classmethod
    def from_mat(cls, file: str | Path, *, times: str = "t", values: str | None = None) -> Recorded:
        """Read a MATLAB file (up to version 7.2): a vector of times [s] and one of values, by the variables' names.

        values  the only other variable of as many numbers by default; of a matrix ``values`` with two columns or rows, named
                alone, the first has the times

        Raises InputError that names the file and the variables in it.
        """
        from scipy.io import loadmat
        from scipy.io.matlab import MatReadError

        path = _path(file)
        for name, given in (("times", times), ("values", values)):
            if given is not None:
                validate.label(name, given)
        try:
            found = {k: np.squeeze(v) for k, v in loadmat(str(path), appendmat=False).items() if not k.startswith("__")}
        except NotImplementedError:
            raise InputError(f"{path} is a MATLAB file of version 7.3; save it with save(..., '-v7')") from None
        except OSError as error:
            reason = error.strerror or "it is no MATLAB file"
            raise InputError(f"the data file {validate.show(str(path))} cannot be read: {reason}") from None
        except (MatReadError, ValueError, TypeError, KeyError, IndexError, EOFError, zlib.error, struct.error):
            raise InputError(f"the data file {validate.show(str(path))} cannot be read: it is no MATLAB file") from None
        there = ", ".join(sorted(found)) or "none"
        if values in found and times not in found and found[values].ndim == 2 and 2 in found[values].shape:
            pair = found[values] if found[values].shape[0] == 2 else found[values].T
            return cls._of_file(path, *pair)
        if times not in found:
            raise InputError(f"{path} has no variable {times!r} for the times; its variables are: {there}")
        fitting = [k for k, v in found.items() if k != times and v.shape == found[times].shape]
        chosen = fitting[0] if values is None and len(fitting) == 1 else values
        if chosen not in found:
            missing = "name one with values" if values is None else f"it has no variable {values!r}"
            raise InputError(f"{path}: {missing}; its variables are: {there}")
        return cls._of_file(path, found[times], found[chosen])

    @classmethod
    def _of_file(cls, path: Path, times: Array, values: Array) -> Recorded:
        try:
            return cls(times, values)
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

    @property
    def slope(self) -> float:
        return outward(float(np.abs(np.diff(self.values) / np.diff(self.times)).max(initial=0.0)))

    @property
    def settles(self) -> bool:
        return True  # the last value is held


@dataclass(frozen=True)
class MatFile(Settings):
    """A MATLAB file, as a case file names it: see ``Recorded.from_mat``.

    file    relative to the case file
    times   the variable with the times [s]
    values  the variable with the values; the only other one of as many numbers by default
    """

    file: str
    times: str = "t"
    values: str | None = None


def _path(file: str | Path) -> Path:
    if not isinstance(file, (str, Path)):
        raise InputError(f"file must be a path, got {validate.show(file)}")
    return Path(file)


def _separator(lines: list[str]) -> str:
    """What stands between two numbers in the first line that has any: the surest sign first."""
    first = next((line.strip() for line in lines if any(map(str.isdigit, line))), "")
    for sign in ("\t", ";"):
        if sign in first:
            return sign
    decimal_commas = " " in re.sub(r"\s*,\s*", ",", first)  # 0,5 1,25
    return "," if "," in first and not decimal_commas else " "


def _cells(line: str, separator: str) -> list[str]:
    """The line's parts, a decimal comma in them as a point."""
    if separator == ",":
        return line.split(",")
    parts = line.split() if not separator.strip(" ") else line.split(separator)
    return [part.replace(",", ".") for part in parts]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
