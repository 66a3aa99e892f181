"""A module that gives out a loop's exact Jacobian at instants of a run: a page takes its spectrum, and judges the step by it."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np

from barbalat.explorer.effects import Target
from barbalat.loop.packing import column, symbols
from barbalat.lowering.operations import read
from barbalat.lowering.shape import LoopShape
from barbalat.lowering.wasm.loop import loop as module_of
from barbalat.protocols import DiscretizedEquations
from barbalat.run.template import Template

MOST_STATES = 40
"""Of a loop whose spectrum is taken after every run: some dozens of them cost less than drawing."""


def spectrum_of(target: Target) -> dict[str, Any] | None:
    """Its rows are a state, signals and noise there, its parameters the run's; None where the step is judged by other means.

    Those are large loops, and laws that take explicit steps from sample to sample: ``barbalat run`` judges them.
    """
    import casadi as ca

    reader = target.family.reader
    equations = reader.loop.equations
    if reader.loop.size > MOST_STATES or (isinstance(equations, DiscretizedEquations) and equations.explicit):
        return None
    template = Template.of(reader.columns, opened=True).adjustable(reader.simulation.dt, None)
    loop = template.loop.following_within(template.dt)
    state_column, state = symbols("state", loop.size)
    given_column, given = symbols("given", loop.signals.timed + loop.signals.noise)
    signals = np.concatenate([given, np.zeros(loop.signals.delayed)])
    jacobian = ca.jacobian(column(loop.derivative(state, signals)), state_column)
    rows, columns = jacobian.sparsity().get_triplet()
    nothing = ca.SX(0, 1)
    row = ca.vertcat(state_column, given_column)
    inputs = [nothing, nothing, template.column, row, nothing, nothing]
    found = ca.vertcat(nothing, *(jacobian[int(i), int(j)] for i, j in zip(rows, columns, strict=True)))
    traced = ca.Function("jacobian", inputs, [nothing, found, nothing], {"cse": True})
    shape = LoopShape(0, len(rows), len(template.values), loop.size + loop.signals.timed + loop.signals.noise)
    module = module_of(read(traced), shape, (0.0,) * len(rows))
    return {"module": base64.b64encode(module).decode(), "rows": list(rows), "columns": list(columns)}
