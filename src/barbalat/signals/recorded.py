"""Measured data as a signal, from text files and MATLAB files."""

from __future__ import annotations

import math
import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, ClassVar, cast

import numpy as np

from barbalat import budget, validate
from barbalat.budget import Estimate
from barbalat.reading import contents
from barbalat.settings import Settings, one_line
from barbalat.signals.piecewise import between
from barbalat.signals.smooth import Continuous, outward
from barbalat.validate import Array, InputError


@dataclass(frozen=True, eq=False)
class Recorded(Continuous, Settings):
    """Linear interpolation of (times, values); outside, the first or last value is held. Times in s, increasing."""

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
        """Read a column of times [s] and a column of values, after an optional header and an optional line of units.

        separator  the separator of the columns: a comma, a semicolon, a tab or spaces, detected by default. Unless the separator
                   is a comma, numbers may have a decimal comma

        Raises InputError with the file and, if known, the line.
        """
        path = _path(file)
        if separator is not None:
            validate.instance("separator", separator, str)
        try:
            lines = _text(contents(path, "the data file", TEXT_BYTE)).splitlines()
        except InputError:
            raise
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or "it is not a text file"
            raise InputError(f"the data file {validate.show(str(path))} cannot be read: {reason}") from None
        said = SEPARATOR_SAID.fullmatch(lines[0]) if lines else None
        if said:
            lines[0] = ""
        between_cells = separator or (said and said[1]) or _separator(lines)
        rows: list[tuple[float, float]] = []
        for position, line in enumerate(lines, start=1):
            if not line.strip():
                continue
            cells = _cells(line, between_cells)
            try:
                time, value = (float(cell) for cell in cells)
            except ValueError:
                first = position == 1 or (said is not None and position == 2)
                if not rows and (first or not any(map(str.isdigit, line))) and not any(_is_number(cell) for cell in cells):
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

        times   name of the times. If there is no such variable, the only one called t, time, times or tout is taken, even inside
                a structure
        values  by default the only other variable with as many numbers. In a matrix with two columns or rows that is named here
                or is the only variable, the first column or row contains the times. A field of a structure is named with a dot:
                "out.time"

        Raises InputError with the file and the variables in it.
        """
        path = _path(file)
        for name, given in (("times", times), ("values", values)):
            if given is not None:
                validate.label(name, given)
        return cls._of_file(path, *times_and_values(path, variables(path), times, values))

    @classmethod
    def _of_file(cls, path: Path, times: Array, values: Array) -> Recorded:
        try:
            return cls(times, values)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None

    def __call__(self, t: Array) -> Array:
        return np.interp(t, self.times, self.values)

    @property
    def interpolation_points(self) -> tuple[Array, Array]:
        """The times [s] and the values."""
        return self.times, self.values

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
    """A MATLAB file, given by its path in a case file: see ``Recorded.from_mat``.

    file    relative to the case file
    times   the variable with the times [s]
    values  the variable with the values; by default the only other variable with the same number of entries
    """

    makes: ClassVar[type] = Recorded

    file: str
    times: str = "t"
    values: str | None = None


TEXT_BYTE = Estimate(memory=20.0, seconds=3e-7)
"""The cost of each byte of a text file with times and values: 170 MB and 2.3 s for a million rows of 9 bytes."""


def _path(file: str | Path) -> Path:
    if not isinstance(file, (str, Path)):
        raise InputError(f"file must be a path, got {validate.show(file)}")
    return validate.local_path("file", file)


SEPARATOR_SAID = re.compile(r"sep=([,;\t])", re.IGNORECASE)
"""The line with which spreadsheets declare their separator."""


def _text(content: bytes) -> str:
    """Decode as UTF-8, or else as Latin-1: numbers read the same in both, and headers are not used."""
    if b"\0" in content:
        raise ValueError("not a text")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _separator(lines: list[str]) -> str:
    """The separator between two numbers, from the first line that begins with a number, or else from the first line with a
    digit."""
    numbers = [line.strip() for line in lines if re.match(r'[\s"]*[-+.]?\d', line)]
    first = next((line.strip() for line in [*numbers, *lines] if any(map(str.isdigit, line))), "")
    for sign in ("\t", ";"):
        if sign in first:
            return sign
    decimal_commas = " " in re.sub(r"\s*,\s*", ",", first)  # 0,5 1,25
    return "," if "," in first and not decimal_commas else " "


def _cells(line: str, separator: str) -> list[str]:
    """The line's cells without quotes, with a decimal comma replaced by a point."""
    if separator == ",":
        return [part.strip().strip('"') for part in line.split(",")]
    parts = line.split() if not separator.strip(" ") else line.split(separator)
    return [part.strip().strip('"').replace(",", ".") for part in parts]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


TIMES = ("t", "time", "times", "tout")
"""The usual names of the times in MATLAB files, including those of Simulink."""


def variables(path: Path) -> dict[str, Array]:
    """The numbers in a file by their names, a field of a structure as "name.field"; raises InputError if it is not a MATLAB
    file."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        packed = contents(path, "the data file", FILE_BYTE)
        size, name = _unpacked(packed), f"the data file {validate.show(str(path))}"
        fits = lambda most: f"at most {most} bytes"  # noqa: E731
        budget.require(name, size, FILE_BYTE.times, given=f"holds {size} bytes when unpacked, and", fits=fits)
        found = loadmat(cast("Any", BytesIO(packed)), appendmat=False)  # missing in SciPy's stubs
    except InputError:
        raise
    except (MemoryError, OverflowError):
        raise InputError(
            f"the data file {validate.show(str(path))} cannot be read: an array in it does not fit in memory"
        ) from None
    except NotImplementedError:
        raise InputError(f"{path} is a MATLAB file of version 7.3; save it with save(..., '-v7')") from None
    except OSError as error:
        reason = error.strerror or "it is not a MATLAB file"
        raise InputError(f"the data file {validate.show(str(path))} cannot be read: {reason}") from None
    except (MatReadError, ValueError, TypeError, KeyError, IndexError, EOFError, zlib.error, struct.error):
        raise InputError(f"the data file {validate.show(str(path))} cannot be read: it is not a MATLAB file") from None
    return {name: one for key, value in found.items() if not key.startswith("__") for name, one in _numbers(key, value)}


FILE_BYTE = Estimate(memory=20.0, seconds=2e-7)
"""The cost of each unpacked byte of a MATLAB file: a single number in a cell takes 56 bytes in the file and about 20 times as
much in memory."""
HEADER_BYTES, TAG_BYTES, COMPRESSED = 128, 8, 15
"""Bytes of a version 5 file's header and of the tag before each element, and the type of a compressed element."""
SHAPE_AT = 16
"""Offset in bytes of the shape within a variable, after its kind."""
PIECE_BYTES = 2**20


def _unpacked(packed: bytes) -> int:
    """The number of bytes of a file's variables after decompression, determined without storing them.

    A variable counts with its declared size if that is larger. A file of a different format is left to the reader.
    """
    order = {b"IM": "<", b"MI": ">"}.get(packed[HEADER_BYTES - 2 : HEADER_BYTES])
    if order is None:
        return len(packed)
    total, place = 0, HEADER_BYTES
    while place + TAG_BYTES <= len(packed):
        kind, size = struct.unpack_from(f"{order}II", packed, place)
        part, place = packed[place + TAG_BYTES : place + TAG_BYTES + size], place + TAG_BYTES + size
        head, inside = (part[:PIECE_BYTES], len(part)) if kind != COMPRESSED else _inflated(part)
        total += max(inside, _claimed(head, order))
    return total


def _inflated(part: bytes) -> tuple[bytes, int]:
    """The beginning of a compressed variable, after its tag, and its total number of bytes."""
    stream, total, head = zlib.decompressobj(), 0, b""
    while part and not stream.eof:
        piece = stream.decompress(part, PIECE_BYTES)
        if not piece:
            break  # the file is truncated
        part, total, head = stream.unconsumed_tail, total + len(piece), head or piece[TAG_BYTES:]
    return head, total


def _claimed(head: bytes, order: str) -> int:
    """The number of bytes of as many floats as the shape of a variable declares."""
    if len(head) < SHAPE_AT + TAG_BYTES:
        return 0
    _, size = struct.unpack_from(f"{order}II", head, SHAPE_AT)
    count = min(size, len(head) - SHAPE_AT - TAG_BYTES) // 4
    shape: tuple[int, ...] = struct.unpack_from(f"{order}{count}I", head, SHAPE_AT + TAG_BYTES)
    return 8 * math.prod(shape)


def _numbers(name: str, value: Any) -> Iterator[tuple[str, Array]]:
    if not isinstance(value, np.ndarray):
        return
    if value.dtype.names and value.size == 1:
        for field in value.dtype.names:
            yield from _numbers(f"{name}.{field}", value.reshape(-1)[0][field])
    elif value.dtype.kind in "biuf":
        yield name, np.squeeze(value)


def times_and_values(path: Path, found: dict[str, Array], times: str, values: str | None) -> tuple[Array, Array]:
    """Return the variables that are named, or the only possible ones; raises InputError, with the names, if there are none or
    several."""
    there = f"its variables are: {', '.join(sorted(found)) or 'none'}"
    if times not in found and times == TIMES[0]:
        named = [name for name in found if name.rpartition(".")[2].lower() in TIMES]
        times = named[0] if len(named) == 1 else times
    pair = values if values is not None else next(iter(found)) if len(found) == 1 else None
    if times not in found and pair in found and found[pair].ndim == 2 and 2 in found[pair].shape:
        if found[pair].shape == (2, 2):
            raise InputError(
                f"{path}: {pair} is 2 x 2, so the times may be a column or a row; save the times as a separate vector"
            )
        first, second = found[pair] if found[pair].shape[0] == 2 else found[pair].T
        return first, second
    if times not in found:
        raise InputError(f"{path} has no variable {times!r} for the times; {there}")
    fitting = [name for name, one in found.items() if name != times and one.shape == found[times].shape]
    chosen = fitting[0] if values is None and len(fitting) == 1 else values
    if chosen not in found:
        missing = "name one with values" if values is None else f"it has no variable {values!r}"
        raise InputError(f"{path}: {missing}; {there}")
    return found[times], found[chosen]
