"""Runs of a search's members with modelling errors: whether they tolerate a requirement, and how much they tolerate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from barbalat.comparison.search.aim import Plants, sizes_of
from barbalat.comparison.search.quantity import Probe
from barbalat.solvers.simulation import Simulation
from barbalat.study.delay_margin import DelayMargins, margins_ensemble
from barbalat.study.ideal_benchmark import Ideals, JudgedRuns, Judging, Undelayed
from barbalat.study.verdicts import Criterion, Member
from barbalat.validate import Array


@dataclass(eq=False)
class Question:
    """Whether these loops tolerate ``limit`` of the modelling error of ``ideals``, for example a delay [s], by one criterion.

    Those of ``sizes`` below it are tried, and ``limit`` itself: if ``sizes`` are those of ``margins_ensemble``, a loop that
    tolerates ``limit`` by that function tolerates it here. ``undelayed`` are the runs without an error; ``numbers`` as there.
    """

    members: Sequence[Member]
    simulation: Simulation
    undelayed: Undelayed
    limit: float
    criterion: Criterion
    numbers: Array
    ideals: Ideals
    sizes: Array
    by: Judging
    threads: int | None = None

    def __post_init__(self) -> None:
        self.judged = JudgedRuns(
            self.members, self.simulation, self.undelayed, self.numbers, self.ideals, self.by, threads=self.threads
        )
        self.smaller = [size for size in map(float, self.sizes) if size < self.limit]

    def bears(self, group: Array, *, graded: bool, below: bool = True, among: Array | None = None) -> Array:
        """(M,) the largest tolerated size, up to ``limit``; 0 if there is none, or if it is not searched for.

        group   (M,) members with the same number are decided together: if one is lost at ``limit``, the others are not run again
        graded  whether the size is searched for if ``limit`` is not tolerated: from there down, in the steps of the scan
        below   whether those that tolerate ``limit`` are also tried with less: they may be lost in between
        among   (M,) whether a member is examined; by default all are
        """
        found, lost = np.zeros(len(self.members)), np.ones(len(self.members), dtype=bool)
        usable = self._usable() if among is None else np.intersect1d(self._usable(), np.flatnonzero(among))
        lost[usable] = self._lost(usable, self.limit)
        failing = np.isin(group, group[lost])
        found[~lost] = self.limit
        if below:
            self._look_below(np.flatnonzero(~failing), found)
        if graded:
            self._descend(usable[lost[usable]], found)
        return found

    @property
    def runs(self) -> int:
        """Number of simulations."""
        return self.judged.runs

    def _usable(self) -> Array:
        """The members that follow their model without a delay, and don't oscillate if that is required."""
        well = self.judged.tracks
        return np.flatnonzero(well & ~self.judged.oscillates if self.criterion is Criterion.ONSET else well)

    def _look_below(self, chosen: Array, found: Array) -> None:
        """Try members that tolerate ``limit`` with less, from the smallest size on."""
        for before, size in zip([0.0, *self.smaller], self.smaller, strict=False):
            lost = self._lost(chosen, size)
            found[chosen[lost]] = before
            chosen = chosen[~lost]

    def _descend(self, chosen: Array, found: Array) -> None:
        for size in reversed(self.smaller):
            lost = self._lost(chosen, size)
            found[chosen[~lost]] = size
            chosen = chosen[lost]

    def _lost(self, chosen: Array, size: float) -> Array:
        """Truth values for these members, each run with an error of that size."""
        if not len(chosen):
            return np.zeros(0, dtype=bool)
        by_onset, by_loss = self.judged.lost(chosen, np.full(len(chosen), size), asked=self.criterion)
        return by_loss if self.criterion is Criterion.LOSS else by_onset


@dataclass(eq=False)
class Probing:
    """Members on plants, each with a stream of noise; runs made are counted."""

    members: Sequence[Member]
    simulation: Simulation
    streams: Array
    plants: Plants
    by: Judging
    threads: int | None = None
    runs: int = 0

    def bears(self, probe: Probe, undelayed: Undelayed, limit: float, group: Array, *, graded: bool, below: bool) -> Array:
        """(M,) the tolerated size of the probe's errors, up to ``limit``; further arguments as in ``Question.bears``.

        undelayed  the members' runs without an added delay or gain error
        """
        found, among = np.full(len(group), np.inf), np.ones(len(group), dtype=bool)
        for error in probe.errors:
            question = Question(
                self.members,
                self.simulation,
                undelayed,
                limit,
                probe.criterion,
                self.streams,
                self.plants.ideals[error],
                sizes_of(error, self.simulation, self.plants.longest),
                self.by,
                self.threads,
            )
            borne = question.bears(group, graded=graded, below=below, among=among)
            self.runs += question.runs
            found = np.where(among, np.minimum(found, borne), found)
            among &= ~np.isin(group, group[found < limit])  # members lost by one error are not tried with the next
        return found

    def margins(self, probe: Probe, asked: float | None) -> Array:
        """(M,) the tolerated size of the probe's errors, without a limit; the ``asked`` size is among those tried."""
        found = []
        for each in self.each_margin(probe, asked):
            found.append((each.onset if probe.criterion is Criterion.ONSET else each.loss).bears)
        return np.asarray(np.min(found, axis=0))

    def each_margin(self, probe: Probe, asked: float | None) -> list[DelayMargins]:
        """The margins for each of the probe's errors, by both criteria."""
        found = []
        for error in probe.errors:
            sizes = sizes_of(error, self.simulation, self.plants.longest)
            sizes = sizes if asked is None else np.union1d(sizes, [asked])
            one = margins_ensemble(
                self.members, self.simulation, sizes, self.plants.ideals[error], by=self.by, numbers=self.streams,
                threads=self.threads,
            )  # fmt: skip
            self.runs += one.runs
            found.append(one)
        return found
