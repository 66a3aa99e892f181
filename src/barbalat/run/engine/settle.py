"""Runs whose step may damp or excite what it does not resolve, once more with a step that does: is it of the same class?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from barbalat.budget import Progress, part_of
from barbalat.run.engine.check_numerics import AFFORDED_STEPS
from barbalat.run.engine.engine import Batch, run
from barbalat.run.engine.judging import Terms, judged, watched_in_sweeps
from barbalat.run.kernel.costs import steps_within
from barbalat.run.results.result import Result, Results


def settle(results: Mapping[str, Result], *, afforded_steps: int = AFFORDED_STEPS, progress: Progress | None = None) -> Results:
    """The same results; each one that is not examined, ``verdict.settled`` being None, has the class of a finer step.

    What left its region of stability is the matter of ``check_numerics``. A run stays as it is where no factor that is tried
    resolves it, or where the finer one would take more steps than ``afforded_steps``, or than the budget allows.
    """
    settled, pending = dict(results), [name for name, one in results.items() if _open(one, afforded_steps)]
    for i, name in enumerate(pending):
        settled[name] = _settled(results[name], part_of(progress, i / len(pending), 1 / len(pending)))
    return Results(settled)


def _open(result: Result, afforded: int) -> bool:
    verdict, steps = result.verdict, result.simulation.steps * result.finer_by
    examined = verdict is None or verdict.settled is not None or result.stiffness.unstable_from is not None
    if examined or not np.isfinite(steps) or steps > afforded:
        return False
    return steps_within(result.problem, [result.loop], result.simulation, int(steps)) >= steps


def _settled(result: Result, progress: Progress | None) -> Result:
    assert result.judge is not None
    finer = replace(result.simulation, dt=result.simulation.dt / result.finer_by)
    batch = Batch.of([(result.problem, result.controller)], finer, watched=watched_in_sweeps(result.judge))
    run([batch], result.problem.signals, finer, progress=progress)
    kind = judged(batch, finer, Terms.of(result.problem, finer, result.judge)).verdict(0).kind
    return replace(result, finer_kind=kind)
