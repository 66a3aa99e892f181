"""Repeats every run that left its region of stability with a finer step, to find out whether the solver or the
loop causes its behaviour."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from barbalat import validate
from barbalat.budget import Progress, part_of
from barbalat.protocols import Stepping
from barbalat.run.engine.by_tolerance import measured_error
from barbalat.run.engine.simulate import simulate
from barbalat.run.kernel.costs import steps_within
from barbalat.run.results.result import Result, Results
from barbalat.run.results.step_comparison import FinerStep, Seen, at_the_same_time, compare
from barbalat.solvers.simulation import Simulation
from barbalat.validate import InputError

AFFORDED_STEPS = 10_000_000
"""Largest number of steps of a finer run, which takes a second for a small loop."""
FINER_BY = (10, 100, 1000)
"""Divisors of the step, tried in turn until a run stays inside the region of stability."""


def check_numerics(
    results: Mapping[str, Result],
    *,
    afforded_steps: int = AFFORDED_STEPS,
    measured: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Results:
    """Return the results, each with a ``check`` (see ``FinerStep``) if the run left its region of stability.

    The run is repeated with a tenth of its step, then with a hundredth and a thousandth if it still leaves the region. A finer
    run takes at most ``afforded_steps``, and no more than the budget allows. If it does not reach t_end, the two steps are
    compared up to the time that it reaches. If it does not even reach the time of the label, the check says so.

    measured  also compute the ``measured_error`` of each fixed-step run, by two variable-step runs, which take seconds if
              adaptation is fast. If a case does not admit a tolerance, the result says so
    """
    if not isinstance(results, Mapping):
        raise InputError(f"results must be results by name, as simulate returns them, got {type(results).__name__}")
    for result in results.values():
        validate.instance("results", result, Result)
    asked = validate.whole("afforded_steps", afforded_steps, least=1)
    afforded_steps = min([asked, *(steps_within(one.problem, [one.loop], one.simulation, asked) for one in results.values())])
    checked = dict(results)
    pending = {name: result for name, result in results.items() if result.stiffness.unstable_from is not None}
    finest: dict[str, Seen] = {}
    done = 0.0
    for factor in FINER_BY:
        groups = _groups(pending, factor, afforded_steps)
        for members in groups:
            width = 0.9 * (1 - done) / len(groups)  # the first factor settles most runs
            for name, (found, fine) in _compared(
                members, factor, afforded_steps, threads, part_of(progress, done, width)
            ).items():
                if found is None:
                    finest[name] = fine
                else:
                    checked[name] = replace(pending.pop(name), check=found)
            done += width
    if progress is not None:
        progress(1.0)
    unsettled = {name: _unsettled(result, afforded_steps, finest.get(name)) for name, result in pending.items()}
    all_checked = checked | {name: replace(result, check=unsettled[name]) for name, result in pending.items()}
    return Results({name: _with_error(result) for name, result in all_checked.items()} if measured else all_checked)


def _with_error(result: Result) -> Result:
    return result if result.simulation.tolerance is not None else replace(result, measured_error=measured_error(result))


def _groups(pending: Mapping[str, Result], factor: int, afforded: int) -> list[dict[str, Result]]:
    """The runs that can be repeated with a step finer by ``factor``; runs of one problem with one step are computed together."""
    groups: dict[tuple[int, Simulation], dict[str, Result]] = {}
    for name, result in pending.items():
        if _horizon(result, factor, afforded) is not None:
            groups.setdefault((id(result.problem), result.simulation), {})[name] = result
    return list(groups.values())


def _compared(
    members: Mapping[str, Result], factor: int, afforded: int, threads: int | None, progress: Progress | None
) -> dict[str, tuple[FinerStep | None, Seen]]:
    """Return the checks with a step finer by ``factor`` (None for a run that leaves the region again), and the observed
    quantities."""
    first = next(iter(members.values()))
    given, horizon = first.simulation, _horizon(first, factor, afforded)
    assert horizon is not None
    controllers = [result.controller for result in members.values()]
    # the steps of a law that is sampled by Euler's method are refined too, because they are checked as well
    refined = [one.refined(factor) if isinstance(one, Stepping) else one for one in controllers]
    finer = replace(given, t_end=horizon, dt=given.dt / factor)
    fine = simulate(first.problem, refined, finer, judge=first.judge, threads=threads, progress=progress).values()
    coarse = members.values()
    if horizon != given.t_end:
        coarse = simulate(first.problem, controllers, replace(given, t_end=horizon), threads=threads).values()
    whole = horizon == given.t_end
    pairs = zip(members, coarse, fine, strict=True)
    seen = {name: (_seen(one), _seen(other)) for name, one, other in pairs}
    return {name: (compare(one, other, horizon, whole=whole), other) for name, (one, other) in seen.items()}


def _horizon(result: Result, factor: int, afforded: int) -> float | None:
    """The time [s] that a step finer by ``factor`` reaches; None if its tail would begin before the run became unstable."""
    steps = min(result.simulation.steps, afforded // factor)
    if steps == result.simulation.steps:
        return result.simulation.t_end
    horizon = float(result.simulation.time(steps))
    begins = result.stiffness.unstable_from or 0.0
    return horizon if steps and begins < 0.75 * horizon else None


def _seen(result: Result) -> Seen:
    unstable_from = result.stiffness.unstable_from
    sound = result.t <= (np.inf if unstable_from is None else unstable_from)
    error = float(np.abs(result.e[sound]).max()) if sound.any() else 0.0
    controller = result.controller
    return Seen(
        dt=result.simulation.dt,
        metrics=result.metrics,
        unstable_from=unstable_from,
        sound_error=error,
        path=result.envelope.theta_hat_path.sum(axis=0),
        model=float(np.abs(result.x_m).max()),
        estimates=float(np.abs(result.theta_hat).max(initial=0.0)),
        steps=result.simulation.steps,
        sample_time=controller.law_step if isinstance(controller, Stepping) else None,
        kind=None if result.judged is None else result.judged.kind,
    )


def _unsettled(result: Result, afforded: int, finest: Seen | None) -> FinerStep:
    tried = [factor for factor in FINER_BY if _horizon(result, factor, afforded) is not None]
    if not tried or finest is None:
        needed = result.simulation.steps * FINER_BY[0]
        return FinerStep(
            "unsettled",
            f"not checked: a tenth of the step takes {needed:.2g} steps, and the limit of {afforded:.2g} steps does not reach "
            f"the time from which the run is unstable",
        )
    dt = result.simulation.dt / tried[-1]
    reason = "a finer step is not tried" if tried[-1] == FINER_BY[-1] else f"{afforded:.2g} finer steps do not reach that time"
    too = f"h = {dt:g} s leaves the region of stability too"
    if finest.diverged_at is not None:
        too += f" and diverges at t = {finest.diverged_at:.6g} s"
        if result.diverged_at is not None and at_the_same_time(result.diverged_at, finest.diverged_at):
            too += ", at about the same time as this run, as in a finite escape of the loop itself"
    return FinerStep("unsettled", f"not settled: {too}; {reason}", dt=dt, diverged_at=finest.diverged_at)
