"""Repeats runs with a finer step, to check the class of oscillations that the step may damp or excite and to estimate the
error of the step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from barbalat.budget import Progress, part_of
from barbalat.judge.settings import component_names
from barbalat.judge.verdict import Class
from barbalat.run.engine.check_numerics import AFFORDED_STEPS
from barbalat.run.engine.engine import Batch, run
from barbalat.run.engine.judging import Terms, judged, watched_in_sweeps
from barbalat.run.kernel.costs import steps_within
from barbalat.run.results.half_step import HalfStep
from barbalat.run.results.result import Result, Results
from barbalat.solvers.simulation import Simulation


def settle(results: Mapping[str, Result], *, afforded_steps: int = AFFORDED_STEPS) -> Results:
    """Return the results, with the class at a finer step wherever the verdict has not been examined (``verdict.settled`` is
    None).

    Runs that left their region of stability are left to ``check_numerics``. A result is unchanged if none of the tried factors
    resolves the run, or if the finer run would take more steps than ``afforded_steps`` or than the budget allows.
    """
    return Results({name: _settled(one) if _open(one, afforded_steps) else one for name, one in results.items()})


def halved(results: Mapping[str, Result], *, afforded_steps: int = AFFORDED_STEPS, progress: Progress | None = None) -> Results:
    """Return the results, with ``half_step``, the error at half the step, for each run that was judged and did not diverge.

    A sampled controller keeps its sample time. Runs that left their region of stability are left to ``check_numerics``. A result
    is also unchanged if the timer has jitter, or if half its step takes more steps than ``afforded_steps`` or than the budget
    allows.
    """
    found = dict(results)
    pending = [name for name, one in results.items() if _halvable(one) and _affordable(one, 2.0, afforded_steps)]
    for i, name in enumerate(pending):
        found[name] = _halved(results[name], part_of(progress, i / len(pending), 1 / len(pending)))
    return Results(found)


def _open(result: Result, afforded: int) -> bool:
    verdict = result.verdict
    examined = verdict is None or verdict.settled is not None or result.stiffness.unstable_from is not None
    return not examined and _affordable(result, result.finer_by, afforded)


def _halvable(result: Result) -> bool:
    verdict = result.verdict
    if result.simulation.tolerance is not None:  # a second run measured its error
        return False
    computer = result.loop.computer
    if computer is not None and computer.around is not None and computer.around.jitters:
        return False  # the calls of a timer with jitter are rounded to steps: so at half the step the scenario differs
    return verdict is not None and verdict.kind is not Class.LOST and result.stiffness.unstable_from is None


def _affordable(result: Result, factor: float, afforded: int) -> bool:
    steps = result.simulation.steps * factor
    if not np.isfinite(steps) or steps > afforded or result.simulation.dt / factor == 0.0:  # below the smallest float
        return False
    return steps_within(result.problem, [result.loop], result.simulation, int(steps)) >= steps


def _settled(result: Result) -> Result:
    batch, finer = _finer(result, result.finer_by, None)
    assert result.judge is not None
    kind = judged(batch, finer, Terms.of(result.problem, finer, result.judge)).verdict(0).kind
    return replace(result, finer_kind=kind)


def _halved(result: Result, progress: Progress | None) -> Result:
    batch, finer = _finer(result, 2.0, progress)
    assert result.judged is not None and result.judge is not None
    terms, nobody = Terms.of(result.problem, finer, result.judge), np.zeros(1, dtype=bool)
    component, band = result.judged.component, result.judged.band
    i = component_names(result.problem).index(component)
    coarse, fine = (float(one.tail_max_abs_e[0, i]) for one in (result.metrics, batch.metrics(finer)))
    order = result.simulation.solver.order if result.lost is None else min(result.lost.order, result.simulation.solver.order)
    kind = judged(batch, finer, terms, among=nobody).verdict(0).kind
    own = kind if result.judged.kind is Class.CYCLE else result.judged.kind
    return replace(result, half_step=HalfStep(component, coarse, fine, order, band, (own, kind)))


def _finer(result: Result, factor: float, progress: Progress | None) -> tuple[Batch, Simulation]:
    """The run with a step smaller by ``factor``, without a record, and its simulation settings."""
    assert result.judge is not None
    finer = replace(result.simulation, dt=result.simulation.dt / factor)
    batch = Batch.of([(result.problem, result.controller)], finer, watched=watched_in_sweeps(result.judge))
    run([batch], result.problem.signals, finer, progress=progress)
    return batch, finer
