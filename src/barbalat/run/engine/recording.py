"""The samples of a sampled controller along a run, to the last bit: what it was handed, and its whole state afterwards."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import flatten
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.engine.batch import Batch
from barbalat.run.kernel.grid import CHUNK_STEPS, signal_table
from barbalat.run.kernel.sampled_part import initial_acting
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array


@dataclass(frozen=True, eq=False)
class Recording:
    """K samples from t = 0 on.

    measured   (K, n) or (K, 1), as the controller got it, with its noise and lag
    commands   (K, q)
    states     (K, S) the controller's flat state after each sample, as of ``loop.sampling.Acting``
    """

    loop: ClosedLoop
    measured: Array
    commands: Array
    states: Array


def recorded(problem: TrackingProblem, controller: Controller, simulation: Simulation, samples: int) -> Recording:
    """The first samples of the run that ``simulate`` makes, at most ``samples``; InputError where the controller does not fit."""
    batch = Batch.of([(problem, controller)], simulation, lanes=1)
    (group,), every = batch.groups, batch.rhythm.sample_every
    assert every, "only a sampled controller has samples"
    in_pieces, kept = batch.program.shape.in_pieces, []
    count = min(samples, -(-simulation.steps // every))
    at_once = max(1, CHUNK_STEPS // every)
    for first in range(0, count, at_once):
        blocks = min(at_once, count - first)
        start, length = first * every, every
        table = signal_table(problem.signals, simulation, start, blocks * length, in_pieces=in_pieces)
        kept.append(group.call(start, blocks, length, group.state, table)[:, : batch.program.shape.states, 0])
    # a block begins before its sample: what a sample made of the state stands at the next one's beginning
    flat = np.vstack([*kept, group.state.T])[1:]
    own = len(flatten(initial_acting(batch.loop)))
    held = batch.loop.unpack(np.arange(batch.loop.size)).held
    return Recording(batch.loop, flat[:, held.measured.reshape(-1)], flat[:, held.r.reshape(-1)], flat[:, -own:])
