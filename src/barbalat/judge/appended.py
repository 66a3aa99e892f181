"""The judge's operations, which are appended to those of a kernel's step. They read its results and do not change them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barbalat.judge.memory import Memory, Sample
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import column, symbols, together
from barbalat.lowering.operations import Operation, Program, following, read
from barbalat.lowering.optimize import optimize
from barbalat.protocols import Value

if TYPE_CHECKING:
    import casadi as ca

STATE, MEMORY, PARAMETERS, SIGNALS, PAST, NOISE, ERROR, DEMAND = range(8)
"""Arguments of the judge's operations: those of a step, with the memory in place of the accumulators, and values that the step
has already computed."""
ARRIVED = 1e-3
"""Fraction of a control's range. A rate limiter that is this close to the control's limit counts as having arrived, because it
approaches the limit exponentially."""


class Given(NamedTuple):
    """The values that a kernel's step gives to the judge in addition to states and signals.

    errors, demands  positions of e and of u among the step's operations
    pieces           whether a step may be divided into pieces; a row of signals then ends with three numbers, of which the first
                     is the length of the piece
    dt               length of the step [s], or a symbol
    parameters       CasADi's column of the loop's symbols, or None
    """

    errors: tuple[int, ...]
    demands: tuple[int, ...]
    row: int
    pieces: int
    dt: Value
    parameters: ca.SX | None


@dataclass(frozen=True)
class Watched:
    """The settings of a run's memory that do not depend on the loop (see ``Memory``)."""

    hysteresis: float
    weighed: bool = False
    detailed: bool = False
    gains: tuple[tuple[float, ...], ...] = ()
    bands: tuple[float, ...] = ()
    settles: float = 0.05

    def memory(self, loop: ClosedLoop) -> Memory:
        """Return the memory for this loop."""
        return Memory(
            components=loop.errors,
            inputs=loop.inputs,
            commands=loop.commands or 1,
            limited=tuple(path is not None and path.saturation is not None for path in loop.paths),
            rate_limited=tuple(path is not None and path.rate_limit is not None for path in loop.paths),
            **vars(self),
        )


def sample_of(loop: ClosedLoop, flat: Value, signals: Value, dt: Value, u: Value, e: Value, steps: Value) -> Sample:
    """Return the judge's sample of a loop's state and of the signals that drive it. u and e are already computed."""
    state, given = loop.unpack(flat), loop.signals.named(signals)
    limited, at_limit, at_rate_limit = [], [], []
    for i, path in enumerate(loop.paths):
        asked = u[i] if path is None else path.asked(u[i])
        beyond: Value = 0.0
        held_back: Value = 0.0
        if path is not None and path.saturation is not None:
            low, high = path.saturation
            beyond = np.where(u[i] >= high, 1.0, np.where(u[i] <= low, 1.0, 0.0))
        if path is not None and path.rate_limit is not None:
            actual = state.input[i].limited[0]
            behind = np.abs(asked - actual)
            held_back = np.where(behind >= path.rate_limit * dt, 1.0, 0.0)
            if path.saturation is not None:  # on its way to the limit only the rate limit is active
                beyond = beyond * np.where(behind <= ARRIVED * (high - low), 1.0, 0.0)
            asked = actual
        limited.append(asked)
        at_limit.append(beyond)
        at_rate_limit.append(held_back)
    return Sample(
        y=loop.followed(state, given),
        y_m=loop.model.output(state.x_m).reshape(-1),
        e=e,
        u=u,
        limited=together(limited),
        at_limit=together(at_limit),
        at_rate_limit=together(at_rate_limit),
        r=together([given.r]) if loop.commands is None else given.r,
        steps=steps,
    )


def ranges_of(loop: ClosedLoop) -> Value:
    """Return upper - lower of each input's limits (m,); 1 without limits."""
    limits = [None if path is None else path.saturation for path in loop.paths]
    return together([1.0 if found is None else found[1] - found[0] for found in limits])


def update_function(loop: ClosedLoop, memory: Memory, given: Given) -> ca.Function:
    """Return the operations as a CasADi function of (state, memory, parameters, signals, past, noise, e, u) -> memory."""
    import casadi as ca

    state_column, state = symbols("state", loop.size)
    memory_column, old = symbols("memory", len(memory.begins))
    row_column, row = symbols("signals", given.row)
    noise_column, noise = symbols("noise", loop.signals.noise)
    error_column, e = symbols("e", loop.errors)
    demand_column, u = symbols("u", loop.inputs)
    signals = np.concatenate([row[: loop.signals.timed], noise, np.zeros(loop.signals.delayed)])
    steps = row[-given.pieces] if given.pieces else 1.0
    new = memory.update(old, sample_of(loop, state, signals, given.dt, u, e, steps), ranges_of(loop))
    parameters = ca.SX(0, 1) if given.parameters is None else given.parameters
    inputs = [state_column, memory_column, parameters, row_column, ca.SX(0, 1), noise_column, error_column, demand_column]
    return ca.Function("judge", inputs, [column(new)], {"cse": True})


def joined(step: Program, loop: ClosedLoop, memory: Memory, given: Given) -> Program:
    """Return the step with the memory appended to its states. The step's operations keep their order and precede those of the
    judge."""
    judge = optimize(read(update_function(loop, memory, given)), fused=False)
    first = len(step.outputs[0])

    def placed(op: Operation) -> Operation:
        argument, entry = op.source
        return op._replace(source=(STATE, first + entry)) if op.name == "input" and argument == MEMORY else op

    judge = Program(tuple(placed(op) for op in judge.operations), judge.outputs)
    places = {(ERROR, i): place for i, place in enumerate(given.errors)}
    places |= {(DEMAND, i): place for i, place in enumerate(given.demands)}
    both = following(step.operations, judge, places)
    states, *others = step.outputs
    return Program(both.operations, ((*states, *both.outputs[0]), *others))


def unchanged(sample: Program, states: int, rows: int) -> Program:
    """Return a sampled controller's operations before a step, extended so that they do not change the memory that follows the
    states."""
    count = len(sample.operations)
    inputs = tuple(Operation("input", source=(STATE, states + i)) for i in range(rows))
    (state,) = sample.outputs
    return Program((*sample.operations, *inputs), ((*state, *range(count, count + rows)),))
