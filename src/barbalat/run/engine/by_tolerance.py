"""Runs whose steps follow from a tolerance: observed during integration, and repeated once to measure their error."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
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
from barbalat.run.engine.motion import Motion, Nodes, compiled_attempts
from barbalat.run.kernel.grid import Segment
from barbalat.run.kernel.members import Members
from barbalat.run.kernel.metrics import Metrics
from barbalat.run.kernel.observer import observer_program
from barbalat.run.kernel.pieces import Pieces, past_of, require_known_instants
from barbalat.run.kernel.portable import run_times
from barbalat.run.kernel.step import CompiledLoop
from barbalat.run.results.accuracy import Accuracy, MeasuredError, differences, relative_differences
from barbalat.run.results.result import Envelope, Result, Results
from barbalat.run.results.series import series_along
from barbalat.run.results.spectrum import Stiffness
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

MOST_ROWS = 1 << 15
"""Approximate size of a table of nodes: some megabytes."""
FINER = 1 / 32
"""Factor from the tolerance to that of the second run, which measures the first run's error; its own error is some 20 times
smaller."""
COUNTED = 200_000
"""Attempts from which the number in a whole run is extrapolated: half a second."""
FINEST = 1e-14
"""Least tolerance of a second run; below it rounding dominates."""


@dataclass(eq=False)
class ObservedBatch(Batch):
    """Members, each observed at the nodes of its motion. ``remembered``: number of entries of the kernel's state after the
    judge's memory."""

    remembered: int = 0

    def metrics(self, simulation: Simulation) -> Metrics:
        """See ``Batch.metrics``; the divergence time is that of the motion."""
        motions = [group.motion for group in self.groups if isinstance(group, ObservedGroup) and group.motion is not None]
        ended = [motion.t if motion.diverged else np.nan for motion in motions]
        return replace(super().metrics(simulation), diverged_at=np.array(ended))

    def _unjudged(self, width: int) -> list[Array]:
        return [*super()._unjudged(width), np.zeros((self.remembered, width))]


@dataclass(eq=False)
class ObservedGroup(Group):
    """The only member of an observed batch, with the motion that continues after its run."""

    motion: Motion | None = None

    @classmethod
    def of(cls, group: Group, motion: Motion) -> ObservedGroup:
        """The group that continues with this motion."""
        given = {name: getattr(group, name) for name in Group.__dataclass_fields__}
        return cls(**given, motion=motion)

    def at_end(self) -> Array:
        """See ``Group.at_end``: the motion includes a sample that is due at the end, which affects no figure but extrema."""
        assert self.motion is not None
        state = super().at_end()
        state[: len(self.motion.x), 0] = self.motion.x
        return state

    def beside(self) -> Group:
        """See ``Group.beside``."""
        assert self.motion is not None
        return replace(self, state=self.at_end(), motion=self.motion.copied())

    def held_rows(self, simulation: Simulation, step: int, steps: int, values: Array) -> Array:
        """See ``Group.held_rows``."""
        assert self.motion is not None
        self.motion = self.motion.held(values, float(simulation.time(step + steps)))
        nodes = Nodes(self.motion, simulation, (), step, step + steps, held=values)
        return nodes.rows(step, step + steps, 1 << 62)[0]


@dataclass(eq=False)
class Observation:
    """A run that is being computed."""

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
        """InputError if a tolerance can't be used with the problem or the controller; ``number`` selects the noise stream."""
        motion = motion_of(problem, controller, simulation, number)
        loop = motion.attempts.loop
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
        """Run from 0 to t_end, or to the divergence."""
        (group,) = self.batch.groups
        observe(group, self.nodes, progress)

    def accuracy(self, metrics: Metrics) -> Accuracy:
        """The error that the tolerance gave, measured by a run with a finer one; ``metrics`` are the run's figures."""
        assert self.simulation.tolerance is not None
        finer, counts = max(FINER * self.simulation.tolerance, FINEST), self.motion
        again = replace(self, motion=self.motion.again(finer, self.simulation.t_end), batch=replace(self.batch))
        try:
            again.run()
            others = again.batch.metrics(self.simulation.grid)
        except InputError:  # the finer tolerance may fail if rounding decides which side of a jump the motion is on
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
        """The result; its error is known only if it is ``measured``."""
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


def run_members(members: Members, which: slice, *, threads: int | None = None, progress: Progress | None = None) -> ObservedBatch:
    """Some of the members after their runs, each with its own steps, in one shared kernel.

    The results don't depend, to any bit, on the threads or on the other members. InputError, with its number, for a member that
    stalls.
    """
    attempts, grid = members.attempts, members.simulation.grid
    assert attempts is not None
    states, parameters = members.states[:, which], members.parameters[:, which]
    batch = ObservedBatch(members.loop, members.program, states, parameters, lanes=1, steps=inf, remembered=members.remembered)
    code = compiled_attempts(*attempts.lists, attempts.shape)

    def whole(i: int) -> None:
        motion = _of_member(members, code, which.start + i)
        group = batch.groups[i] = ObservedGroup.of(batch.groups[i], motion)
        try:
            observe(group, Nodes(motion, grid, members.signals, 0, grid.steps))
        except InputError as error:
            raise InputError(f"member {which.start + i + 1}: {error}") from error
        group.motion = motion.ended()
        done[i] = True
        if progress is not None:
            progress(float(done.mean()))

    done = np.zeros(len(batch.groups), dtype=bool)
    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        list(pool.map(whole, range(len(batch.groups))))
    return batch


def _of_member(members: Members, code: CompiledLoop, i: int) -> Motion:
    """The motion of member ``i``, counted from 0, at t = 0."""
    simulation, attempts = members.simulation, members.attempts
    assert attempts is not None
    assert simulation.tolerance is not None
    noise = None if members.problem is None else members.problem.noise
    own = None if noise is None or members.seeds is None else replace(noise, seed=int(members.seeds[i]))
    pieces = Pieces(attempts, own, int(members.numbers[i]))
    start, parameters = members.states[:, i].copy(), members.parameters[:, i].copy()
    return Motion.begun(pieces, code, start, parameters, simulation, simulation.tolerance)


def expected_attempts(members: Members) -> float:
    """The attempts that the first member's run takes, extrapolated from the first ``COUNTED`` of them if it takes more."""
    attempts = members.attempts
    assert attempts is not None
    motion = _of_member(members, compiled_attempts(*attempts.lists, attempts.shape), 0)
    try:
        while not motion.over and motion.steps + motion.rejected < COUNTED:
            motion.further()
    except InputError as error:
        raise InputError(f"member 1: {error}") from error
    share = 1.0 if motion.over else motion.t / members.simulation.t_end
    return (motion.steps + motion.rejected) / share


def motion_of(problem: TrackingProblem, controller: Controller, simulation: Simulation, number: int = 0) -> Motion:
    """The motion at the simulation's tolerance, with this noise stream; InputError if a tolerance can't be used with the
    problem or the controller."""
    loop = ClosedLoop.of(problem, controller, bind=bound)
    require_known_instants(loop, problem, simulation)
    assert simulation.tolerance is not None
    with counted_jumps():
        past = past_of(loop, problem)
        return Motion.of(loop, problem.signals, simulation, simulation.tolerance, problem.noise, past, number)


@contextmanager
def counted_jumps() -> Iterator[None]:
    """InputError for equations with innumerable jumps."""
    try:
        yield
    except CountlessError as error:
        raise InputError.of(
            "simulation.tolerance", f"cannot be used with {error}, which has too many jumps: give simulation.dt"
        ) from error


def compared_rows(loop: ClosedLoop) -> dict[str, Array]:
    """The rows of a flat state that are compared to measure an error, by name."""
    rows = np.arange(loop.size)
    return {"x": np.reshape(loop.unpack(rows).x, -1), "theta_hat": rows[loop.theta_hat_rows]}


REFERENCE = 1e-8
"""Tolerance of the run that measures the error of fixed steps; its own error is also measured and reported."""
MOST_ATTEMPTS = 10_000_000
"""Largest number of steps of such a run: some ten seconds for a small loop."""


def measured_error(result: Result) -> MeasuredError:
    """The error of a run with fixed steps, or the reason why it is unknown."""
    t, states = result.t, result.states
    try:
        if len(t) < 3:
            raise InputError("the run diverges at once")
        simulation = Simulation(float(t[-1]), tolerance=REFERENCE, record_points=len(t), fused=result.simulation.fused)
        motion = motion_of(result.problem, result.controller, simulation)
        reference, finer = (
            Nodes(one, simulation.grid, (), 0, len(t) - 1, instants=t)
            for one in (motion, motion.again(FINER * REFERENCE, simulation.t_end))
        )
        for nodes in (reference, finer):
            nodes.through(MOST_ATTEMPTS)
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
    measured: bool = True,
) -> Results:
    """The results of ``simulate`` for a simulation with a tolerance."""
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
