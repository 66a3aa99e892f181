"""Simulate controllers on a problem, each alone on its own kernel, all side by side."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from barbalat import validate
from barbalat.budget import Progress
from barbalat.loop.binding import numbered
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.user_errors import named
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.engine.batch import Batch, Blocks
from barbalat.run.engine.engine import run
from barbalat.run.engine.stability_label import MOST_WINDOWS, Run, stiffness_along
from barbalat.run.kernel import costs, delay
from barbalat.run.kernel.breaks import lost_order
from barbalat.run.kernel.delay import brings_bends
from barbalat.run.kernel.kinks import lost_along
from barbalat.run.kernel.portable import at_instants
from barbalat.run.kernel.step import output_function
from barbalat.run.results.result import Envelope, Result
from barbalat.run.results.results import Results
from barbalat.solvers.simulation import Simulation


def simulate(
    problem: TrackingProblem,
    controllers: Controller | Iterable[Controller],
    simulation: Simulation,
    *,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Results:
    """Run every controller on the problem; results by the controllers' names, of which equal ones are numbered.

    threads   all cores by default; results do not depend on it
    progress  called with the fraction done

    Raises InputError for a controller that doesn't fit the problem, with its name, and for runs beyond the budget. A run that
    diverges is a result.
    """
    validate.instance("problem", problem, TrackingProblem)
    validate.instance("simulation", simulation, Simulation)
    controllers = numbered(controllers)
    delay.require_memory(problem.delay, len(problem.history), len(controllers), simulation.dt)
    loops = []
    for controller in controllers:
        with named(controller.name):
            loops.append(ClosedLoop.of(problem, controller))
    costs.require_runs(problem, loops, simulation)
    batches = []
    for controller in controllers:
        with named(controller.name):
            batches.append(Batch.of([(problem, controller)], simulation, record=True, windows=MOST_WINDOWS))
    run(batches, problem.signals, simulation, threads=threads, progress=progress)
    runs = zip(controllers, batches, strict=True)
    return Results((c.name, result_of(problem, c, simulation, batch)) for c, batch in runs)


def result_of(problem: TrackingProblem, controller: Controller, simulation: Simulation, batch: Batch) -> Result:
    """Of a recorded batch of one member after its run."""
    loop, blocks, stop = batch.loop, batch.blocks(simulation), np.inf
    steps = np.append(blocks.starts, simulation.steps)
    states = np.vstack([blocks.states[:, :, 0], batch.final_states.T])
    metrics = batch.metrics(simulation)
    if not np.isnan(metrics.diverged_at[0]):
        stop = batch.diverged_step[0]
        kept = int(np.searchsorted(steps, stop))  # the instants before it
        steps, states = steps[:kept], states[:kept]
    made = Run(problem, simulation, batch, steps, states, stop)
    t, signals, states = simulation.time(steps), made.signals(steps), made.acted(steps, states)
    e, u, theta_hat, x, x_m, y = (value.T for value in at_instants(output_function(loop), simulation, states.T, signals))
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
        envelope=_envelope(blocks, max(len(steps) - 1, 0)),
        metrics=metrics,
        stiffness=stiffness_along(made),
        lost=lost_along(
            lost_order(problem.signals, simulation, delayed=loop.delayed, bends=brings_bends(loop)),
            loop,
            simulation,
            metrics.max_abs_u.reshape(1, -1),
            theta_hat,
        ),
    )


def _envelope(blocks: Blocks, intervals: int) -> Envelope:
    """Of the first member, between the recorded instants."""
    extrema = [(quantity, side) for quantity in ("e", "u", "theta_hat") for side in ("min", "max")]
    return Envelope(
        **{f"{quantity}_{side}": blocks.figure(quantity, side)[:intervals, :, 0] for quantity, side in extrema},
        theta_hat_path=blocks.figure("variation", "sum")[:intervals, :, 0],
    )
