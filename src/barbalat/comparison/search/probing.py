"""Runs the members of a search with modelling errors, to find whether they tolerate a requirement, and how much they tolerate."""

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
    """Asks whether loops tolerate ``limit`` of the modelling error of ``ideals``, such as a delay [s], by one criterion.

    All ``sizes`` below ``limit``, and ``limit`` itself, are tried. With the ``sizes`` of ``margins_ensemble``, a loop that
    tolerates ``limit`` according to that function also tolerates it here. ``undelayed`` contains the runs without an error;
    ``numbers`` is as in that function.
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

    def tolerates(self, group: Array, *, graded: bool, below: bool = True, among: Array | None = None) -> Array:
        """Return the largest tolerated size (M,), up to ``limit``; 0 if there is none, or if there is no search for it.

        group   (M,) members with the same number are decided together; if one is lost at ``limit``, the others are not run again
        graded  whether, if ``limit`` is not tolerated, to search for the tolerated size downwards from ``limit`` in the steps of
                the scan
        below   whether members that tolerate ``limit`` are also tried with smaller sizes, because they may be lost in between
        among   (M,) which members are examined; all by default
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
        """The number of simulations."""
        return self.judged.runs

    def _usable(self) -> Array:
        """Return the members that follow their model without a delay and, if it is required, do not oscillate."""
        well = self.judged.tracks
        return np.flatnonzero(well & ~self.judged.oscillates if self.criterion is Criterion.ONSET else well)

    def _look_below(self, chosen: Array, found: Array) -> None:
        """Also try smaller sizes for members that tolerate ``limit``, the smallest first."""
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
        """Return whether these members are lost when each runs with an error of that size."""
        if not len(chosen):
            return np.zeros(0, dtype=bool)
        by_onset, by_loss = self.judged.lost(chosen, np.full(len(chosen), size), asked=self.criterion)
        return by_loss if self.criterion is Criterion.LOSS else by_onset


@dataclass(eq=False)
class Probing:
    """Members on plants, each with a noise stream. The number of their runs is counted."""

    members: Sequence[Member]
    simulation: Simulation
    streams: Array
    plants: Plants
    by: Judging
    threads: int | None = None
    runs: int = 0

    def tolerates(self, probe: Probe, undelayed: Undelayed, limit: float, group: Array, *, graded: bool, below: bool) -> Array:
        """Return the tolerated size of the probe's errors (M,), up to ``limit``. Further arguments are as in
        ``Question.tolerates``.

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
            tolerated = question.tolerates(group, graded=graded, below=below, among=among)
            self.runs += question.runs
            found = np.where(among, np.minimum(found, tolerated), found)
            # a member that is lost with one modelling error is not tried with the next
            among &= ~np.isin(group, group[found < limit])
        return found

    def margins(self, probe: Probe, asked: float | None) -> Array:
        """Return the tolerated size of the probe's errors (M,), without a limit. The ``asked`` size is among the tried ones."""
        found = []
        for each in self.each_margin(probe, asked):
            found.append((each.onset if probe.criterion is Criterion.ONSET else each.loss).tolerates)
        return np.asarray(np.min(found, axis=0))

    def each_margin(self, probe: Probe, asked: float | None) -> list[DelayMargins]:
        """Return the margins for each of the probe's errors, by both criteria."""
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
