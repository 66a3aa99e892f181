"""heyoka: Taylor series of adaptive order and step for the loop's equations in CasADi's form.

Conditions, such as the ones in a projection, keep their value at t = 0, because no estimate reaches its bound in the measured
time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import heyoka as hy
import numpy as np

from barbalat import vocabulary
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import right_hand_side
from barbalat.lowering.switching import switched
from barbalat.signals import Sine
from benchmarks.loops import PROBLEM

T_END, INSTANTS = 2.0, 4


def run_of(loop: ClosedLoop, tolerance: float) -> Callable[[], np.ndarray]:
    """A run with steps by a tolerance. It returns the states at the ends of its quarters."""
    variables = hy.make_vars(*(f"x{i}" for i in range(loop.size)))
    system = list(zip(variables, _rates(loop, variables), strict=True))
    integrator = hy.taylor_adaptive(system, loop.initial(), tol=tolerance)

    def run() -> np.ndarray:
        integrator.time, found = 0.0, []
        integrator.state[:] = loop.initial()
        for i in range(INSTANTS):
            integrator.propagate_until((i + 1) * T_END / INSTANTS)
            found.append(integrator.state.copy())
        return np.array(found)

    return run


def _rates(loop: ClosedLoop, variables: list[Any]) -> list[Any]:
    """The right-hand sides as heyoka's expressions."""
    x, s = ca.SX.sym("x", loop.size), ca.SX.sym("s", loop.signal_count)
    function = right_hand_side(loop)
    conditions = ca.vertcat(*(one.truth for one in switched(function, [x, s]).conditions))
    at_start = [float(signal(np.zeros(1))[0]) for signal in PROBLEM.signals]
    choices = ca.DM(ca.Function("choices", [x, s], [conditions])(loop.initial(), at_start)) if conditions.numel() else None
    frozen = ca.simplify(switched(function, [x, s], choices).values[0])
    command = PROBLEM.reference
    assert isinstance(command, Sine)
    driven = [command.constant + command.amplitude * hy.sin(command.frequency * hy.time + command.phase)]
    return _read(ca.Function("rates", [x, s], [frozen], {"cse": True}), [list(variables), driven])


def _read(function: ca.Function, arguments: list[list[Any]]) -> list[Any]:
    work, outputs, names = dict[int, Any](), [hy.expression(0.0)] * function.size1_out(0), vocabulary.names()
    places = function.sparsity_out(0).row()
    for k in range(function.n_instructions()):
        code, given, target = function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)
        if code == ca.OP_CONST:
            work[target[0]] = hy.expression(function.instruction_constant(k))
        elif code == ca.OP_INPUT:
            work[target[0]] = arguments[given[0]][given[1]]
        elif code == ca.OP_OUTPUT:
            outputs[places[target[1]]] = work[given[0]]
        else:
            work[target[0]] = OPERATIONS[names[code]](*(work[i] for i in given))
    return outputs


OPERATIONS: dict[str, Callable[..., Any]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "neg": lambda a: -a,
    "sq": lambda a, *_: a * a,
    "twice": lambda a, *_: 2.0 * a,
    "inv": lambda a, *_: 1.0 / a,
    "sqrt": hy.sqrt,
    "sin": hy.sin,
    "cos": hy.cos,
}
"""heyoka's functions for CasADi's operations, as far as the three loops need them."""
