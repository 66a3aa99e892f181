"""Variable-step runs. They are observed during integration and repeated once to measure their error."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from math import inf

import numpy as np

from barbalat.budget import Progress, carried
from barbalat.judge.appended import Watched
from barbalat.judge.settings import Judge
from barbalat.loop.binding import bound
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.user_errors import named
from barbalat.lowering.switching import CountlessError
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.engine.engine import Group
from barbalat.run.engine.judging import Terms, judged, watched_in_runs
from barbalat.run.engine.motion import Delay, Motion, Nodes, node_kernel
from barbalat.run.engine.observed_group import ObservedBatch, ObservedGroup
from barbalat.run.kernel.grid import Segment
from barbalat.run.kernel.metrics import Metrics
from barbalat.run.kernel.observer import observer_program
from barbalat.run.kernel.pieces import require_known_instants
from barbalat.run.kernel.portable import run_times
from barbalat.run.results.accuracy import Accuracy, MeasuredError, differences, relative_differences
from barbalat.run.results.result import Envelope, Result, Results
from barbalat.run.results.series import series_along
from barbalat.run.results.spectrum import Stiffness
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

MOST_ROWS = 1 << 15
"""Approximate size of a table of nodes: a few megabytes."""
FINER = 1 / 32
"""Ratio of the tolerance of the second run, which measures the error of the first, to that of the first; the error of the second
run is about 20 times smaller."""
FINER_STEP = 0.5
"""Ratio of the longest step of the second run to that of the first; needed because samples and delays may limit steps more than
the tolerance does."""
FINEST = 1e-14
"""Smallest tolerance of a second run; below it, rounding errors dominate."""


@dataclass(eq=False)
class Observation:
    """A run while it is computed and observed."""

    problem: TrackingProblem
    controller: Controller
    simulation: Simulation
    loop: ClosedLoop
    motion: Motion
    batch: ObservedBatch
    nodes: Nodes = field(init=False)

    @classmethod
    def of(
        cls, problem: TrackingProblem, controller: Controller, simulation: Simulation, watched: Watched | None, number: int = 0
    ) -> Observation:
        """Create the observation of a run; raises InputError if a tolerance cannot be used with the problem or the controller.
        ``number`` selects the noise stream."""
        motion = motion_of(problem, controller, simulation, number)
        loop = motion.attempts.loop
        program, remembered = observer_program(loop, simulation.grid.dt, watched, fused=simulation.fused)
        batch = ObservedBatch(
            loop, program, loop.initial()[:, None], np.zeros((0, 1)), record=True, lanes=1, steps=inf, remembered=remembered
        )
        return cls(problem, controller, simulation, loop, motion, batch)

    def __post_init__(self) -> None:
        grid = self.simulation.grid
        node_kernel(self.loop.size)  # uses CasADi, which must not run in several threads at the same time
        self.nodes = Nodes(self.motion, grid, self.problem.signals, 0, grid.steps)
        self.batch.groups = [ObservedGroup.of(group, self.motion) for group in self.batch.groups]

    def run(self, progress: Progress | None = None) -> None:
        """Run from 0 to t_end, or until the run diverges."""
        (group,) = self.batch.groups
        observe(group, self.nodes, progress)

    def accuracy(self, metrics: Metrics) -> Accuracy:
        """The error of this run, measured by a run with a finer tolerance; ``metrics`` are the run's metrics."""
        assert self.simulation.tolerance is not None
        finer, counts = max(FINER * self.simulation.tolerance, FINEST), self.motion
        motion = self.motion.again(finer, self.simulation.t_end, FINER_STEP * counts.longest)
        again = replace(self, motion=motion, batch=replace(self.batch))
        try:
            again.run()
            others = again.batch.metrics(self.simulation.grid)
        except InputError:  # the finer tolerance may fail if rounding errors decide on which side of a jump the trajectory is
            again.nodes.recorded[:] = np.nan
            others = None
        figures = metrics.of_member(0)
        del figures["diverged_at"]
        return Accuracy(
            self.simulation.tolerance,
            finer,
            differences(self.nodes.recorded, again.nodes.recorded, compared_rows(self.loop)),
            dict.fromkeys(figures) if others is None else relative_differences(figures, others.of_member(0)),
            counts.steps,
            counts.rejected,
            counts.choices,
        )

    def result(self, judge: Judge | None, *, measured: bool) -> Result:
        """The result; its error is known only if it was ``measured``."""
        grid, loop, batch, problem = self.simulation.grid, self.loop, self.batch, self.problem
        metrics = batch.metrics(grid)
        known = int(np.isfinite(self.nodes.recorded).all(axis=1).sum())
        if self.motion.diverged:
            known = min(known, int(np.searchsorted(grid.time(np.arange(grid.steps + 1)), self.motion.t)))
        t, states = grid.time(np.arange(known)), self.nodes.recorded[:known]
        timed = [signal(run_times(grid, t)) for signal in problem.signals]
        signals = np.vstack([*timed, self.motion.pieces.noise_at(t).T, np.zeros((loop.signals.delayed, known))])
        return Result(
            problem=problem,
            controller=self.controller,
            simulation=self.simulation,
            **series_along(loop, grid, t, states, signals),
            envelope=Envelope.of(batch.blocks(grid), max(known - 1, 0)),
            metrics=metrics,
            stiffness=Stiffness(np.nan, None, 0),
            judge=judge,
            finer_by=1.0,
            judged=None if judge is None else judged(batch, grid, Terms.of(problem, grid, judge)).verdict(0),
            accuracy=self.accuracy(metrics) if measured else None,
        )


def observe(group: Group, nodes: Nodes, progress: Progress | None = None) -> None:
    """Advance a member's motion from 0 to t_end, or to its divergence, together with its group."""
    grid, start = nodes.grid, 0
    while start < grid.steps and np.isnan(group.batch.diverged_step[group.columns]).all():
        stop = grid.tail_start if start < grid.tail_start else grid.steps
        table, steps = nodes.rows(start, stop, MOST_ROWS)
        group.advance(Segment(start, steps, 1, start >= grid.tail_start), table)
        start += steps
        if progress is not None:
            progress(start / grid.steps)
    group.finish(grid.steps, nodes.final())


def motion_of(problem: TrackingProblem, controller: Controller, simulation: Simulation, number: int = 0) -> Motion:
    """The motion at the simulation's tolerance, with this noise stream; raises InputError if a tolerance can't be used with the
    problem or the controller."""
    loop = ClosedLoop.of(problem, controller, bind=bound)
    require_known_instants(loop, problem, simulation)
    assert simulation.tolerance is not None
    with counted_jumps():
        delay = Delay(problem.delay, problem.history) if loop.delayed else None
        return Motion.of(loop, problem.signals, simulation, simulation.tolerance, problem.noise, delay, number)


@contextmanager
def counted_jumps() -> Iterator[None]:
    """Raise InputError for equations with too many jumps to be counted."""
    try:
        yield
    except CountlessError as error:
        raise InputError.of(
            "simulation.tolerance", f"cannot be used with {error}, which has too many jumps: give simulation.dt"
        ) from error


def compared_rows(loop: ClosedLoop) -> dict[str, Array]:
    """The rows of a flat state, by name, that are compared in order to measure an error."""
    rows = np.arange(loop.size)
    return {"x": np.reshape(loop.unpack(rows).x, -1), "theta_hat": rows[loop.theta_hat_rows]}


REFERENCE = 1e-8
"""Tolerance of the run that measures the error of fixed steps. The error of that run is also measured and reported."""
MOST_ATTEMPTS = 10_000_000
"""Largest number of steps of such a run, which takes about ten seconds for a small loop."""


def measured_error(result: Result) -> MeasuredError:
    """The error of a run with fixed steps, or the reason why it is unknown."""
    t, states = result.t, result.states
    try:
        if len(t) < 3:
            raise InputError("the run diverges at once")
        simulation = Simulation(float(t[-1]), tolerance=REFERENCE, record_points=len(t), fused=result.simulation.fused)
        motion = motion_of(result.problem, result.controller, simulation)
        reference = Nodes(motion, simulation.grid, (), 0, len(t) - 1, instants=t)
        reference.through(MOST_ATTEMPTS)
        again = motion.again(FINER * REFERENCE, simulation.t_end, FINER_STEP * motion.longest)
        finer = Nodes(again, simulation.grid, (), 0, len(t) - 1, instants=t)
        finer.through(MOST_ATTEMPTS)
    except InputError as error:
        return MeasuredError(REFERENCE, {}, {}, float(t[-1]), str(error).removesuffix(": give simulation.dt"))
    known = int(np.isfinite(reference.recorded).all(axis=1).sum())
    exact, rows = reference.recorded[:known], compared_rows(motion.attempts.loop)
    own = differences(exact, finer.recorded[:known], rows)
    return MeasuredError(REFERENCE, differences(states[:known], exact, rows), own, float(t[known - 1]))


def simulate_by_tolerance(
    problem: TrackingProblem,
    controllers: Sequence[Controller],
    simulation: Simulation,
    judge: Judge,
    *,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Results:
    """The results of ``simulate`` for a variable-step simulation."""
    watched, made = watched_in_runs(judge, problem), []
    for controller in controllers:
        with named(controller.name):
            made.append(Observation.of(problem, controller, simulation, watched))
    shares = [0.0] * len(made)

    def whole(i: int) -> Result:
        def told(share: float) -> None:
            shares[i] = share
            if progress is not None:
                progress(sum(shares) / len(shares))

        with named(made[i].controller.name):
            made[i].run(told)
            return made[i].result(judge, measured=True)

    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        found = list(pool.map(carried(whole), range(len(made))))
    return Results((one.name, one) for one in found)
