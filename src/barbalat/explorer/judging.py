"""The data of a page for the judge's verdict: the rows that its kernels keep, and the numbers in the judge's rules."""

from __future__ import annotations

from typing import Any

import numpy as np

from barbalat.cases.build import Case
from barbalat.explorer.encoded import doubles
from barbalat.judge import cycles, held
from barbalat.judge.judged import LEAST_BESIDE
from barbalat.judge.memory import LEAST_RANGE, Begins
from barbalat.judge.scale import RESTING, ROUNDING, Uncommanded
from barbalat.judge.settings import LOST_SHARE, component_names
from barbalat.judge.verdict import FOLLOWS_SHARE, LEAST_SAID
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import unflatten
from barbalat.run.engine.judging import SAMPLES_EACH_REVERSAL, passes, watched_in_sweeps
from barbalat.signals.smooth import Clock


def rules(case: Case) -> dict[str, Any]:
    """Return the rules under the names of ``templates/judge.js``, with the bands of the case and the signals that are clocks."""
    judge, beside = case.judge, Uncommanded.of(case.problem, case.simulation.t_end)
    return {
        "cycle": judge.cycle, "closely": judge.closely, "follows": dict(judge.follows), "lost": dict(judge.lost),
        "leastBeside": LEAST_BESIDE, "declared": sorted({one for one in case.problem.declared_followers if one is not None}),
        "followsShare": FOLLOWS_SHARE, "lostShare": LOST_SHARE, "leastSaid": LEAST_SAID, "rounding": ROUNDING, "resting": RESTING,
        "answer": beside.answer.tolist(), "spread": beside.spread.tolist(), "instants": held.INSTANTS,
        "leastRange": LEAST_RANGE,
        "fewestReversals": cycles.FEWEST_REVERSALS, "slowestPeriods": cycles.SLOWEST_PERIODS,
        "fewestCycles": cycles.FEWEST_CYCLES,
        "longestShare": cycles.LONGEST_SHARE, "keptShare": cycles.KEPT_SHARE, "steadyShare": cycles.STEADY_SHARE,
        "levellingShare": cycles.LEVELLING_SHARE, "fewestWindows": cycles.FEWEST_WINDOWS, "mostWindows": cycles.MOST_WINDOWS,
        "firstPieces": cycles.FIRST_PIECES,
        "samplesEachReversal": SAMPLES_EACH_REVERSAL, "slowest": cycles.slowest_period(case.problem.model.matrices[0]),
        "clock": [isinstance(signal, Clock) for signal in case.problem.signals],
        "passing": [passes(signal) for signal in case.problem.signals],
    }  # fmt: skip


def kept(case: Case, loop: ClosedLoop) -> dict[str, Any]:
    """Return the rows that a controller's kernels keep after the states of its loop, and the names of the components."""
    memory, names, labels = watched_in_sweeps(case.judge).memory(loop), component_names(case.problem), case.problem.labels
    marked, _ = unflatten(loop._initial, np.arange(loop.size), 0)
    rows = np.asarray(marked.x).reshape(-1)
    measures = np.zeros((0, len(rows))) if loop.measured_outputs else np.asarray(loop.plant.output(np.eye(len(rows))))
    noise = None if loop.noise_std is None or len(loop.noise_std) != loop.errors else np.abs(loop.noise_std)
    return {
        "rows": [[part.name, part.size] for part in memory.layout],
        "begins": doubles(np.array(memory.begins)),
        "renewed": {"tail": memory.renewed(Begins.TAIL), "window": memory.renewed(Begins.WINDOW)},
        "limited": list(memory.limited), "rateLimited": list(memory.rate_limited),
        "names": list(names),
        "units": ["" if labels is None else labels.unit(i)[1:-1] for i in range(len(names))],
        "inputUnits": [] if labels is None else list(labels.input_units),
        "initial": [[[int(rows[j]), float(row[j])] for j in np.flatnonzero(row)] for row in measures],
        "noise": [0.0] * loop.errors if noise is None else noise.tolist(),
    }  # fmt: skip
