"""Members of a search run with modelling errors beside their plants: do they bear what is asked, and how much do they bear."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from barbalat.comparison.search.quantity import Probe
from barbalat.comparison.search.tolerated_delay import Question
from barbalat.comparison.search.trial import Plants, sizes_of
from barbalat.run.kernel.metrics import Metrics
from barbalat.solvers.simulation import Simulation
from barbalat.study.delay_margin import DelayMargins, margins_ensemble
from barbalat.study.delay_search import Criterion
from barbalat.study.ideal_benchmark import Member
from barbalat.validate import Array


@dataclass(eq=False)
class Probing:
    """Members on plants, each with a stream of noise; runs made are counted."""

    members: Sequence[Member]
    simulation: Simulation
    streams: Array
    plants: Plants
    threads: int | None = None
    runs: int = 0

    def bears(self, probe: Probe, undelayed: Metrics, limit: float, group: Array, *, graded: bool, below: bool) -> Array:
        """(M,) the size of the probe's errors that is borne, up to ``limit``; the rest as of ``Question.bears``.

        undelayed  figures without an error
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
                self.threads,
            )
            borne = question.bears(group, graded=graded, below=below, among=among)
            self.runs += question.runs
            found = np.where(among, np.minimum(found, borne), found)
            among &= ~np.isin(group, group[found < limit])  # what is lost by one error is not tried with the next
        return found

    def margins(self, probe: Probe, asked: float | None) -> Array:
        """(M,) the size of the probe's errors that is borne, however much that is; what is ``asked`` is among those tried."""
        found = []
        for each in self.each_margin(probe, asked):
            found.append((each.onset if probe.criterion is Criterion.ONSET else each.loss).bears)
        return np.asarray(np.min(found, axis=0))

    def each_margin(self, probe: Probe, asked: float | None) -> list[DelayMargins]:
        """Of each of the probe's errors, by both criteria."""
        found = []
        for error in probe.errors:
            sizes = sizes_of(error, self.simulation, self.plants.longest)
            sizes = sizes if asked is None else np.union1d(sizes, [asked])
            one = margins_ensemble(
                self.members, self.simulation, sizes, self.plants.ideals[error], numbers=self.streams, threads=self.threads
            )
            self.runs += one.runs
            found.append(one)
        return found
