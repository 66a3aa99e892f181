"""Whether loops bear a delay, and else about how much of it: for searches that ask this of many, and of few of them in full."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from barbalat.run.ensemble import simulate_ensemble
from barbalat.run.metrics import Metrics
from barbalat.solvers.simulation import Simulation
from barbalat.study.criteria import Lost, Onset, tracks
from barbalat.study.delay_search import LONGEST_DELAY, SCANNED_DELAYS, Criterion, scanned
from barbalat.study.ideal_benchmark import Benchmark, Ideals, Member, with_delay
from barbalat.validate import Array


@dataclass(eq=False)
class Question:
    """Do these loops bear ``limit`` [s], by one criterion?

    The delays that are tried are those of ``delay_margins_ensemble``'s scan up to ``longest``, and ``limit`` itself: a loop that
    bears ``limit`` by that function bears it here. ``undelayed`` are the figures without a delay; ``numbers`` and
    ``ideals`` as there.
    """

    members: Sequence[Member]
    simulation: Simulation
    undelayed: Metrics
    limit: float
    criterion: Criterion
    numbers: Array
    ideals: Ideals
    longest: float = LONGEST_DELAY
    threads: int | None = None
    runs: int = 0

    def __post_init__(self) -> None:
        self.benchmark = Benchmark.of(self.members, self.undelayed, self.numbers, self.ideals)
        self.shorter = [d for d in map(float, scanned(self.simulation, self.longest, SCANNED_DELAYS)) if d < self.limit]

    def bears(self, group: Array, *, graded: bool, below: Array | None = None) -> Array:
        """(M,) the largest delay that is borne, up to ``limit``; 0 where none is, or where that is not looked for.

        group   (M,) members of one number stand and fall together: where one is lost at ``limit``, the others are not run again
        graded  whether it is looked for where ``limit`` is not borne: from there down, in the steps of the scan
        below   (M,) of which shorter delays are looked at where ``limit`` is borne; by default of all
        """
        found, lost = np.zeros(len(self.members)), np.ones(len(self.members), dtype=bool)
        usable = self._usable()
        lost[usable] = self._lost(usable, self.limit)
        failing = np.isin(group, group[lost])
        found[~lost] = self.limit
        self._look_below(np.flatnonzero(~failing if below is None else ~failing & below), found)
        if graded:
            self._descend(usable[lost[usable]], found)
        return found

    def _usable(self) -> Array:
        """Those that follow their model without a delay, and don't swing where that is asked."""
        without = self.benchmark.without
        well = tracks(without.error, without.motion)
        if self.criterion is Criterion.ONSET and self.members[0][0].noise is None:
            well &= ~Onset().undelayed(self.undelayed, without)
        return np.flatnonzero(well)

    def _look_below(self, chosen: Array, found: Array) -> None:
        """Those that bear ``limit`` may be lost before, and saved again."""
        for before, delay in zip([0.0, *self.shorter], self.shorter, strict=False):
            lost = self._lost(chosen, delay)
            found[chosen[lost]] = before
            chosen = chosen[~lost]

    def _descend(self, chosen: Array, found: Array) -> None:
        for delay in reversed(self.shorter):
            lost = self._lost(chosen, delay)
            found[chosen[~lost]] = delay
            chosen = chosen[lost]

    def _lost(self, chosen: Array, delay: float) -> Array:
        """Truth values for these members, each run with the delay."""
        if not len(chosen):
            return np.zeros(0, dtype=bool)
        delayed = [(with_delay(self.members[i][0], delay), self.members[i][1]) for i in chosen]
        metrics = simulate_ensemble(delayed, self.simulation, numbers=self.numbers[chosen], threads=self.threads).metrics
        self.runs += len(chosen)
        expected = self.benchmark.at(chosen, np.full(len(chosen), delay))
        loss = Lost().judge(metrics, expected)
        return loss if self.criterion is Criterion.LOSS else Onset().judge(metrics, expected) | loss
