"""The time grid of a run: steps, blocks of steps, the tail, and the table of the signals on it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from barbalat import validate
from barbalat.protocols import Signal
from barbalat.signals.smooth import Continuous
from barbalat.solvers import RK4, Tableau
from barbalat.validate import Array, InputError

CHUNK_STEPS = 32_768
"""Steps between two calls of the kernel: long enough to hide the call, a table short enough for the cache."""


@dataclass(frozen=True, kw_only=True)
class Simulation:
    """How to simulate: fixed steps of ``dt`` [s] from 0 to ``t_end`` [s].

    solver         a Tableau: EULER, HEUN, RK4
    record_points  about how many instants of a trajectory are kept; figures are over every step all the same

    Raises InputError where dt does not divide t_end.
    """

    t_end: float
    dt: float
    solver: Tableau = RK4
    record_points: int = 2000
    steps: int = field(init=False)

    def __post_init__(self) -> None:
        t_end = validate.positive("simulation.t_end", self.t_end)
        dt = validate.positive("simulation.dt", self.dt)
        validate.instance("simulation.solver", self.solver, Tableau)
        record_points = validate.whole("simulation.record_points", self.record_points, least=2)
        ratio = t_end / dt
        if ratio > 1e12:  # a day of computing on one core: surely a slip of the pen
            raise InputError(f"simulation.dt = {dt:g} makes {ratio:.3g} steps up to t_end = {t_end:g}; at most 1e12 are possible")
        steps = round(ratio)
        if steps < 1 or abs(steps * dt - t_end) > 1e-9 * t_end:
            nearest = t_end / max(steps, 1)
            raise InputError(
                f"simulation.dt must divide simulation.t_end, but {t_end:g} / {dt:g} = {ratio:.9g}; {nearest!r} would"
            )
        object.__setattr__(self, "t_end", t_end)
        object.__setattr__(self, "dt", dt)
        object.__setattr__(self, "record_points", record_points)
        object.__setattr__(self, "steps", steps)

    def time(self, step: Array | float) -> Array:
        """The instant of a step, or of a fraction between two; exact where t_end is a whole number of seconds."""
        return np.asarray(step) * self.t_end / self.steps

    @property
    def tail_start(self) -> int:
        """The step at which the tail, the last quarter of [0, t_end], begins."""
        return self.steps - self.steps // 4


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


def signal_table(signals: tuple[Signal, ...], simulation: Simulation, start: int, steps: int) -> Array:
    """Values for each step and stage: (steps, nodes * signals), the signals of the first node first.

    A step's last node takes the limit from the left, so that a jump on the grid belongs wholly to the next step.
    """
    nodes = simulation.solver.nodes
    table = np.empty((steps, len(nodes), len(signals)))
    k = np.arange(start, start + steps + 1)
    for column, signal in enumerate(signals):
        values = _evaluate(signal, simulation.time(k))
        for row, node in enumerate(nodes):
            if node == 0:
                table[:, row, column] = values[:-1]
            elif node == 1:
                right = values if isinstance(signal, Continuous) else _evaluate(signal.before, simulation.time(k))
                table[:, row, column] = right[1:]
            else:
                table[:, row, column] = _evaluate(signal, simulation.time(k[:-1] + node))
    return table.reshape(steps, -1)


def final_row(signals: tuple[Signal, ...], simulation: Simulation) -> Array:
    """A table row that holds the signals at t_end for every node, to evaluate the outputs there."""
    t_end = np.array([simulation.t_end])
    values = [float(_evaluate(signal, t_end)[0]) for signal in signals]
    return np.array([values * len(simulation.solver.nodes)])


def _evaluate(signal: object, t: Array) -> Array:
    values = np.asarray(signal(t), dtype=np.float64)  # type: ignore[operator]
    if values.shape != t.shape:
        raise InputError(
            f"a signal must return one value for each time, got shape {values.shape} for {t.shape}: {validate.show(signal)}"
        )
    if not np.isfinite(values).all():
        i = int(np.flatnonzero(~np.isfinite(values))[0])
        raise InputError(f"a signal must be finite, got {values[i]} at t = {t[i]:g} s: {validate.show(signal)}")
    return values
