"""A module that gives out a loop's exact Jacobian at instants of a run: a page judges the step by its spectrum, as ``run`` does.

The kernel of the page watches ``run.kernel.step.coupling_function``, and ``templates/stability.js`` looks at the windows, and at
the steps of one with an exit, by the rules of ``run.engine.stability_label``.
"""

from __future__ import annotations

import base64
from typing import Any

import numpy as np

from barbalat.loop.packing import column, symbols
from barbalat.lowering.operations import read
from barbalat.lowering.shape import WATCH_EVERY, LoopShape
from barbalat.lowering.wasm.loop import loop as module_of
from barbalat.open_numbers.probe import Target
from barbalat.protocols import DiscretizedEquations
from barbalat.run.engine.stability_label import MOST_LOOKS, MOST_WINDOWS, WINDOW_PIECES
from barbalat.run.kernel.template import Template

MOST_STATES = 40
"""Of a loop whose spectrum is taken after every run: some dozens of them cost less than drawing."""


WATCHING = {"windows": MOST_WINDOWS, "looks": MOST_LOOKS, "pieces": WINDOW_PIECES, "every": WATCH_EVERY}
"""How the windows of a run are cut and looked at: see ``run.engine.stability_label``."""


def judged(target: Target) -> bool:
    """Whether a page judges the step.

    ``barbalat run`` judges large loops, and laws that take explicit steps from sample to sample.
    """
    reader = target.family.reader
    equations = reader.loop.equations
    return reader.loop.size <= MOST_STATES and not (isinstance(equations, DiscretizedEquations) and equations.explicit)


def spectrum_of(target: Target) -> dict[str, Any] | None:
    """Its rows are a state, signals and noise there, its parameters the run's; None where the page does not judge the step."""
    import casadi as ca

    if not judged(target):
        return None
    reader = target.family.reader
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
