"""Simulate controllers on a problem, each alone on its own kernel, all side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run import delay
from barbalat.run.diagnosis.stability_label import Run, stiffness_along, watch
from barbalat.run.engine import Batch
from barbalat.run.engine import run as advance
from barbalat.run.grid import segments_of
from barbalat.run.progress import Progress
from barbalat.run.result import Envelope, Result
from barbalat.run.step import output_function, step_program
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError


def simulate(
    problem: TrackingProblem,
    controllers: Sequence[Controller],
    simulation: Simulation,
    *,
    threads: int | None = None,
    progress: Progress | None = None,
) -> dict[str, Result]:
    """Run every controller on the problem; results by the controllers' names.

    threads   all cores by default; results do not depend on it
    progress  called with the fraction done

    Raises InputError for controllers that don't fit the problem or share a name. A run that diverges is a result.
    """
    validate.instance("simulation", simulation, Simulation)
    if not isinstance(controllers, (list, tuple)):
        raise InputError(f"controllers must be a list of controllers, got {validate.show(controllers)}")
    if not controllers:
        raise InputError("at least one controller is needed, got none")
    loops = [ClosedLoop.of(problem, controller) for controller in controllers]
    names = [controller.name for controller in controllers]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise InputError(f"every controller needs a name of its own, but {twice[0]!r} stands {names.count(twice[0])} times")
    batches = []
    for loop in loops:
        weights, lags, history = None, None, None
        seeds = None if problem.noise is None else np.array([problem.noise.seed])
        if loop.delayed:
            weights = delay.weights(problem.delay, simulation.dt, simulation.solver)
            lags, history = np.array([delay.lag(problem.delay, simulation.dt)]), problem.history[:, None]
        program = step_program(loop, simulation.solver, simulation.dt, delay_weights=weights, noise=problem.noise, watch=True)
        start, watched = loop.initial()[:, None], watch(loop, simulation)
        past: dict[str, Any] = {"lags": lags, "history": history}
        batches.append(Batch(program, start, np.zeros((0, 1)), **past, seeds=seeds, record=True, watch=watched))
    advance(batches, problem.signals, simulation, threads=threads, progress=progress)
    parts = zip(controllers, loops, batches, strict=True)
    return {c.name: _result(problem, c, simulation, loop, batch) for c, loop, batch in parts}


def _result(problem: TrackingProblem, controller: Controller, simulation: Simulation, loop: ClosedLoop, batch: Batch) -> Result:
    steps, states, accumulators = _record(simulation, batch)
    metrics = batch.metrics(simulation, loop.theta_hat_rows)
    stop = np.inf
    if not np.isnan(metrics.diverged_at[0]):
        stop = batch.totals.diverged_step[0]
        kept = int(np.searchsorted(steps, stop))  # the instants before it
        steps, states, accumulators = steps[:kept], states[:kept], accumulators[: max(kept - 1, 0)]
    run = Run(problem, simulation, loop, batch, steps, states, stop)
    t, signals, states = simulation.time(steps), run.signals(steps), run.acted(steps, states)
    e, u, theta_hat, x, x_m, y = (np.asarray(value).T for value in output_function(loop)(states.T, signals))
    at = batch.totals.at
    extrema = [(quantity, side) for quantity in ("e", "u", "theta_hat") for side in ("min", "max")]
    envelope = Envelope(
        **{f"{quantity}_{side}": accumulators[:, at[quantity, side]] for quantity, side in extrema},
        theta_hat_path=accumulators[:, at["variation", "sum"]],
    )
    return Result(
        problem=problem,
        controller=controller,
        simulation=simulation,
        t=t,
        x=x,
        x_m=x_m,
        y=y[:, 0] if loop.measured_outputs else None,
        e=e,
        u=u[:, 0] if loop.inputs == 1 else u,
        r=signals[0] if loop.commands is None else signals[: loop.commands].T,
        theta_hat=theta_hat,
        states=states,
        envelope=envelope,
        metrics=metrics,
        stiffness=stiffness_along(run),
    )


def _record(simulation: Simulation, batch: Batch) -> tuple[Array, Array, Array]:
    """Steps (K,), states (K, size) and the accumulators between them (K - 1, ...) of a batch of one member."""
    (group,) = batch.groups
    blocks = np.concatenate([out[:, :, 0] for out in group.recorded])
    starts = [s.start + np.arange(s.blocks) * s.length for s in segments_of(simulation, recorded=True)][: len(group.recorded)]
    steps = np.append(np.concatenate(starts), simulation.steps)
    states = np.vstack([blocks[:, : batch.program.shape.states], group.state[:, 0]])
    return steps, states, blocks[:, batch.program.shape.states :]
