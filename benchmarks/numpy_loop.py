"""The same equations on NumPy arrays: the classes that the kernel is traced from compute with numbers just as well."""

from __future__ import annotations

import numpy as np

from barbalat import RK4
from benchmarks.loops import STEP, Case, command_table
from benchmarks.race import Contestant


def contestant(case: Case, steps: int) -> Contestant:
    """One trajectory."""
    loop = case.loop_of(case.parameters[:, 0])

    def run(steps: int) -> np.ndarray:
        state = case.states[:, 0]
        for row in command_table()[:steps]:
            signals = {node: row[i : i + 1] for i, node in enumerate(RK4.nodes)}
            state = RK4.advance(loop.derivative, loop.limit, state, signals, STEP)
        return state[:, None]

    return Contestant("NumPy", steps, run)
