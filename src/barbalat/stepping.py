"""From a closed loop to a compiled kernel: one solver step with the figures' accumulators, traced once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from barbalat.closed_loop import ClosedLoop, column, symbols
from barbalat.lowering.machine import Kernel
from barbalat.lowering.operations import Program, read
from barbalat.lowering.optimize import optimize
from barbalat.lowering.shape import TAPS, LoopShape
from barbalat.metrics import Accumulators
from barbalat.protocols import Value
from barbalat.solvers import Tableau

if TYPE_CHECKING:
    import casadi as ca


@dataclass(frozen=True)
class StepProgram:
    """One step as an operation list; compile it for a number of lanes."""

    program: Program
    shape: LoopShape
    accumulators: Accumulators | None

    def compile(self, lanes: int) -> Kernel:
        resets = () if self.accumulators is None else self.accumulators.resets
        return _compile(self.program, self.shape, resets, lanes)


@lru_cache(maxsize=64)
def _compile(program: Program, shape: LoopShape, resets: tuple[float, ...], lanes: int) -> Kernel:
    return Kernel(program, shape, resets, lanes)


def step_function(
    loop: ClosedLoop,
    solver: Tableau,
    dt: float,
    parameters: ca.SX | None = None,
    *,
    delay_weights: Value = None,
    figures: bool = True,
) -> tuple[ca.Function, Accumulators | None]:
    """The step as a CasADi function (state, accumulators, parameters, signals) -> (state, accumulators), and its accumulators.

    With a delay, for which ``delay_weights`` (nodes, TAPS) stand, also past -> what to remember. ``loop`` and the weights may
    hold symbols; ``parameters`` is then their CasADi column. Without ``figures`` there are no accumulators.
    """
    import casadi as ca

    state_column, state = symbols("state", loop.size)
    channels = loop.signal_count - loop.delayed
    signal_column, table_row = symbols("signals", len(solver.nodes) * channels)
    signals = {node: table_row[i * channels : (i + 1) * channels] for i, node in enumerate(solver.nodes)}
    past_inputs, remembered = [], []
    if loop.delayed:
        past_column, past = symbols("past", TAPS)
        for i, node in enumerate(solver.nodes):
            signals[node] = np.concatenate([signals[node], (delay_weights[i] @ past).reshape(1)])
        past_inputs = [past_column]
        remembered = [column(loop.undelayed_input(state, signals[solver.nodes[0]]))]
    following = solver.advance(loop.derivative, loop.limit, state, signals, dt)
    accumulators, old_column, new = None, ca.SX(0, 1), ca.SX(0, 1)
    if figures:
        accumulators = Accumulators(errors=loop.errors, parameters=loop.parameters)
        outputs = loop.outputs(state, signals[solver.nodes[0]])
        after = loop.unpack(following)
        old_column, old = symbols("accumulators", len(accumulators.resets))
        new = column(accumulators.update(old, outputs, after, following))
    inputs = [state_column, old_column, ca.SX(0, 1) if parameters is None else parameters, signal_column, *past_inputs]
    return ca.Function("step", inputs, [column(following), new, *remembered], {"cse": True}), accumulators


def step_program(
    loop: ClosedLoop,
    solver: Tableau,
    dt: float,
    parameters: ca.SX | None = None,
    *,
    delay_weights: Value = None,
    lag_per_member: bool = False,
    figures: bool = True,
) -> StepProgram:
    """Trace, optimise: see ``step_function``."""
    function, accumulators = step_function(loop, solver, dt, parameters, delay_weights=delay_weights, figures=figures)
    states, accumulated, varied, signals = (function.nnz_in(i) for i in range(4))
    shape = LoopShape(states, accumulated, varied, signals, delayed=int(loop.delayed), lag_per_member=lag_per_member)
    return StepProgram(optimize(read(function)), shape, accumulators)


def output_function(loop: ClosedLoop) -> ca.Function:
    """The outputs (e, u, theta_hat, x, x_m) as a CasADi function of (state, signals); columns of many instants may be given."""
    import casadi as ca

    state_column, state = symbols("state", loop.size)
    signal_column, signals = symbols("signals", loop.signal_count)
    outputs = loop.outputs(state, signals)
    return ca.Function("outputs", [state_column, signal_column], [column(value) for value in outputs], {"cse": True})


def jacobian_function(loop: ClosedLoop) -> ca.Function:
    """The exact Jacobian of the loop's right-hand side, (size, size), as a CasADi function of (state, signals)."""
    import casadi as ca

    state_column, state = symbols("state", loop.size)
    signal_column, signals = symbols("signals", loop.signal_count)
    slope: Value = column(loop.derivative(state, signals))
    jacobian = ca.densify(ca.jacobian(slope, state_column))
    return ca.Function("jacobian", [state_column, signal_column], [jacobian], {"cse": True})
