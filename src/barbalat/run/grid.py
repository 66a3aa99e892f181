"""The time grid of a run: steps, blocks of steps, the tail, and the table of the signals on it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from barbalat import validate
from barbalat.lowering.shape import WATCH_EVERY
from barbalat.protocols import Signal
from barbalat.signals.smooth import Continuous
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

CHUNK_STEPS = 32_768
"""Steps between two calls of the kernel: long enough to hide the call, a table short enough for the cache."""


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
    """The run cut into kernel calls; blocks never straddle the tail's start, so that figures of the tail are exact.

    A recorded run has one block between two instants that are kept; any other has one for each call.
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
    """The least multiple of WATCH_EVERY of which ``count`` hold the steps."""
    return WATCH_EVERY * -(-steps // (count * WATCH_EVERY))


def signal_table(signals: tuple[Signal, ...], simulation: Simulation, start: int, steps: int) -> Array:
    """Values for each step and stage: (steps, nodes * signals), the signals of the first node first.

    A step's last node takes the limit from the left, so that a jump on the grid belongs wholly to the next step.
    """
    nodes = simulation.solver.nodes
    table = np.empty((steps, len(nodes), len(signals)))
    k = np.arange(start, start + steps + 1)
    for column, signal in enumerate(signals):
        values = evaluate(signal, simulation.time(k))
        for row, node in enumerate(nodes):
            if node == 0:
                table[:, row, column] = values[:-1]
            elif node == 1:
                right = values if isinstance(signal, Continuous) else evaluate(signal.before, simulation.time(k))
                table[:, row, column] = right[1:]
            else:
                table[:, row, column] = evaluate(signal, simulation.time(k[:-1] + node))
    return table.reshape(steps, -1)


def final_row(signals: tuple[Signal, ...], simulation: Simulation) -> Array:
    """A table row that holds the signals at t_end for every node, to evaluate the outputs there."""
    t_end = np.array([simulation.t_end])
    values = [float(evaluate(signal, t_end)[0]) for signal in signals]
    return np.array([values * len(simulation.solver.nodes)])


def evaluate(signal: object, t: Array) -> Array:
    """The signal at these times; InputError for what is not one finite real number for each of them."""
    given = signal(t)  # type: ignore[operator]
    try:
        values = np.asarray(given)
    except (TypeError, ValueError):  # rows of different lengths, ...
        values = np.array(None)
    if values.dtype.kind not in "biuf":
        raise InputError(f"a signal must return real numbers, got {validate.show(given)}: {validate.show(signal)}")
    values = values.astype(np.float64, copy=False)
    if values.shape != t.shape:
        raise InputError(
            f"a signal must return one value for each time, got shape {values.shape} for {t.shape}: {validate.show(signal)}"
        )
    if not np.isfinite(values).all():
        i = int(np.flatnonzero(~np.isfinite(values))[0])
        raise InputError(f"a signal must be finite, got {values[i]} at t = {t[i]:g} s: {validate.show(signal)}")
    return values
