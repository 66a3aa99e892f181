"""NumPy: a Python loop over the steps."""

from __future__ import annotations

import numpy as np

from benchmarks.loops import Case, command_table
from benchmarks.peers.equations import WRITTEN, rk4
from benchmarks.race import Contestant


def contestants(case: Case, steps: int) -> list[Contestant]:
    """Return the contestant for one trajectory."""
    return [_contestant(case, steps, form) for form in WRITTEN[case.name].forms]


def _contestant(case: Case, steps: int, form: str) -> Contestant:
    written = WRITTEN[case.name]

    def run(steps: int) -> np.ndarray:
        y = case.states[:, 0]
        for r in command_table()[:steps]:
            y = rk4(np, written.forms[form], y, r, case.parameters[:, 0])
        return y[: written.compared, None]

    return Contestant(f"NumPy, {form}", steps, run)
