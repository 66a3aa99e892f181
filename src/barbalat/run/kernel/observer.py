"""What is kept of a motion that is known at any instant: figures and the judge's memory, from nodes of the dense output.

The kernel is an ordinary one whose steps come in pieces: a piece lies between two nodes, and a step between two instants of
the record. Where a quantity turns between nodes, its extremum is that of the parabola through three of them; squares are
integrated by Simpson's rule over the nodes of each step of the integration.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from barbalat.judge.beside import Given, Watched, joined
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import Outputs, column, symbols
from barbalat.loop.true_values import estimate_set
from barbalat.lowering.operations import Program, read
from barbalat.lowering.optimize import optimize
from barbalat.lowering.shape import LoopShape
from barbalat.protocols import Value
from barbalat.run.kernel.metrics import divergence_measure
from barbalat.run.kernel.step import StepProgram, accumulators_of

PIECE = 3
"""Entries at a row's end that say which piece of a step it is: its length, whether it begins and ends one."""
OBSERVED = ("e", "u", "theta_hat", "y")
"""Whose extrema are kept."""


class NodeRow(NamedTuple):
    """A row of the table: the signals at a node, the state at the next one, and what the node counts for.

    weight  of the squares at it, in steps
    smooth  1 where the motion has no corner at it
    apart   1 where what lies before it belongs to other figures
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
    """What is remembered of the two nodes before: the quantities (Q,) at each, how long after each the next one came, and whether
    the later one is smooth. All zeros at the start."""

    last: Value
    before: Value
    since_last: Value
    since_before: Value
    smooth: Value

    @classmethod
    def of(cls, flat: Value) -> Turn:
        """The parts of what is remembered, (2 Q + 3,)."""
        count = (flat.shape[0] - 3) // 2
        return cls(flat[:count], flat[count : 2 * count], *flat[2 * count :])

    def vertex(self, now: Value) -> tuple[Value, Value]:
        """The quantities' extrema near the last node, or their values there; and by how much farther they are."""
        first = (self.last - self.before) / np.where(self.since_before > 0, self.since_before, 1.0)
        second = (now - self.last) / np.where(self.since_last > 0, self.since_last, 1.0)
        span = self.since_last + self.since_before
        bend = (second - first) / np.where(span > 0, span, 1.0)
        slope = first + bend * self.since_before
        turns = np.where(first * second < 0, 1.0, 0.0) * np.where(self.smooth > 0, 1.0, 0.0) > 0
        farther = np.where(turns, -slope * slope / (4 * np.where(turns, bend, 1.0)), 0.0 * bend)
        return self.last + farther, np.abs(farther)


def observer_program(loop: ClosedLoop, dt: float, watched: Watched | None, *, fused: bool) -> tuple[StepProgram, int]:
    """The kernel's program, and how many entries it remembers behind the judge's memory."""
    import casadi as ca

    memory = None if watched is None else watched.memory(loop)
    rows, size = 0 if memory is None else len(memory.begins), loop.size
    remembered = 2 * (loop.errors + loop.inputs + loop.parameters + loop.measured_outputs) + 3
    state_column, carried = symbols("state", size + rows + remembered)
    row_column, flat = symbols("signals", row_length(loop))
    row, turn = NodeRow.of(loop, flat), Turn.of(carried[size + rows :])
    state, following = (flat if loop.sampled else loop.limit(flat) for flat in (carried[:size], row.following))
    accumulators = accumulators_of(loop)
    old_column, old = symbols("accumulators", len(accumulators.resets))
    outputs = loop.outputs(state, row.signals)
    now = _observed(outputs)
    vertex, farther = turn.vertex(now)
    kept = 1.0 - row.apart
    turning = _parts(loop, np.where(kept > 0, vertex, now))
    known = estimate_set(loop)
    if known is not None:
        turning["theta_hat"] = known.limit(turning["theta_hat"])
    now_hat, next_hat = (loop.theta_hat(loop.unpack(flat).controller) for flat in (state, following))
    moved = np.abs(next_hat - now_hat) + 2 * kept * _parts(loop, farther)["theta_hat"]
    length, _, ends = row.piece
    new = accumulators.update(
        old, outputs, divergence_measure(loop, outputs, following), following, moved,
        begins=row.weight, ends=ends, turning=turning,
    )  # fmt: skip
    three = np.concatenate([np.reshape(value, 1) for value in (length, turn.since_last, row.smooth)])
    remembers = np.concatenate([now, turn.last, three])
    nothing = ca.SX(0, 1)
    inputs = [state_column, old_column, nothing, row_column, nothing, nothing]
    results = [following, new, None, outputs.e, outputs.u, remembers]
    traced = ca.Function("observe", inputs, [ca.SX(0, 1) if value is None else column(value) for value in results], {"cse": True})
    program = optimize(read(traced), fused=fused)
    errors, demands, turns = program.outputs[3:]
    program = Program(program.operations, program.outputs[:3])
    if watched is not None and memory is not None:
        given = Given(errors, demands, row_length(loop), PIECE, dt, None)
        program = joined(program, loop, memory, given)
    program = Program(program.operations, ((*program.outputs[0], *turns), *program.outputs[1:]))
    shape = LoopShape(size + rows + remembered, len(accumulators.resets), 0, row_length(loop), in_pieces=True)
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
