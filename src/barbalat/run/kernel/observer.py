"""Computes the metrics and the judge's memory of a motion with dense output, from nodes of that output.

The kernel is an ordinary kernel with steps in pieces: a piece extends between two nodes, and a step between two recorded
instants. An extremum between nodes is taken from the parabola through three nodes without a corner or jump in between; squares
are integrated by Simpson's rule over the nodes of each integration step.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from barbalat.judge.appended import Given, Watched, joined
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import Outputs, column, symbols
from barbalat.loop.true_values import estimate_set
from barbalat.lowering.operations import Program, read
from barbalat.lowering.optimize import optimize
from barbalat.lowering.shape import LoopShape
from barbalat.protocols import Value
from barbalat.run.kernel.metrics import divergence_measure
from barbalat.run.kernel.sampled_controller import parameters_column
from barbalat.run.kernel.step import StepProgram, accumulators_of

PIECE = 3
"""Entries at the end of a row that describe the piece of a step: its length, and whether it begins or ends a step."""
HELD_BACK = 1e-3
"""A rate limiter counts as active if it moves at its limit for longer than this fraction of the time between two recorded
instants."""
OBSERVED = ("e", "u", "theta_hat", "y")
"""The signals whose extrema are kept."""


class NodeRow(NamedTuple):
    """A row of the table: the signals at a node, the state at the next node, and the node's weights.

    weight  weight of the squares at the node, in steps
    smooth  1 if the trajectory has no corner at the node, -1 if the node ends a piece. The motion from there to the next node,
            which is at the same instant, then belongs to the metrics of the next node
    apart   1 if everything before the node belongs to other metrics
    """

    signals: Value
    following: Value
    weight: Value
    smooth: Value
    apart: Value
    piece: Value

    @classmethod
    def of(cls, loop: ClosedLoop, row: Value) -> NodeRow:
        """The parts of a row, whose length is ``row_length``."""
        driving, size = loop.signal_count, loop.size
        weight, smooth, apart = row[driving + size : driving + size + 3]
        return cls(row[:driving], row[driving : driving + size], weight, smooth, apart, row[-PIECE:])


def row_length(loop: ClosedLoop) -> int:
    """Entries of a row."""
    return loop.signal_count + loop.size + 3 + PIECE


class Turn(NamedTuple):
    """The stored data of the previous two nodes: for each node the quantities (Q,), the time to the next node, and whether the
    node is smooth. All zeros at the start."""

    last: Value
    before: Value
    since_last: Value
    since_before: Value
    smooth: Value
    smooth_before: Value

    @classmethod
    def of(cls, flat: Value) -> Turn:
        """The parts of the stored data, (2 Q + 4,)."""
        count = (flat.shape[0] - 4) // 2
        return cls(flat[:count], flat[count : 2 * count], *flat[2 * count :])

    def vertex(self, now: Value, smooth_now: Value) -> tuple[Value, Value]:
        """The extrema of the quantities near the last node, or the present values if there is none, and by how much an
        extremum exceeds the values at the nodes.

        For an extremum between the last node and a node that is not smooth (where a piece begins or ends), the parabola around
        the latter node is not used.
        """
        first = (self.last - self.before) / np.where(self.since_before > 0, self.since_before, 1.0)
        second = (now - self.last) / np.where(self.since_last > 0, self.since_last, 1.0)
        span = self.since_last + self.since_before
        bend = (second - first) / np.where(span > 0, span, 1.0)
        slope = first + bend * self.since_before
        begins = _where(slope * (first - bend * self.since_before) < 0, self.smooth_before <= 0)
        ends = _where(slope * (second + bend * self.since_last) < 0, smooth_now <= 0)
        turns = np.where(first * second < 0, 1.0, np.maximum(begins, ends)) * np.where(self.smooth > 0, 1.0, 0.0) > 0
        farther = np.where(turns, -slope * slope / (4 * np.where(turns, bend, 1.0)), 0.0 * bend)
        vertex = np.where(turns, self.last + farther, now)
        nearer = np.minimum(np.abs(farther), np.minimum(_beyond(vertex, self.before, begins), _beyond(vertex, now, ends)))
        return vertex, np.where(turns, nearer, 0.0 * bend)


def _where(condition: Value, other: Value) -> Value:
    """1 if both conditions hold, otherwise 0."""
    return np.where(condition, 1.0, 0.0) * np.where(other, 1.0, 0.0)


def _beyond(vertex: Value, node: Value, counts: Value) -> Value:
    """The distance of the extremum from a node's value, if it counts."""
    return np.where(counts > 0, np.abs(vertex - node), np.inf)


def observer_program(
    loop: ClosedLoop, dt: float, watched: Watched | None, *, fused: bool, parameters: Any = None
) -> tuple[StepProgram, int]:
    """The kernel's program, and the number of entries that it stores after the judge's memory; ``parameters`` as in
    ``Attempts``."""
    import casadi as ca

    memory = None if watched is None else watched.memory(loop)
    rows, size = 0 if memory is None else len(memory.begins), loop.size
    remembered = 2 * (loop.errors + loop.inputs + loop.parameters + loop.measured_outputs) + 4
    state_column, carried = symbols("state", size + rows + remembered)
    row_column, flat = symbols("signals", row_length(loop))
    row, turn = NodeRow.of(loop, flat), Turn.of(carried[size + rows :])
    state, following = (flat if loop.sampled else loop.limit(flat) for flat in (carried[:size], row.following))
    accumulators = accumulators_of(loop)
    old_column, old = symbols("accumulators", len(accumulators.resets))
    outputs = loop.outputs(state, row.signals)
    now = _observed(outputs)
    vertex, farther = turn.vertex(now, row.smooth)
    kept = 1.0 - row.apart
    turning = _parts(loop, np.where(kept > 0, vertex, now))
    known = estimate_set(loop)
    if known is not None:
        turning["theta_hat"] = known.limit(turning["theta_hat"])
    now_hat, next_hat = (loop.theta_hat(loop.unpack(flat).controller) for flat in (state, following))
    last_hat = _parts(loop, turn.last)["theta_hat"]
    moved = np.where(row.smooth < 0, 0.0, np.abs(next_hat - now_hat)) + np.where(turn.smooth < 0, np.abs(now_hat - last_hat), 0.0)
    moved = moved + 2 * kept * _parts(loop, farther)["theta_hat"]
    length, _, ends = row.piece
    new = accumulators.update(
        old, outputs, divergence_measure(loop, outputs, following), following, moved,
        begins=row.weight, ends=ends, turning=turning,
    )  # fmt: skip
    others = (length, turn.since_last, row.smooth, turn.smooth)
    remembers = np.concatenate([now, turn.last, *(np.reshape(value, 1) for value in others)])
    nothing = ca.SX(0, 1)
    arguments = parameters_column(parameters)
    inputs = [state_column, old_column, arguments, row_column, nothing, nothing]
    results = [following, new, None, outputs.e, outputs.u, remembers]
    traced = ca.Function("observe", inputs, [ca.SX(0, 1) if value is None else column(value) for value in results], {"cse": True})
    program = optimize(read(traced), fused=fused)
    errors, demands, turns = program.outputs[3:]
    program = Program(program.operations, program.outputs[:3])
    if watched is not None and memory is not None:
        given = Given(errors, demands, row_length(loop), PIECE, HELD_BACK * dt, parameters)
        program = joined(program, loop, memory, given)
    program = Program(program.operations, ((*program.outputs[0], *turns), *program.outputs[1:]))
    shape = LoopShape(size + rows + remembered, len(accumulators.resets), arguments.numel(), row_length(loop), in_pieces=True)
    return StepProgram(program, shape, accumulators, memory=memory), remembered


def _observed(outputs: Outputs) -> Value:
    return np.concatenate([getattr(outputs, name).reshape(-1) for name in OBSERVED])


def _parts(loop: ClosedLoop, flat: Value) -> dict[str, Value]:
    sizes = (loop.errors, loop.inputs, loop.parameters, loop.measured_outputs)
    found, start = {}, 0
    for name, size in zip(OBSERVED, sizes, strict=True):
        found[name] = flat[start : start + size]
        start += size
    return found
