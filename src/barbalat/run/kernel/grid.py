"""The time grid of a run: steps, blocks of steps, the tail, and the table of the signals on it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from barbalat import validate
from barbalat.lowering.shape import WATCH_EVERY
from barbalat.protocols import Signal, Value
from barbalat.run.kernel.breaks import breaks_inside
from barbalat.run.kernel.portable import instants, run_times
from barbalat.signals.smooth import Continuous
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

CHUNK_STEPS = 32_768
"""Steps between two calls of the kernel: enough to hide the cost of a call, few enough for the table to stay in the cache."""
TABLE_STEPS = 8192
"""Number of rows made at once: arrays of 64 kB reuse memory, whereas allocating new memory took half of a table's time."""


@dataclass(frozen=True)
class Segment:
    """``blocks`` blocks of ``length`` steps from step ``start`` on."""

    start: int
    blocks: int
    length: int
    in_tail: bool

    @property
    def steps(self) -> int:
        return self.blocks * self.length


def segments_of(simulation: Simulation, *, recorded: bool) -> Iterator[Segment]:
    """The run divided into kernel calls; no block contains the tail's start in its interior, so metrics of the tail are exact.

    A recorded run has one block between two recorded instants; any other run has one block for each call.
    """
    length = min(max(1, round(simulation.steps / simulation.record_points)), CHUNK_STEPS) if recorded else CHUNK_STEPS
    per_chunk = max(1, CHUNK_STEPS // length)
    for start, stop in ((0, simulation.tail_start), (simulation.tail_start, simulation.steps)):
        whole = (stop - start) // length
        for first in range(0, whole, per_chunk):
            yield Segment(start + first * length, min(per_chunk, whole - first), length, start > 0)
        if rest := (stop - start) % length:
            yield Segment(stop - rest, 1, rest, start > 0)


def window_of(steps: int, count: int) -> int:
    """The smallest multiple of WATCH_EVERY for which ``count`` windows cover the steps."""
    return WATCH_EVERY * -(-steps // (count * WATCH_EVERY))


class StepPiece(NamedTuple):
    """The last entries of a row of the table, which describe a piece of a step.

    length        in steps
    begins, ends  1 if the piece begins or ends a step, otherwise 0. The kernel reads these entries at the end of a row
    """

    length: Value
    begins: Value
    ends: Value


WHOLE_STEP = StepPiece(1.0, 1.0, 1.0)


def signal_table(
    signals: tuple[Signal, ...], simulation: Simulation, start: int, steps: int, *, in_pieces: bool = False
) -> Array:
    """Values for each step and stage, (steps, nodes * signals); the signals of the first node come first.

    A step's last node uses the limit from the left, so a jump on the grid belongs entirely to the next step. With
    ``in_pieces`` each step is split where a signal breaks: a row for each piece, with its ``StepPiece`` after the signals.
    """
    if in_pieces:  # the number of rows follows from the breaks
        return _rows(signals, simulation, start, steps, in_pieces=True)
    table = np.empty((steps, len(simulation.solver.nodes) * len(signals)))
    for first in range(0, steps, TABLE_STEPS):
        part = table[first : first + TABLE_STEPS]
        part[:] = _rows(signals, simulation, start + first, len(part), in_pieces=False)
    return table


def _rows(signals: tuple[Signal, ...], simulation: Simulation, start: int, steps: int, *, in_pieces: bool) -> Array:
    nodes = simulation.solver.nodes
    k = np.arange(start, start + steps + 1)
    t, pieces = simulation.time(k), None
    if in_pieces:
        t, k, pieces = _cut(breaks_inside(signals, simulation, start, start + steps), t, k)
    t = run_times(simulation, t)
    table = np.empty((len(t) - 1, len(nodes), len(signals)))
    for column, signal in enumerate(signals):
        values = validate.signal_values(signal, t)
        for row, node in enumerate(nodes):
            if node == 0:
                table[:, row, column] = values[:-1]
            elif node == 1:
                right = values if isinstance(signal, Continuous) else validate.signal_values(signal.before, t)
                table[:, row, column] = right[1:]
            else:
                table[:, row, column] = validate.signal_values(signal, instants(simulation, k[:-1] + node * np.diff(k)))
    rows = table.reshape(len(table), -1)
    return rows if pieces is None else np.column_stack([rows, *pieces])


def _cut(breaks: Array, t: Array, k: Array) -> tuple[Array, Array, StepPiece]:
    """The grid, t [s] and k in steps, with the breaks inserted into both, and the pieces in between."""
    step = np.searchsorted(t, breaks, side="right") - 1
    places = k[step] + (breaks - t[step]) / (t[step + 1] - t[step])
    on_grid = np.insert(np.ones(len(t)), step + 1, 0.0)
    k = np.insert(k.astype(float), step + 1, places)
    return np.insert(t, step + 1, breaks), k, StepPiece(np.diff(k), on_grid[:-1], on_grid[1:])


def final_row(signals: tuple[Signal, ...], simulation: Simulation, *, in_pieces: bool = False) -> Array:
    """A table row with the signals at t_end at every node, to evaluate the outputs there."""
    t_end = run_times(simulation, np.array([simulation.t_end]))
    values = [float(validate.signal_values(signal, t_end)[0]) for signal in signals]
    return np.array([values * len(simulation.solver.nodes) + (list(WHOLE_STEP) if in_pieces else [])])
