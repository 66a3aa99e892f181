"""Finds out whether an exported controller is lost, oscillates or saturates, or has samples rejected, in the run of its case."""

from __future__ import annotations

from dataclasses import replace

from barbalat.judge.settings import Judge
from barbalat.judge.verdict import Class, Verdict
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.engine.simulate import simulate, with_missed_samples
from barbalat.solvers.simulation import Simulation

MOST_OF_THE_TIME = 0.5
"""Fraction of the time at the actuator limits above which a run with the verdict *off* is reported, because the limits and not
the law determine u."""

AFTER_A_BIT_ERROR = (
    "After a bit error in the last good value the shell can reject good samples for a long time: give a range as well."
)


def own_run_warning(problem: TrackingProblem, controller: Controller, simulation: Simulation, judge: Judge | None) -> str:
    """A warning if the run of the case with this controller is lost or diverges, ends in a limit cycle, or is off and mostly at
    its limits, or if its shell rejects samples of that run without faults or has a rate without a range; otherwise empty."""
    (run,) = simulate(problem, [controller], simulation, judge=judge).values()
    if run.verdict is not None and run.verdict.kind is Class.LOST:
        return f"Do not fly this export as it is: in the run of the case {controller.name} is {run.verdict}."
    said = []
    if run.verdict is not None and _is_poor(run.verdict):
        said.append(f"In the run of the case the judge's verdict on {controller.name} is: {run.verdict}.")
    if problem.shell is not None:
        if problem.faults:
            run = simulate(replace(problem, faults=()), [controller], simulation)[controller.name]  # type: ignore[type-var]
        missed = with_missed_samples({controller.name: run})[controller.name].missed
        told = None if missed is None else missed.sentence
        said += [f"In the run of the case without faults, {told}: widen the limits of the shell."] if told else []
        alone = ", ".join(name for name in problem.shell.rate if name not in problem.shell.range)
        said += [f"{alone}: shell.rate without shell.range. {AFTER_A_BIT_ERROR}"] if alone else []
    return " ".join(said)


def _is_poor(verdict: Verdict) -> bool:
    mostly = max(verdict.at_limit, default=0.0) >= MOST_OF_THE_TIME
    return verdict.kind is Class.CYCLE or (verdict.kind is Class.OFF and mostly)
