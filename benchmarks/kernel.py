"""The package's kernel as a contestant, and the common parts of all compiled contestants."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from barbalat.lowering.shape import LoopShape
from barbalat.run.engine.engine import best_lanes
from benchmarks.loops import Case, command_table
from benchmarks.race import Contestant

WITH_FIGURES = ", all figures"

Loop = Callable[[int, int, np.ndarray, np.ndarray, np.ndarray, np.ndarray], None]
"""The type of ``loop(blocks, steps, state, parameters, signals, out)``, which ``llvm.ir.loop`` compiles."""


def advance(loop: Loop, shape: LoopShape, case: Case, lanes: int) -> Callable[[int], np.ndarray]:
    """Run all members in one thread, ``lanes`` members in each call. Idle lanes repeat the last member."""
    groups = [np.minimum(np.arange(first, first + lanes), case.members - 1) for first in range(0, case.members, lanes)]
    parameters = [np.ascontiguousarray(case.parameters[:, group]) for group in groups]
    out = np.empty((shape.states + shape.accumulators, lanes))

    def run(steps: int) -> np.ndarray:
        final = np.empty_like(case.states)
        for group, values in zip(groups, parameters, strict=True):
            state = np.ascontiguousarray(case.states[:, group])
            loop(1, steps, state, values, command_table(), out)
            final[:, group] = state
        return final

    return run


def contestant(case: Case, steps: int, *, figures: bool = False) -> Contestant:
    """The kernel at the lane width that the engine chooses."""
    program = case.optimised(figures=figures)
    lanes = best_lanes(case.members)
    name = f"barbalat, {lanes} lane{'s' * (lanes > 1)}{WITH_FIGURES * figures}"
    return Contestant(name, steps, advance(program.compile(lanes), program.shape, case, lanes))
