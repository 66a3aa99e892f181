"""Runs members together with the tangents of their states, which give the derivatives of all metrics and the instants of
extrema."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from barbalat.budget import Progress, part_of
from barbalat.protocols import Signal
from barbalat.run.engine.engine import Batch, advance
from barbalat.run.kernel.grid import WHOLE_STEP, Segment, final_row, signal_table
from barbalat.run.kernel.members import Members
from barbalat.run.kernel.tangent_step import TangentTotals, with_tangents
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

Signals = tuple[Signal, ...]


@dataclass(frozen=True, eq=False)
class SignalSlope:
    """The derivative of all signals with respect to one number: a combination of central differences.

    pairs  signals with a larger and with a smaller number, and the factor of their difference [1/unit of the number]
    """

    pairs: tuple[tuple[Signals, Signals, float], ...]

    def of(self, table: Callable[[Signals], Array]) -> Array:
        """The derivative of rows of signals, which ``table`` computes."""
        return np.sum([factor * (table(above) - table(below)) for above, below, factor in self.pairs], axis=0)


@dataclass(frozen=True, eq=False)
class Direction:
    """The derivative of the kernel's arguments with respect to one number of the case, for M members.

    parameters (p, M), states (size, M); history (m, M) with a delay
    signals  slopes of the signals of all members; None if the signals do not change
    """

    parameters: Array
    states: Array
    history: Array | None = None
    signals: SignalSlope | None = None


@dataclass(frozen=True, eq=False)
class TangentRun:
    """Metrics of M members by name (see ``Metrics.columns``); NaN for a member that diverged.

    values    (M,) by name
    tangents  (directions, M) by name
    instants  (M,) [s] keyed by name: when an extremum occurs; NaN for other metrics
    diverged  (M,) truth values
    """

    values: dict[str, Array]
    tangents: dict[str, Array]
    instants: dict[str, Array]
    diverged: Array


def run_tangents(
    members: Members,
    signals: Signals,
    directions: Sequence[Direction] = (),
    *,
    threads: int | None = None,
    progress: Progress | None = None,
) -> TangentRun:
    """Run all members from 0 to t_end with their tangents. Raises InputError for variable steps, and for code that has no
    derivative.

    The metrics are those of the run without tangents, bit for bit. Directions that do not change signals run side by side, one in
    each lane, with the run repeated in each lane: lanes cost less than further directions in one lane.
    """
    if not directions:
        return _run(members, signals, None, threads, progress)
    count, alone = len(members), [one for one in directions if one.signals is None]
    groups = [[one] for one in directions if one.signals is not None] + ([alone] if alone else [])
    found: dict[int, tuple[TangentRun, slice]] = {}
    for i, group in enumerate(groups):
        told = part_of(progress, i / len(groups), 1 / len(groups))
        every = members.some(np.tile(np.arange(count), len(group)))
        run = _run(every, signals, _together(group), threads, told)
        found |= {id(one): (run, slice(k * count, (k + 1) * count)) for k, one in enumerate(group)}
    each = [found[id(one)] for one in directions]
    first, which = each[0]
    return TangentRun(
        values={name: values[which] for name, values in first.values.items()},
        tangents={name: np.array([run.tangents[name][0, at] for run, at in each]) for name in first.values},
        instants={name: values[which] for name, values in first.instants.items()},
        diverged=first.diverged[which],
    )


def _together(directions: Sequence[Direction]) -> Direction:
    """Combine the directions of several sets of members into one."""
    if len(directions) == 1:
        return directions[0]
    histories = [one.history for one in directions if one.history is not None]
    return Direction(
        np.concatenate([one.parameters for one in directions], axis=1),
        np.concatenate([one.states for one in directions], axis=1),
        np.concatenate(histories, axis=1) if histories else None,
    )


def _run(
    members: Members, signals: Signals, direction: Direction | None, threads: int | None, progress: Progress | None
) -> TangentRun:
    """Run all members, each with its tangent along one direction, or with the instants of extrema alone."""
    simulation, size, directions = members.simulation, members.loop.size, [] if direction is None else [direction]
    try:
        program = with_tangents(members.program, len(directions))
    except ValueError as error:
        raise InputError(f"the run has no tangents: {error}") from None
    history = members.history
    if history is not None:
        history = np.vstack([history, *(_or_zero(one.history, history) for one in directions)])
    count = len(members)
    given = replace(
        members,
        program=program,
        states=np.vstack([members.states, *(one.states for one in directions), np.zeros((1, count))]),
        parameters=np.vstack([members.parameters, *(one.parameters for one in directions)]),
        history=history,
        windows=0,
    )
    batch = Batch.part(given, slice(0, count))
    table = _Tables(signals, simulation, direction, in_pieces=program.shape.in_pieces)
    advance([batch], table.rows, table.last, simulation, threads=threads, progress=progress)
    totals = batch.totals
    assert isinstance(totals, TangentTotals)
    flat = np.concatenate([group.state[:, : group.columns.stop - group.columns.start] for group in batch.groups], axis=1)
    final = np.array([flat[(d + 1) * size : (d + 2) * size][members.loop.theta_hat_rows] for d in range(len(directions))])
    tangents, instants = totals.tangents(simulation, final)
    by_direction, values = [one.columns() for one in tangents], batch.metrics(simulation).columns()
    del values["diverged_at"]
    return TangentRun(
        values=values,
        tangents={name: np.array([one[name] for one in by_direction]).reshape(len(directions), count) for name in values},
        instants={name: one for name, one in instants.columns().items() if name in values},
        diverged=~np.isnan(batch.diverged_step),
    )


def _or_zero(one: Array | None, like: Array) -> Array:
    return np.zeros_like(like) if one is None else one


@dataclass(frozen=True, eq=False)
class _Tables:
    """The rows of signals with their tangents, see ``grid.signal_table``."""

    signals: Signals
    simulation: Simulation
    direction: Direction | None
    in_pieces: bool

    def rows(self, segment: Segment) -> Array:
        return self._with_tangents(
            lambda signals: signal_table(signals, self.simulation, segment.start, segment.steps, in_pieces=self.in_pieces)
        )

    def last(self) -> Array:
        return self._with_tangents(lambda signals: final_row(signals, self.simulation, in_pieces=self.in_pieces))

    def _with_tangents(self, table: Callable[[Signals], Array]) -> Array:
        own = table(self.signals)
        if self.direction is None:
            return own
        count, slope = own.shape[1] - (len(WHOLE_STEP) if self.in_pieces else 0), self.direction.signals
        moved = np.zeros((len(own), count)) if slope is None else slope.of(table)[:, :count]
        return np.ascontiguousarray(np.column_stack([own[:, :count], moved, own[:, count:]]))
