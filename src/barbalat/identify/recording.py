"""A recording for identification: times, held inputs and measured states, read from a CSV file."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from barbalat import validate
from barbalat.budget import Estimate
from barbalat.reading import contents
from barbalat.validate import Array, InputError

TEXT_BYTE = Estimate(memory=40.0, seconds=2e-7)
"""The cost of a byte of a CSV file, for its text, its cells and its numbers."""
LEAST_SAMPLES = 8
EVEN = 1e-6
"""Relative difference up to which sampling intervals count as one sample time."""
CONSTANT = "constant"
"""The name of a constant term, which is treated as an input that is always 1."""


@dataclass(frozen=True, eq=False)
class Recording:
    """times (N,) [s] increase, inputs (N, m) are held until the next time, and outputs (N, n) are the measured states."""

    times: Array
    inputs: Array
    outputs: Array
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]

    def __post_init__(self) -> None:
        times = validate.vector("times", self.times)
        N = len(times)
        validate.freeze(
            self,
            times=times,
            inputs=validate.array("inputs", self.inputs, (N, len(self.input_names))),
            outputs=validate.array("outputs", self.outputs, (N, len(self.output_names))),
        )
        late = np.flatnonzero(np.diff(times) <= 0)
        if len(late):
            i = int(late[0])
            raise InputError.of("times", f"must be increasing, but sample {i + 2} is at {times[i + 1]:g} after {times[i]:g}")
        if N < LEAST_SAMPLES:
            raise InputError.of("times", f"must be at least {LEAST_SAMPLES}, got {N}")

    def part(self, start: int, stop: int) -> Recording:
        """The samples from ``start`` to ``stop``."""
        cut = slice(start, stop)
        return Recording(self.times[cut], self.inputs[cut], self.outputs[cut], self.input_names, self.output_names)

    @property
    def sample_time(self) -> float | None:
        """The sample time [s]; None if the samples are not evenly spaced."""
        h = float(self.times[-1] - self.times[0]) / (len(self.times) - 1)
        return h if float(np.abs(np.diff(self.times) - h).max()) <= EVEN * h + 1e-14 * float(np.abs(self.times).max()) else None

    def delayed(self, delay: float) -> Recording:
        """The recording with the inputs delayed by a dead time [s]; it begins when the first delayed input arrives.

        Raises InputError unless the dead time is a multiple of the sample time and shorter than the recording.
        """
        h = self.sample_time
        if h is None:
            raise InputError.of("delay", "needs samples at equal intervals, but the intervals of these samples differ")
        steps = round(delay / h)
        if delay < 0 or abs(delay / h - steps) > 1e-6:
            low = max(0, math.floor(delay / h))
            raise InputError.of(
                "delay", f"must be a multiple of the sample time, such as {low * h:g} or {(low + 1) * h:g}, got {delay:g}"
            )
        if len(self.times) - steps < LEAST_SAMPLES:
            raise InputError.of("delay", f"is {delay:g}, but the recording lasts only {self.times[-1] - self.times[0]:g} s")
        return self.shifted(steps)

    def shifted(self, steps: int) -> Recording:
        """The samples from number ``steps`` on, each with the input from that many samples earlier."""
        N = len(self.times)
        return Recording(self.times[steps:], self.inputs[: N - steps], self.outputs[steps:], self.input_names, self.output_names)

    def about(self, reference: Array) -> Recording:
        """Deviations from a reference (n + m,) of the outputs and inputs, with an additional input 1 for a constant term in each
        row."""
        n = len(self.output_names)
        inputs = np.column_stack([self.inputs - reference[n:], np.ones(len(self.times))])
        return Recording(self.times, inputs, self.outputs - reference[:n], (*self.input_names, CONSTANT), self.output_names)


def read_csv(file: str | Path, inputs: Sequence[str], outputs: Sequence[str], time: str | None = None) -> Recording:
    """Read the columns with these names; the time is the column ``time``, by default t or time.

    Raises InputError with the file and the column or line.
    """
    path = validate.local_path("the data file", file)
    try:
        text = contents(path, "the data file", TEXT_BYTE).decode("utf-8-sig")
    except InputError:
        raise
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is not a text file"
        raise InputError(f"the data file {validate.show(str(path))} cannot be read: {reason}") from None
    rows = list(csv.reader(text.splitlines()))
    header = [cell.strip() for cell in rows[0]] if rows else []
    _require_names(inputs, outputs)
    if time is None:
        time = next((name for name in header if name.lower() in ("t", "time")), "t")
    names = [time, *inputs, *outputs]
    for name in names:
        if header.count(name) != 1:
            found = "twice" if name in header else f"not in its first line{validate.hint(name, header)}"
            raise InputError(f"{path}: the column {validate.show(name)} is {found}")
    places = [header.index(name) for name in names]
    data = np.array([_numbers(path, i, row, names, places) for i, row in enumerate(rows[1:], start=2) if any(row)])
    if not len(data):
        raise InputError(f"{path} has no rows of numbers below its first line")
    m = len(inputs)
    return Recording(data[:, 0], data[:, 1 : 1 + m], data[:, 1 + m :], tuple(inputs), tuple(outputs))


def _require_names(inputs: Sequence[str], outputs: Sequence[str]) -> None:
    if not inputs or not outputs:
        raise InputError(f"{'inputs' if not inputs else 'outputs'} must name at least one column")
    both = [*inputs, *outputs]
    if twice := [name for name in both if both.count(name) > 1]:
        raise InputError(f"inputs and outputs must be different columns, got {validate.show(twice[0])} twice")


def _numbers(path: Path, line: int, row: Sequence[str], names: Sequence[str], places: Sequence[int]) -> list[float]:
    """The finite numbers of a line in the named columns; raises InputError with the line and the column."""
    found = []
    for name, place in zip(names, places, strict=True):
        cell = row[place].strip() if place < len(row) else ""
        try:
            found.append(float(cell))
        except ValueError:
            found.append(math.nan)
        if not math.isfinite(found[-1]):
            got = validate.show(cell) if cell else "an empty cell"
            raise InputError(f"{path}, line {line}, column {validate.show(name)}: expected a number, got {got}")
    return found
