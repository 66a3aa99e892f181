"""What a sampled controller does before a step, as operations: the controller's own list, and around it what it is handed.

The controller's list is the same wherever it runs, in a simulation and on a flight computer: it has no fused multiply-adds, which
targets have or lack, and it is optimised by itself, so that nothing of the plant is mixed into it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import column, flatten, symbols, unflatten
from barbalat.loop.sampling import Acting
from barbalat.lowering.operations import Operation, Program, following, read
from barbalat.lowering.optimize import optimize

if TYPE_CHECKING:
    import casadi as ca

STATE, MEASURED, PARAMETER, COMMAND, FREEZE = range(5)
"""Arguments of a controller's list; its one output is the state one sample later."""


def controller_program(loop: ClosedLoop, parameters: ca.SX | None = None) -> Program:
    """The controller of a sampled loop from sample to sample: of its state, the measurement, the command, the freeze switch."""
    import casadi as ca

    assert loop.computer is not None
    template = initial_acting(loop)
    y = loop.plant.output(loop.plant.x0)
    state_column, state = symbols("state", len(flatten(template)))
    measured_column, measured = symbols("measured", y.size)
    command_column, command = symbols("command", loop.commands or 1)
    freeze_column, freeze = symbols("freeze", 1)
    acting, _ = unflatten(template, state, 0)
    r = command[0] if loop.commands is None else command
    acted = loop.computer.act(acting, measured.reshape(y.shape), r, freeze[0])
    inputs = [state_column, measured_column, parameters_column(parameters), command_column, freeze_column]
    traced = ca.Function("controller", inputs, [column(flatten(acted))], {"cse": True})
    return optimize(read(traced), fused=False)


def initial_acting(loop: ClosedLoop) -> Acting:
    """The controller's state before the first sample."""
    assert loop.computer is not None
    return Acting(loop._initial.controller, loop._initial.held)


def sample_program(loop: ClosedLoop, step: ca.Function, parameters: ca.SX | None = None) -> Program:
    """What happens before a step at a sample, with the arguments of ``step``, see ``step_function``, -> the loop's state."""
    import casadi as ca

    state_column, state = symbols("state", loop.size)
    signal_column, table_row = symbols("signals", step.nnz_in(3))
    noise_column, noise = symbols("noise", loop.signals.noise)
    first = np.concatenate([table_row[: loop.signals.timed], noise, np.zeros(loop.signals.delayed)])
    y, r = loop.sampled_at(state, first)
    inputs = [state_column, ca.SX(0, 1), parameters_column(parameters), signal_column, ca.SX(0, 1), noise_column]
    outputs = [state_column, column(y), column(r)]
    handed = optimize(read(ca.Function("handed", inputs, outputs)), fused=False)
    now, measured, command = handed.outputs
    own = len(flatten(initial_acting(loop)))  # the controller's state stands last in the loop's
    operations = (*handed.operations, Operation("constant"))
    places = {(STATE, i): position for i, position in enumerate(now[-own:])}
    places |= {(MEASURED, i): position for i, position in enumerate(measured)}
    places |= {(COMMAND, i): position for i, position in enumerate(command)}
    places |= {(FREEZE, 0): len(operations) - 1}
    (acted,) = (joined := following(operations, controller_program(loop, parameters), places)).outputs
    return Program(joined.operations, ((*now[:-own], *acted),))


def parameters_column(parameters: ca.SX | None) -> ca.SX:
    """The parameters of a step as an argument, of no entries where there are none."""
    import casadi as ca

    return ca.SX(0, 1) if parameters is None else parameters
