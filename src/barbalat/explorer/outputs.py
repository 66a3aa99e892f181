"""Where in a module's rows what is drawn and what is told stands, as a page's JSON has it."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np

from barbalat.cases.build import Case
from barbalat.explorer.encoded import doubles
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import unflatten
from barbalat.loop.true_values import estimate_names, true_values, truth_of
from barbalat.lowering.operations import read
from barbalat.lowering.optimize import optimize
from barbalat.lowering.shape import LoopShape
from barbalat.lowering.wasm.loop import loop as module_of
from barbalat.pictures.symbols import estimated
from barbalat.problem.command_gain import commanded, gains_at_rest
from barbalat.run.kernel import delay
from barbalat.run.kernel.members import Members
from barbalat.run.kernel.metrics import Accumulators
from barbalat.run.results.estimates import MOST_REPORTED
from barbalat.solvers import SOLVERS, Tableau


def outputs(case: Case, members: Members) -> dict[str, Any]:
    """Of one controller: sizes, rows of the states and accumulators, panels."""
    loop, shape, accumulators = members.loop, members.program.shape, members.program.accumulators
    assert isinstance(accumulators, Accumulators)
    marked, _ = unflatten(loop._initial, np.arange(loop.size), 0)
    rows = loop.theta_hat_rows
    gains, true = gains_at_rest(case.problem), true_values(case.problem, loop)
    panels = [
        {"state": state, "commands": [{"index": k, "gain": float(gains[state, k])} for k in commands]}
        for state, commands in commanded(case.problem)
    ]
    return {
        "shape": {
            "states": shape.states, "accumulators": shape.accumulators, "pieces": shape.in_pieces,
            "commands": loop.commands or 1, "delayed": shape.delayed,
        },
        "rhythm": members.rhythm.sample_every and float(loop.sample_time or 0.0),
        "operations": [list(part) for part in accumulators.layout],
        "theta_hat": [rows.start, rows.stop],
        "x": [int(i) for i in marked.x.reshape(-1)], "x_m": [int(i) for i in marked.x_m.reshape(-1)],
        "output": loop.measured_outputs > 0, "panels": panels,
        "true": None if true is None else [float(v) for v in true],
        "estimates": [estimated(name) for name in estimate_names(loop)],
        "reported": {part.name: [*range(part.rows.start, part.rows.stop)] for part in loop.other_estimates},
        "beside": _beside(case, loop),
        "past": None if members.history is None else members.history[:, 0].tolist(),
    }  # fmt: skip


def _beside(case: Case, loop: ClosedLoop) -> list[dict[str, Any]]:
    """What is drawn beside theta_hat, entry by entry, with what it is to become."""
    found = []
    for part in loop.other_estimates:
        if part.size <= MOST_REPORTED:
            true = truth_of(case.problem, part)
            values = [None] * part.size if true is None else true.tolist()
            rows = range(part.rows.start, part.rows.stop)
            names = map(estimated, part.names)
            found += [{"label": name, "row": row, "true": one} for name, row, one in zip(names, rows, values, strict=True)]
    return found


def numbers_handed(members: Members) -> int:
    """The module's parameters up to the step; the delay's weights, which are the solver's, stand behind it."""
    time, dt, solver = members.longest_delay, members.simulation.dt, members.simulation.solver
    return members.program.shape.parameters - (delay.weights(time, dt, solver).size if members.loop.delayed else 0)


def delay_weights() -> dict[str, dict[str, str]]:
    """``delay.weights`` by solver: of whole steps, however many, and a module that makes them of a fraction."""
    return {
        name: {
            "whole": doubles(delay.weights(1.0, 1.0, tableau).reshape(-1)),
            "module": base64.b64encode(_weights_module(tableau)).decode(),
        }
        for name, tableau in SOLVERS.items()
    }


def _weights_module(tableau: Tableau) -> bytes:
    """Its blocks give out the weights of the fraction in a row."""
    import casadi as ca

    fraction, nothing = ca.SX.sym("fraction"), ca.SX(0, 1)
    weights = delay.traced_weights(tableau)(fraction)
    traced = ca.Function("step", [nothing, nothing, nothing, fraction], [nothing, weights, nothing], {"cse": True})
    rows = weights.numel()
    return module_of(optimize(read(traced), fused=False), LoopShape(0, rows, 0, 1), (0.0,) * rows)
