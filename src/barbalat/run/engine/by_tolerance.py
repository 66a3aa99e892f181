"""Runs whose steps follow from a tolerance: observed beside their integration, and made once more to measure their error."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from math import inf

import numpy as np

from barbalat.budget import Progress
from barbalat.judge.beside import Watched
from barbalat.judge.settings import Judge
from barbalat.loop.binding import bound
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.user_errors import named
from barbalat.lowering.switching import CountlessError
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.engine.engine import Batch, Group
from barbalat.run.engine.judging import Terms, judged, watched_in_runs
from barbalat.run.engine.motion import Motion, Nodes
from barbalat.run.kernel.grid import Segment
from barbalat.run.kernel.observer import observer_program
from barbalat.run.kernel.pieces import require_within
from barbalat.run.kernel.portable import run_times
from barbalat.run.results.accuracy import Accuracy
from barbalat.run.results.result import Envelope, Result, Results
from barbalat.run.results.series import series_along
from barbalat.run.results.spectrum import Stiffness
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

MOST_ROWS = 1 << 15
"""Of a table of nodes, about: some megabytes."""
FINER = 1 / 32
"""Of the tolerance, that of the second run, which measures the first one's error: its own is some 20 times smaller."""
FINEST = 1e-14
"""Tolerance of a second run, at least: below it roundings decide."""


@dataclass(eq=False)
class ObservedBatch(Batch):
    """One member, seen at the nodes of its motion. ``remembered``: entries of the kernel's state behind the judge's memory."""

    remembered: int = 0

    def _unjudged(self, width: int) -> list[Array]:
        return [*super()._unjudged(width), np.zeros((self.remembered, width))]


@dataclass(eq=False)
class ObservedGroup(Group):
    """The one member of an observed batch, with the motion that goes on behind its run."""

    motion: Motion | None = None

    @classmethod
    def of(cls, group: Group, motion: Motion) -> ObservedGroup:
        """The group that goes on with this motion."""
        given = {name: getattr(group, name) for name in Group.__dataclass_fields__}
        return cls(**given, motion=motion)

    def beside(self) -> Group:
        """See ``Group.beside``."""
        assert self.motion is not None
        return replace(self, state=self.state.copy(), motion=self.motion.copied())

    def held_rows(self, simulation: Simulation, step: int, steps: int, values: Array) -> Array:
        """See ``Group.held_rows``."""
        assert self.motion is not None
        self.motion = self.motion.held(values, float(simulation.time(step + steps)))
        nodes = Nodes(self.motion, simulation, (), step, step + steps, held=values)
        return nodes.rows(step, step + steps, 1 << 62)[0]


@dataclass(eq=False)
class Observation:
    """A controller's run in the making."""

    problem: TrackingProblem
    controller: Controller
    simulation: Simulation
    loop: ClosedLoop
    motion: Motion
    batch: ObservedBatch
    nodes: Nodes = field(init=False)

    @classmethod
    def of(cls, problem: TrackingProblem, controller: Controller, simulation: Simulation, watched: Watched | None) -> Observation:
        """InputError where no tolerance goes with the problem or the controller."""
        loop = ClosedLoop.of(problem, controller, bind=bound)
        require_known_instants(loop, problem, simulation)
        assert simulation.tolerance is not None
        try:
            motion = Motion.of(loop, problem.signals, simulation, simulation.tolerance, problem.noise)
        except CountlessError as error:
            raise InputError.of(
                "simulation.tolerance", f"takes no equations with {error}, whose jumps are countless: give simulation.dt"
            ) from error
        program, remembered = observer_program(loop, simulation.grid.dt, watched, fused=simulation.fused)
        batch = ObservedBatch(
            loop, program, loop.initial()[:, None], np.zeros((0, 1)), record=True, lanes=1, steps=inf, remembered=remembered
        )
        return cls(problem, controller, simulation, loop, motion, batch)

    def __post_init__(self) -> None:
        grid = self.simulation.grid
        self.nodes = Nodes(self.motion, grid, self.problem.signals, 0, grid.steps)
        self.batch.groups = [ObservedGroup.of(group, self.motion) for group in self.batch.groups]

    def run(self, progress: Progress | None = None) -> None:
        """From 0 to t_end, or to its divergence."""
        grid, (group,), start = self.simulation.grid, self.batch.groups, 0
        while start < grid.steps and np.isnan(self.batch.diverged_step).all():
            stop = grid.tail_start if start < grid.tail_start else grid.steps
            table, steps = self.nodes.rows(start, stop, MOST_ROWS)
            group.advance(Segment(start, steps, 1, start >= grid.tail_start), table)
            start += steps
            if progress is not None:
                progress(start / grid.steps)
        group.finish(grid.steps, self.nodes.final())

    def accuracy(self) -> Accuracy:
        """What the run's tolerance came to, by a run at a finer one."""
        assert self.simulation.tolerance is not None
        finer = max(FINER * self.simulation.tolerance, FINEST)
        again = Nodes(self.motion.again(finer, self.simulation.t_end), self.simulation.grid, (), 0, self.simulation.steps)
        try:
            again.through()
        except InputError:  # of the finer tolerance, with which roundings may decide where the equations jump
            again.recorded[:] = np.nan
        parts = self.loop.unpack(np.arange(self.loop.size))
        rows = {"x": np.reshape(parts.x, -1), "theta_hat": np.arange(self.loop.size)[self.loop.theta_hat_rows]}
        counts = self.motion
        return Accuracy.of(
            self.simulation.tolerance,
            finer,
            self.nodes.recorded,
            again.recorded,
            rows,
            counts.steps,
            counts.rejected,
            counts.choices,
        )

    def result(self, judge: Judge | None, *, measured: bool) -> Result:
        """What came of it; without ``measured`` its error is not known."""
        grid, loop, batch, problem = self.simulation.grid, self.loop, self.batch, self.problem
        metrics = batch.metrics(grid)
        known = int(np.isfinite(self.nodes.recorded).all(axis=1).sum())
        if self.motion.diverged:
            metrics = replace(metrics, diverged_at=np.array([self.motion.t]))
            known = min(known, int(np.searchsorted(grid.time(np.arange(grid.steps + 1)), self.motion.t)))
        t, states = grid.time(np.arange(known)), self.nodes.recorded[:known]
        timed = [signal(run_times(grid, t)) for signal in problem.signals]
        signals = np.vstack([*timed, self.motion.pieces.noise_at(t).T])
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
            accuracy=self.accuracy() if measured else None,
        )


def require_known_instants(loop: ClosedLoop, problem: TrackingProblem, simulation: Simulation) -> None:
    """InputError for what no tolerance goes with yet, and for samples of which there would be none."""
    if loop.sample_time is not None:
        require_within("sample_time", loop.sample_time, simulation.t_end)
    if problem.noise is not None:
        require_within("sensor.noise.sample_time", problem.noise.sample_time, simulation.t_end)
    if problem.faults:
        raise InputError.of("simulation.tolerance", "takes samples without faults: give simulation.dt")
    if loop.delayed:
        raise InputError.of("simulation.tolerance", "takes a plant without a delay at its input: give simulation.dt")
    if any(path is not None and path.rate_limit is not None for path in loop.paths):
        raise InputError.of("simulation.tolerance", "takes an input without a rate limit: give simulation.dt")


def simulate_by_tolerance(
    problem: TrackingProblem,
    controllers: Sequence[Controller],
    simulation: Simulation,
    judge: Judge,
    *,
    threads: int | None = None,
    progress: Progress | None = None,
    measured: bool = True,
) -> Results:
    """What ``simulate`` gives back, for a simulation with a tolerance."""
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
            return made[i].result(judge, measured=measured)

    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        found = list(pool.map(whole, range(len(made))))
    return Results((one.name, one) for one in found)
