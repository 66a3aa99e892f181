"""The commands and disturbances of a page: formulas as a module, records as points, and all others as sequences of equal rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from barbalat.explorer.encoded import doubles
from barbalat.loop.packing import column, symbols
from barbalat.lowering.operations import read
from barbalat.lowering.shape import LoopShape
from barbalat.lowering.wasm.loop import loop
from barbalat.problem.faults import FaultSignal
from barbalat.protocols import BreakingSignal, InterpolatedSignal, Signal
from barbalat.run.kernel.breaks import breaks_inside, can_be_split
from barbalat.run.kernel.grid import final_row, signal_table
from barbalat.run.kernel.template import Columns, with_symbols
from barbalat.signals.smooth import Continuous
from barbalat.solvers import RK4
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

MOST_RUNS = 20_000
"""Largest number of sequences of equal rows in a page: about 500 kB."""
MOST_POINTS = 20_000
"""Largest number of points of a record in a page: about 430 kB."""
GRID_FACTORS = (0.5, 2.0, 0.25, 4.0, 0.2, 5.0, 10.0)
"""Steps that a page offers if signals jump, as multiples of the step of the case; the positions of the jumps in the grid are
tabulated for each."""
HORIZON_FACTORS = (0.5, 2.0, 0.25, 0.75, 1.5, 0.1, 3.0, 5.0)
"""Horizons that a page offers at the step of the case, as multiples of the horizon of the case."""
MOST_GRID_BYTES = 250_000
"""Largest size of these tables, which are made in the above order, without the table for the step of the case. Encoded as text in
a page, they take a third more."""


def is_formula(signal: Signal) -> bool:
    """Whether a page's module computes the signal. This requires a formula in t and the numbers of the signal, without jumps."""
    if not isinstance(signal, Continuous) or isinstance(signal, InterpolatedSignal):
        return False
    try:
        _, t = symbols("t", 1)
        (opened,), _ = _opened((signal,))
        return isinstance(opened(t), type(t))
    except (TypeError, ValueError, RuntimeError):  # code that converts a symbol to a float or branches on it is not a formula
        return False


def is_computed(signal: Signal) -> bool:
    """Whether a page computes the signal's values. It does so for formulas, records and faults; for others it stores rows."""
    return isinstance(signal, (InterpolatedSignal, FaultSignal)) or is_formula(signal)


def points_of(signal: Signal, longest: float) -> dict[str, str] | None:
    """Return the points of a record for a page's JSON, up to the first after ``longest`` [s]; None for any other signal.

    Raises InputError if there are more points than a page can contain.
    """
    if not isinstance(signal, InterpolatedSignal):
        return None
    times, values = (np.asarray(part, dtype=float) for part in signal.interpolation_points)
    kept = min(len(times), int(np.searchsorted(times, longest)) + 1)
    if kept > MOST_POINTS:
        raise InputError(
            f"the command or a disturbance has {kept} recorded points within the longest time span of a page, but a page can "
            f"hold only {MOST_POINTS}: record fewer points, or use barbalat run"
        )
    return {"times": doubles(times[:kept]), "values": doubles(values[:kept])}


def breaks_anywhere(signals: Sequence[Signal]) -> bool:
    """Whether the signals have breaks, so that the grid of steps must be computed beforehand."""
    return any(isinstance(signal, (BreakingSignal, InterpolatedSignal)) or not is_computed(signal) for signal in signals)


def smooth_module(signals: Sequence[Signal]) -> tuple[bytes, Array]:
    """Return a module whose blocks compute the values of the formulas at the time in a row, and the numbers of the formulas,
    which are its parameters."""
    import casadi as ca

    smooth = tuple(signal for signal in signals if is_formula(signal))
    numbers = np.concatenate([np.zeros(0), *(leaf.reshape(-1) for leaf in Columns(smooth).leaves)])
    time_column, t = symbols("t", 1)
    opened, parameter_column = _opened(smooth)
    values = [ca.SX(column(signal(t))) for signal in opened]
    nothing = ca.SX(0, 1)
    inputs = [nothing, nothing, parameter_column, time_column, nothing, nothing]
    traced = ca.Function("signals", inputs, [nothing, ca.vertcat(nothing, *values), nothing])
    shape = LoopShape(0, len(smooth), len(numbers), 1)
    return loop(read(traced), shape, (0.0,) * len(smooth)), numbers


def _opened(signals: tuple[Signal, ...]) -> tuple[tuple[Any, ...], Any]:
    """Return the signals with symbols in place of their numbers, and the column of these symbols, in the order of
    ``Columns``."""
    column, parameters = symbols("parameters", sum(leaf.size for leaf in Columns(signals).leaves))
    return with_symbols(signals, iter(list(parameters))), column


@dataclass(frozen=True, eq=False)
class Grid:
    """A run's steps, with the jumps of signals.

    cuts    (K, 3) the breaks inside steps: the step, the position within it, the time [s]
    starts  rows at which the values of the signals that are not computed change
    values  (len(starts), nodes * signals) values of these signals from each of these rows on
    last    (signals,) values of these signals at t_end
    """

    simulation: Simulation
    cuts: Array
    starts: Array
    values: Array
    last: Array

    @property
    def bytes(self) -> int:
        return int(self.cuts.nbytes + self.starts.nbytes + self.values.nbytes)

    def as_data(self) -> dict[str, Any]:
        """For a page's JSON."""
        return {
            "dt": self.simulation.dt, "t_end": self.simulation.t_end, "cuts": doubles(self.cuts), "starts": self.starts.tolist(),
            "values": doubles(self.values), "last": doubles(self.last),
        }  # fmt: skip

    @classmethod
    def of(cls, signals: tuple[Signal, ...], simulation: Simulation, *, whole: bool = False) -> Grid:
        """Return the grid of a simulation.

        Raises InputError if a signal that a page does not compute has more different rows than a page can contain.

        whole  steps are not split at breaks, as for steps with a memory
        """
        in_pieces = not whole and can_be_split(signals, simulation)
        table = signal_table(signals, simulation, 0, simulation.steps, in_pieces=in_pieces)
        nodes = len(simulation.solver.nodes)
        kept = table[:, : nodes * len(signals)].reshape(len(table), nodes, len(signals))
        kept = kept[:, :, [not is_computed(signal) for signal in signals]].reshape(len(table), -1)
        starts = np.concatenate([[0], 1 + np.flatnonzero((kept[1:] != kept[:-1]).any(axis=1))]) if kept.shape[1] else np.zeros(1)
        if len(starts) > MOST_RUNS:
            raise InputError(
                f"the command or a disturbance takes {len(starts)} different values, but a page can hold only {MOST_RUNS}: give "
                f"it as a smooth signal or as one that jumps, or use barbalat run"
            )
        starts = starts.astype(int)
        cuts = np.zeros((0, 3))
        if in_pieces:
            instants = breaks_inside(signals, simulation, 0, simulation.steps)
            grid = simulation.time(np.arange(simulation.steps + 1))
            step = np.searchsorted(grid, instants, side="right") - 1
            places = step + (instants - grid[step]) / (grid[step + 1] - grid[step])
            cuts = np.column_stack([step, places, instants])
        last = final_row(signals, simulation)[0, : len(signals)][[not is_computed(signal) for signal in signals]]
        return cls(simulation, cuts, starts, kept[starts], last)


def grids_of(signals: tuple[Signal, ...], simulation: Simulation, *, whole: bool, most_steps: int) -> list[Grid]:
    """Return grids for this run and for runs with a different step or horizon, all for the same kind of kernel.

    The kernel either splits steps into pieces or, with ``whole``, does not.

    Raises InputError if the run's own grid has too many rows.
    """
    simulation = replace(simulation, solver=RK4)  # the nodes of RK4 include the nodes of all methods
    own = Grid.of(signals, simulation, whole=whole)
    found, room = [own], MOST_GRID_BYTES
    for other in _runs_offered(simulation):
        try:
            grid = Grid.of(signals, other, whole=whole)
        except InputError:  # too many rows
            continue
        if other.steps <= most_steps and bool(len(grid.cuts)) == bool(len(own.cuts)) and grid.bytes <= room:
            found.append(grid)
            room -= grid.bytes
    return found


def _runs_offered(simulation: Simulation) -> Iterator[Simulation]:
    """Yield the run with different steps and with different horizons, as far as the step divides the horizon."""
    steps = [(factor * simulation.dt, simulation.t_end) for factor in GRID_FACTORS]
    for dt, t_end in [*steps, *((simulation.dt, factor * simulation.t_end) for factor in HORIZON_FACTORS)]:
        try:
            yield replace(simulation, dt=float(f"{dt:.12g}"), t_end=float(f"{t_end:.12g}"))
        except InputError:  # the horizon is not a whole number of steps
            continue
