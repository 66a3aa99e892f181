"""Simulates controllers on a problem, each with its own kernel, all in parallel, and records their trajectories."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np

from barbalat import validate
from barbalat.budget import Progress
from barbalat.judge.settings import Judge
from barbalat.loop.around import Around
from barbalat.loop.binding import numbered
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import Held, flatten, map_arrays, unflatten
from barbalat.loop.sampling import Acting
from barbalat.loop.user_errors import named
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.engine.by_tolerance import simulate_by_tolerance
from barbalat.run.engine.engine import Batch, run
from barbalat.run.engine.judging import Terms, judged, watched_in_runs
from barbalat.run.engine.refining import finer_by_along
from barbalat.run.engine.stability_label import MOST_WINDOWS, Run, stiffness_along
from barbalat.run.kernel import costs, delay
from barbalat.run.kernel.breaks import lost_along, lost_order
from barbalat.run.kernel.delay import brings_bends
from barbalat.run.kernel.grid import CHUNK_STEPS, signal_table
from barbalat.run.kernel.metrics import DIVERGENCE_LIMIT
from barbalat.run.kernel.sampled_controller import initial_acting
from barbalat.run.results.missed import MissedSamples
from barbalat.run.results.result import Envelope, Result, Results
from barbalat.run.results.series import series_along
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array


def simulate(
    problem: TrackingProblem,
    controllers: Controller | Iterable[Controller],
    simulation: Simulation,
    *,
    judge: Judge | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Results:
    """Run every controller on the problem and return the results by controller name; equal names are numbered.

    judge     the criteria for the verdicts; derived from the model's motion by default
    threads   all cores by default; results do not depend on it
    progress  called with the completed fraction

    Raises InputError, with the controller's name, if it does not fit the problem, and if the runs exceed the budget. A run that
    diverges is a result and not an error.
    """
    validate.instance("problem", problem, TrackingProblem)
    validate.instance("simulation", simulation, Simulation)
    controllers, judge = numbered(controllers), Judge() if judge is None else judge
    validate.instance("judge", judge, Judge)
    judge = judge.named(problem)
    if simulation.tolerance is not None:
        return simulate_by_tolerance(problem, controllers, simulation, judge, threads=threads, progress=progress)
    delay.require_memory(problem.delay, len(problem.history), len(controllers), simulation.dt)
    loops = []
    for controller in controllers:
        with named(controller.name):
            loops.append(ClosedLoop.of(problem, controller))
    costs.require_runs(problem, loops, simulation)
    batches = []
    for controller in controllers:
        with named(controller.name):
            watched = watched_in_runs(judge, problem)
            batches.append(Batch.of([(problem, controller)], simulation, record=True, windows=MOST_WINDOWS, watched=watched))
    run(batches, problem.signals, simulation, threads=threads, progress=progress)
    runs = zip(controllers, batches, strict=True)
    return Results((c.name, result_of(problem, c, simulation, batch, judge)) for c, batch in runs)


def result_of(
    problem: TrackingProblem, controller: Controller, simulation: Simulation, batch: Batch, judge: Judge | None = None
) -> Result:
    """The result of a recorded batch of one member after its run; without a ``judge`` there is no verdict."""
    loop, blocks, stop = batch.loop, batch.blocks(simulation), np.inf
    steps = np.append(blocks.starts, simulation.steps)
    states = np.vstack([blocks.states[:, :, 0], batch.final_states.T])
    metrics = batch.metrics(simulation)
    if not np.isnan(metrics.diverged_at[0]):
        stop = batch.diverged_step[0]
        kept = int(np.searchsorted(steps, stop))  # the instants before divergence
        steps, states = steps[:kept], states[:kept]
    made = Run(problem, simulation, batch, steps, states, stop)
    t, signals, states = simulation.time(steps), made.signals(steps), made.acted(steps, states)
    series = series_along(loop, simulation, t, states, signals)
    return Result(
        problem=problem,
        controller=controller,
        simulation=simulation,
        **series,
        envelope=Envelope.of(blocks, max(len(steps) - 1, 0)),
        metrics=metrics,
        stiffness=stiffness_along(made),
        judge=judge,
        finer_by=finer_by_along(batch, simulation, states, signals.T),
        judged=None if judge is None else judged(batch, simulation, Terms.of(problem, simulation, judge)).verdict(0),
        lost=lost_along(
            lost_order(problem.signals, simulation, delayed=loop.delayed, bends=brings_bends(loop)),
            loop,
            simulation,
            metrics.max_abs_u.reshape(1, -1),
            series["theta_hat"],
        ),
    )


@dataclass(frozen=True, eq=False)
class Recording:
    """K samples from t = 0 on.

    measured   (K, n) or (K, 1), as the controller received it, including noise and lag
    commands   (K, q)
    states     (K, S) the controller's flat state after each sample, in the form of ``loop.sampling.Acting``
    """

    loop: ClosedLoop
    measured: Array
    commands: Array
    states: Array


def recorded(problem: TrackingProblem, controller: Controller, simulation: Simulation, samples: int) -> Recording:
    """The first samples of the run that ``simulate`` makes, at most ``samples``; raises InputError if the controller does not
    fit."""
    simulation.require_steps("an export")
    batch = Batch.of([(problem, controller)], simulation, lanes=1)
    (group,), every = batch.groups, batch.rhythm.sample_every
    assert every, "only a sampled controller has samples"
    kept = list(_each(batch, problem, simulation, 0, every, min(samples, -(-simulation.steps // every))))
    # a block begins before its sample, so the state after a sample is at the beginning of the next block
    flat = np.vstack([*kept, group.state.T])[1:]
    own = len(flatten(initial_acting(batch.loop)))
    held = batch.loop.unpack(np.arange(batch.loop.size)).held
    return Recording(batch.loop, flat[:, held.measured.reshape(-1)], flat[:, held.r.reshape(-1)], flat[:, -own:])


def _each(batch: Batch, problem: TrackingProblem, simulation: Simulation, first: int, every: int, count: int) -> Iterator[Array]:
    """The loop's states, (blocks, S), at the beginning of ``count`` blocks of ``every`` steps, from step ``first`` on."""
    (group,), shape = batch.groups, batch.program.shape
    at_once = max(1, CHUNK_STEPS // every)
    for done in range(0, count, at_once):
        blocks, start = min(at_once, count - done), first + done * every
        table = signal_table(problem.signals, simulation, start, blocks * every, in_pieces=shape.in_pieces)
        yield group.call(start, blocks, every, group.state, table)[:, : shape.states, 0]


def _between(every: int) -> int:
    """The number of steps from a sample to halfway to the next one; the jitter of a timer is at most a quarter of a sample."""
    return every - every // 2


def _halfway(batch: Batch, problem: TrackingProblem, simulation: Simulation, every: int, count: int) -> Iterator[Array]:
    """The loop's states, (samples, S), halfway after each of the first ``count`` samples."""
    (group,), between = batch.groups, _between(every)
    table = signal_table(problem.signals, simulation, 0, between, in_pieces=batch.program.shape.in_pieces)
    group.call(0, 1, between, group.state, table)
    yield from _each(batch, problem, simulation, between, every, count - 1)
    yield group.state.T


def largest_numbers(problem: TrackingProblem, controller: Controller, simulation: Simulation) -> Array:
    """The largest magnitude of each number that a sampled controller keeps over the run that ``simulate`` makes, up to its
    divergence: its flat state, followed by the bump of a shell."""
    batch = Batch.of([(problem, controller)], simulation, lanes=1)
    template, T = initial_acting(batch.loop), batch.loop.sample_time
    assert T is not None
    first, every = flatten(template), round(T / simulation.dt)
    acting: Acting = unflatten(template, np.arange(len(first)), 0)[0]
    rows = flatten(acting._replace(held=acting.held._replace(around=acting.held.around and acting.held.around.bump)))
    found = np.abs(first[rows])
    for states in _halfway(batch, problem, simulation, every, simulation.steps // every + 1):
        part = np.abs(states[:, len(states.T) - len(first) + rows])
        good = (part <= DIVERGENCE_LIMIT).all(axis=1)
        count = len(good) if good.all() else int(np.argmin(good))
        found = np.maximum(found, part[:count].max(axis=0, initial=0.0))
        if count < len(good):
            break
    return found


def with_missed_samples(results: Mapping[str, Result]) -> Results:
    """Return the results, with ``missed`` for each sampled controller with a shell or faults.

    Each of these runs is repeated, bit for bit, and evaluated between successive samples. Results of diverged runs and of
    variable-step runs are unchanged.
    """
    return Results({name: replace(one, missed=_missed(one)) for name, one in results.items()})


def _missed(result: Result) -> MissedSamples | None:
    computer, simulation, problem = result.loop.computer, result.simulation, result.problem
    if computer is None or computer.around is None or not np.isnan(result.metrics.diverged_at[0]):
        return None
    if simulation.tolerance is not None:
        return None
    around = computer.around
    batch = Batch.of([(problem, result.controller)], simulation, lanes=1)
    every = round(around.T / simulation.dt)  # with jitter the loop checks its timer at every step
    initial, count = batch.groups[0].state.T.copy(), max(simulation.steps - _between(every), 0) // every + 1
    states = np.vstack(list(_halfway(batch, problem, simulation, every, count)))
    held = batch.loop.unpack(np.arange(batch.loop.size)).held
    if around.longest is not None:
        outage = states[:, held.around.outage[0]]
    else:
        missed = np.maximum(states[:, held.around.lost[0]], _refused(around, held, np.vstack([initial, states])))
        outage = np.array(list(accumulate(missed, lambda before, lost: (before + 1) * lost)))
    commands = states[:, held.around.lost[1]] > 0
    if around.checks_commands:
        commands |= (states[:, held.around.commanded] != states[:, held.r.reshape(-1)]).any(axis=1)
    longest = np.inf if around.longest is None else around.longest
    return MissedSamples(
        count,
        missed=int((outage > 0).sum()),
        in_a_row=int(outage.max()),
        fallback=int((outage > longest).sum()),
        named=around.fallback,
        commands=int(commands.sum()),
        jitter=sum(one.time for one in around.faults) / simulation.dt,
    )


def _refused(around: Around, rows: Held, states: Array) -> Array:
    """(K,) 1 for each sample that a shell without a counter rejects, from (K + 1) states, the first of which precedes all
    samples."""
    before = map_arrays(lambda part: states[:-1, part].T, rows)
    return 1.0 - around.plausible(states[1:, rows.around.offered].T, states[:-1, rows.measured.reshape(-1)].T, before, 1.0)
