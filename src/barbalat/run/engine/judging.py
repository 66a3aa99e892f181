"""Verdicts on batches after their runs; suspected limit cycles are continued with all signals held, in their own kernels."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from barbalat.judge.appended import Watched
from barbalat.judge.cycles import (
    FEWEST_WINDOWS,
    FIRST_PIECES,
    MOST_WINDOWS,
    SLOWEST_PERIODS,
    Windows,
    enough_windows,
    explained,
    frequency_of,
    quiet,
    slowest_period,
    suspects,
    window,
)
from barbalat.judge.held import Held
from barbalat.judge.judged import Cycles, Judged, Kept
from barbalat.judge.scale import Uncommanded, scale_of
from barbalat.judge.settings import Judge, component_names
from barbalat.judge.verdict import FOLLOWS_SHARE
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.faults import Bias, FaultSignal, Latency
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Signal, SlopedSignal
from barbalat.run.engine.continued import Continuation, Continuing, Seen
from barbalat.run.engine.engine import Batch
from barbalat.signals import Constant
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array


def watched_in_sweeps(judge: Judge) -> Watched:
    """The judge's memory for members that need only a verdict."""
    return Watched(judge.cycle, weighed=True)


def watched_in_runs(judge: Judge, problem: TrackingProblem) -> Watched:
    """The judge's memory for a single run, which also contains the metrics and, if the command moves in steps, the step
    responses."""
    names, (A, B, C) = component_names(problem), problem.model.matrices
    stepping = all(isinstance(one, SlopedSignal) and one.slope == 0 for one in problem.commands)
    found = Watched(judge.cycle, detailed=True, settles=FOLLOWS_SHARE)
    if not stepping or np.linalg.matrix_rank(A) < len(A):
        return found
    gains = np.reshape(-C @ np.linalg.solve(A, B), (len(names), -1))
    gains = np.where(np.abs(gains) > GAIN_ROUNDING * np.abs(gains).max(initial=0.0), gains, 0.0)
    bands = tuple(judge.follows.get(name, np.nan) for name in names)
    return replace(found, gains=tuple(map(tuple, gains.tolist())), bands=bands)


GAIN_ROUNDING = 1e-9
"""A component whose steady-state gain is below this fraction of the largest gain counts as zero: the component returns after a
step."""


@dataclass(frozen=True, eq=False)
class Terms:
    """The data for judging runs of one problem: settings, the components' names and units, the signals of the tail.

    declared  numbers of the components that are declared to follow a command
    slowest   the longest period of the model's modes [s]
    """

    judge: Judge
    names: tuple[str, ...]
    units: tuple[str, ...]
    input_units: tuple[str, ...]
    held: Held
    slowest: float
    uncommanded: Uncommanded
    declared: tuple[int, ...]

    @classmethod
    def of(cls, problem: TrackingProblem, simulation: Simulation, judge: Judge) -> Terms:
        """Raise InputError for a band on a component that the problem does not have."""
        judge, names, labels = judge.named(problem), component_names(problem), problem.labels
        return cls(
            judge,
            names,
            tuple("" if labels is None else labels.unit(i) for i in range(len(names))),
            () if labels is None else tuple(labels.input_units),
            Held.of(_without_passing(problem.signals), float(simulation.time(simulation.tail_start)), simulation.t_end),
            slowest_period(problem.model.matrices[0]),
            Uncommanded.of(problem, simulation.t_end),
            tuple(sorted({one for one in problem.declared_followers if one is not None})),
        )


LASTING = (Bias, Latency)
"""Faults that a continuation holds at their largest values, like disturbances; the others are temporary and end with the
noise."""


def passes(signal: Signal) -> bool:
    """Whether the signal is a temporary fault."""
    return isinstance(signal, FaultSignal) and not isinstance(signal.fault, LASTING)


def _without_passing(signals: Sequence[Signal]) -> list[Signal]:
    """The signals with temporary faults set to 0: holding a lost measurement would open the loop permanently."""
    return [Constant(amplitude=0.0) if passes(one) else one for one in signals]


def judged(
    batch: Batch,
    simulation: Simulation,
    terms: Terms,
    *,
    among: Array | None = None,
    frequencies: bool = True,
    excused: bool = False,
    threads: int | None = None,
) -> Judged:
    """The verdicts on a batch after its run.

    among        (M,) members that are searched for limit cycles; all by default
    excused      whether to skip the long examination of members that follow the model and whose control reversals are explained
                 by the command
    frequencies  whether to measure the frequencies of limit cycles, each of which takes at least one more window of the run
    """
    loop, kept, held, judge = batch.loop, kept_of(batch), terms.held, terms.judge
    diverged = ~np.isnan(batch.diverged_step)
    scale = scale_of(kept.of("largest y_m"), _initial(batch), _noise(loop), terms.uncommanded)
    bands = judge.bands(terms.names, terms.units, scale, terms.declared)
    with np.errstate(invalid="ignore"):
        lost = diverged | ~(kept.of("largest y") <= bands.lost).all(axis=1)
        suspect = suspects(kept.reversals)
        if excused:
            follows = (kept.of("largest e") <= bands.follows).all(axis=1)
            suspect &= ~(follows & explained(kept.reversals, kept.swings, _limited(kept, simulation), held))
        suspect = (suspect | judge.closely) & ~lost
    if among is not None:
        suspect &= among
    cycles = _cycles(
        batch, simulation, kept, held, suspect, judge.cycle, terms.slowest, threads, limits=bands.lost, frequencies=frequencies
    )
    lost_at, lost_within = _lost_at(batch, simulation, bands.lost)
    return Judged.of(
        kept,
        bands,
        cycles,
        lost_at=lost_at,
        lost_within=lost_within,
        diverged=diverged,
        dt=simulation.dt,
        steps=simulation.steps,
        input_units=terms.input_units,
    )


def tail_is_short(problem: TrackingProblem, simulation: Simulation) -> bool:
    """Whether the tail may hide a limit cycle as slow as the model: it is shorter than SLOWEST_PERIODS of the slowest mode."""
    tail = simulation.t_end - float(simulation.time(simulation.tail_start))
    return tail < SLOWEST_PERIODS * slowest_period(problem.model.matrices[0])


def kept_of(batch: Batch) -> Kept:
    """The judge's memory of all members."""
    memory = batch.program.memory
    assert memory is not None, "this batch ran without a judge"
    whole, before = [], []
    for group in batch.groups:
        count = group.columns.stop - group.columns.start
        assert group.judged is not None
        whole.append(group.judged[:, :count])
        before.append((group.judged if group.before_tail is None else group.before_tail)[:, :count])
    return Kept(memory, np.concatenate(before, axis=1), np.concatenate(whole, axis=1))


def _limited(kept: Kept, simulation: Simulation) -> Array:
    """(M, m) the fraction of the tail for which each control is at a limit, or at its rate limit."""
    memory, tail = kept.memory, simulation.steps - simulation.tail_start
    at_limit = kept.of_inputs("at limit", memory.limited, in_tail=True)
    return (at_limit + kept.of_inputs("at rate limit", memory.rate_limited, in_tail=True)) / tail


def _initial(batch: Batch) -> Array:
    """(M, n) the components at t = 0; zeros with output feedback, because such a plant starts at rest."""
    loop = batch.loop
    if loop.measured_outputs:
        return np.zeros((batch.states.shape[1], loop.errors))
    rows = np.asarray(loop.unpack(np.arange(loop.size)).x).reshape(-1)
    return np.asarray(loop.plant.output(batch.states[rows])).T


def _noise(loop: ClosedLoop) -> Array | None:
    return None if loop.noise_std is None or len(loop.noise_std) != loop.errors else np.abs(loop.noise_std)


def _lost_at(batch: Batch, simulation: Simulation, lost: Array) -> tuple[Array, Array]:
    """(M,) the time [s] at which a run diverged, exact to the step, or by which a component had left its band according to the
    record; NaN if neither is known. Also (M,) how much earlier this may have happened [s]: the length of the recorded block, or 0
    for a divergence."""
    found, within = np.asarray(simulation.time(batch.diverged_step)), np.zeros(len(batch.diverged_step))
    if not batch.record:
        return found, within
    blocks, memory = batch.blocks(simulation), batch.program.memory
    assert memory is not None
    ends = np.append(blocks.starts, blocks.starts[-1] + blocks.lengths[-1])
    own = kept_of(batch).of("largest y").T
    largest = np.concatenate([blocks.memory[:, memory.places["largest y"]], own[None]])
    with np.errstate(invalid="ignore"):
        beyond = (largest > lost.T).any(axis=1)  # (B + 1, M)
    first = beyond.argmax(axis=0)
    passed = np.where(beyond.any(axis=0), simulation.time(ends[first]), np.nan)
    earlier = np.fmin(found, passed) < np.nan_to_num(found, nan=np.inf)
    pieces = np.diff(np.append(0.0, simulation.time(ends)))[first]
    return np.where(earlier, passed, found), np.where(earlier, pieces, within)


SAMPLES_EACH_REVERSAL = 20
"""Samples per cycle of a measured frequency: the reversal times are then known to 1/20 of the interval between two of them."""


def _cycles(
    batch: Batch,
    simulation: Simulation,
    kept: Kept,
    held: Held,
    suspect: Array,
    share: float,
    slowest: float,
    threads: int | None,
    *,
    limits: Array,
    frequencies: bool,
) -> Cycles:
    """``limits`` (M, n) are the magnitudes beyond which a run is lost."""
    members, inputs = len(suspect), kept.memory.inputs
    if not suspect.any():
        return Cycles.none(members, inputs, suspect)
    band = share * kept.ranges
    tail = simulation.t_end - float(simulation.time(simulation.tail_start))
    reversals = kept.reversals
    amplitude, frequency = np.zeros((members, inputs)), np.zeros((members, inputs))
    which, growing, lost = np.zeros((members, inputs), dtype=bool), np.zeros(members, dtype=bool), np.zeros(members, dtype=bool)

    def look(some: Continuing) -> None:
        members = np.arange(len(suspect))[some.columns]
        at = np.flatnonzero(suspect[members])
        lengths = np.array([window(slowest, tail, seen, simulation.t_end) for seen in reversals[members[at]].max(axis=1)])
        for length in np.unique(lengths):
            steps, going = max(round(length / simulation.dt), 1), some.continued(simulation, held.values)
            for found, largest, now in _decisions(going, steps, band[members], at[lengths == length]):
                rows, cycling = members[now], found.cycling(band[members])[now]
                which[rows], growing[rows] = cycling, found.growing(band[members])[now]
                lost[rows] = found.lost[now] | ~(largest[now] <= limits[rows]).all(axis=1)
                amplitude[rows] = np.where(cycling, 0.5 * found.swing[-1][now], 0.0)
                if frequencies:
                    frequency[rows] = _frequencies(going, steps, found.reversals[-1][now], cycling, now)

    pending = batch.together([group for group in batch.groups if suspect[group.columns].any()])
    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        list(pool.map(look, pending))
    return Cycles(which, amplitude, frequency, suspect, growing, lost)


def _decisions(going: Continuation, steps: int, band: Array, members: Array) -> Iterator[tuple[Windows, Array, Array]]:
    """The windows that decide the class of these ``members`` of a group, (M, n) the largest magnitudes of the components, and the
    members whose class they decide.

    Each member is judged by the first windows that decide its class, so no verdict depends on the other members of a group.
    """
    seen: list[Seen] = []
    if steps >= FIRST_PIECES:
        ends = [i * steps // FIRST_PIECES for i in range(FIRST_PIECES + 1)]
        pieces = [going.window(end - begin, members) for begin, end in pairwise(ends)]
        seen.append(Seen.together(pieces))
        rests = quiet(np.array([one.high - one.low for one in pieces]), band) & ~seen[0].lost
        members = members[~rests[members]]
    while len(members):
        seen.append(going.window(steps, members))
        if len(seen) < FEWEST_WINDOWS:
            continue
        with np.errstate(invalid="ignore"):
            swing = np.array([one.high - one.low for one in seen])
        found = Windows(swing, np.array([one.reversals for one in seen]), seen[-1].lost)
        over = found.decided(band)[members] | (len(seen) == MOST_WINDOWS)
        if over.any():
            yield found, np.max([one.largest for one in seen], axis=0), members[over]
        members = members[~over]


def _frequencies(going: Continuation, steps: int, reversals: Array, cycling: Array, members: Array) -> Array:
    """(K, m) [rad/s] frequencies of the controls of K ``members`` that cycle, from the continuation; 0 for the others.
    ``reversals`` (K, m)."""
    turned, found = reversals.max(axis=1), np.zeros(cycling.shape)
    for count in np.unique(turned[cycling.any(axis=1)]):
        windows, which = enough_windows(count), np.flatnonzero((cycling & (turned == count)[:, None]).any(axis=1))
        t, path = going.copied().traced(windows * steps, int(SAMPLES_EACH_REVERSAL * windows * count), members[which])
        for i, row in enumerate(which):
            for j in np.flatnonzero(cycling[row]):
                found[row, j] = frequency_of(t, path[:, i, j])
    return found
