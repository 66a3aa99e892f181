"""Runs with a modelling error, judged: the onset of oscillation without measurement noise, the loss with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from barbalat.budget import Progress, part_of
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.kernel.metrics import Metrics
from barbalat.solvers.simulation import Simulation
from barbalat.study.criteria import Lost, Onset, tracks
from barbalat.study.ideal_benchmark import Benchmark, Ideals, Member, quiet_members, with_errors
from barbalat.validate import Array


@dataclass(eq=False)
class JudgedRuns:
    """M members with what their runs with a modelling error are judged against.

    Noise moves estimates as fast as an oscillation does, so that the onset can't be told from it: that criterion looks at runs
    without noise, and compares them with runs without noise. The loss looks at runs as the case describes them.

    undelayed  figures of the members without a modelling error
    numbers    (M,) of the members' noise
    runs       simulations made so far, those behind ``undelayed`` left out
    """

    members: Sequence[Member]
    simulation: Simulation
    undelayed: Metrics
    numbers: Array
    ideals: Ideals
    criteria: tuple[Onset, Lost] = field(default_factory=lambda: (Onset(), Lost()))
    threads: int | None = None
    runs: int = 0

    @property
    def noisy(self) -> bool:
        """Whether the members' measurement is noisy; members have one structure."""
        return self.members[0][0].noise is not None

    @cached_property
    def quiet(self) -> Sequence[Member]:
        """The members without noise."""
        return quiet_members(self.members) if self.noisy else self.members

    @cached_property
    def quiet_undelayed(self) -> Metrics:
        """Figures of these without a modelling error."""
        if not self.noisy:
            return self.undelayed
        self.runs += len(self.members)
        return simulate_ensemble(self.quiet, self.simulation, threads=self.threads).metrics

    @cached_property
    def benchmark(self) -> Benchmark:
        """For the loss."""
        return Benchmark.of(self.members, self.undelayed, self.ideals)

    @cached_property
    def quiet_benchmark(self) -> Benchmark:
        """For the onset."""
        return Benchmark.of(self.members, self.quiet_undelayed, self.ideals) if self.noisy else self.benchmark

    @property
    def tracks(self) -> Array:
        """(M,) whether a member follows its model without a modelling error."""
        return tracks(self.benchmark.without.error, self.benchmark.without.motion)

    @property
    def swings(self) -> Array:
        """(M,) whether its estimates oscillate without a modelling error and without noise."""
        return self.criteria[0].undelayed(self.quiet_undelayed, self.quiet_benchmark.without)

    @property
    def quiet_tracks(self) -> Array:
        """(M,) whether a member follows its model without a modelling error and without noise."""
        return tracks(self.quiet_benchmark.without.error, self.quiet_benchmark.without.motion)

    @property
    def driven(self) -> Array:
        """(M,) whether the motion without a modelling error hides slower oscillations from the onset: see ``Onset.driven``."""
        return self.criteria[0].driven(self.quiet_benchmark.without)

    def lost(self, chosen: Array, added: Array, *, onset: bool = True, progress: Progress | None = None) -> tuple[Array, Array]:
        """(J,) by the onset and by the loss: which of the members ``chosen`` are lost with errors of the sizes ``added``.

        The onset is never later than the loss. With ``onset`` false the loss stands for both.
        """
        if not len(chosen):
            return np.zeros(0, dtype=bool), np.zeros(0, dtype=bool)
        twice = onset and self.noisy
        metrics = self._run(self.members, chosen, added, part_of(progress, 0.0, 0.5 if twice else 1.0))
        loss = self.criteria[1].judge(metrics, self.benchmark.at(chosen, added))
        if not onset:
            return loss, loss
        begun = loss.copy()
        left = ~loss if self.noisy else np.ones(len(chosen), dtype=bool)
        if left.any():
            which, sizes = chosen[left], added[left]
            seen = self._run(self.quiet, which, sizes, part_of(progress, 0.5, 0.5)) if self.noisy else metrics
            begun[left] |= self.criteria[0].judge(seen, self.quiet_benchmark.at(which, sizes))
        return begun, loss

    def _run(self, members: Sequence[Member], chosen: Array, added: Array, progress: Progress | None) -> Metrics:
        changed = with_errors([members[i] for i in chosen], self.ideals.error, added)
        self.runs += len(chosen)
        numbers = self.numbers[chosen]
        return simulate_ensemble(changed, self.simulation, numbers=numbers, threads=self.threads, progress=progress).metrics
