"""Runs with a modelling error, judged without noise, and again with noise relative to the loop with known theta.

Noise moves estimates and controls as fast as an oscillation does, and no criterion distinguishes the two. Therefore the judge
decides without noise. With noise a loop must not be lost, and the effect of the noise must not exceed both the effect without the
modelling error and the effect on the loop with known parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from barbalat.budget import Progress, part_of
from barbalat.controllers import KnownParameters
from barbalat.judge.settings import Judge
from barbalat.problem.modelling_error import DelayError, ModellingError
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.solvers.simulation import Simulation
from barbalat.study.ringing import fills, known_width
from barbalat.study.verdicts import Criterion, Lost, Member, Verdicts
from barbalat.validate import Array

SHORTEST_DELAY_STEPS = 2
"""Shortest delay that can be simulated, in solver steps, or with a tolerance in multiples of the resolution."""


def shortest_delay(simulation: Simulation) -> str:
    """The shortest delay that a study tries, in words."""
    shortest = f"{SHORTEST_DELAY_STEPS * simulation.resolution:g} s"
    return f"two solver steps, {shortest}" if simulation.tolerance is None else f"{shortest}, the shortest that is tried"


SIZES_TRIED = 16
"""Number of sizes of a modelling error at which the loop with known theta is run; in between, the effect of noise is
interpolated."""
NOISE_SENTENCE = (
    "oscillation is judged on the same run without the case's measurement noise, which moves controls as fast as an oscillation "
    "does. With the noise the loop must not be lost. The noise may increase the RMS error of the run by at most a third of the "
    "judge's band more than it does with theta known and without the modelling error"
)
NOISE_BAND_SHARE = 1 / 3
"""Fraction of the judge's band: the band limits the largest error, and an error as random as the noise has an RMS of a third of
its largest value. Largest errors are not suitable: at steps of a command, for example, two realisations of the noise differ by
more."""


def ideal(problem: Problem) -> Member:
    """The problem without a shell or faults, and the controller that knows its parameters."""
    true = problem.true_parameters  # a truth with different states has no parameters; the design plant's are used
    return problem.nominal, KnownParameters(theta=problem.parameters if true is None else true)


@dataclass(eq=False)
class Ideals:
    """The effect of measurement noise on the loop with known theta, for modelling errors of some sizes; computed on demand.

    sizes  (K,) sizes of the modelling error with which the loop is run; [s] for a delay
    """

    simulation: Simulation
    sizes: Array
    error: ModellingError = field(default_factory=DelayError)
    known: dict[tuple[int, int], tuple[TrackingProblem, Array]] = field(default_factory=dict)

    @classmethod
    def over(cls, simulation: Simulation, longest: float) -> Ideals:
        """The benchmark for delays [s] from the shortest one to ``longest``."""
        return cls(simulation, np.geomspace(SHORTEST_DELAY_STEPS * simulation.resolution, longest, SIZES_TRIED))

    def noise_costs(self, problems: Sequence[TrackingProblem], numbers: Array, sizes: Array, judge: Judge) -> Array:
        """(J, n) the increase of the RMS error due to these noise streams, with modelling errors of these sizes; infinite without
        theta.

        It is 0 if the loop with known theta oscillates too, because a limit cycle of that loop explains nothing.
        """
        if not isinstance(problems[0], Problem):
            return np.array(np.inf)
        keys = [(id(problem), int(number)) for problem, number in zip(problems, numbers, strict=True)]
        new = {key: problem for key, problem in zip(keys, problems, strict=True) if key not in self.known}
        if new:
            found = self._found(list(new.values()), [number for _, number in new], judge)
            self.known |= {key: (problem, costs) for (key, problem), costs in zip(new.items(), found, strict=True)}
        x, at = np.log(self.sizes), np.log(sizes)
        return np.array([[np.interp(a, x, row) for row in self.known[key][1].T] for key, a in zip(keys, at, strict=True)])

    def _found(self, problems: Sequence[Any], numbers: Sequence[int], judge: Judge) -> Array:
        """(P, K, n) the errors for problems of one structure, in one ensemble."""
        members = [ideal(problem) for problem in problems for _ in self.sizes]
        noisy = with_errors(members, self.error, np.tile(self.sizes, len(problems)))
        streams = np.repeat(np.array(numbers), len(self.sizes))
        with_noise = Verdicts.run(noisy, self.simulation, judge, numbers=streams)
        without = Verdicts.run(quiet_members(noisy), self.simulation, judge)
        with np.errstate(invalid="ignore"):
            costs = np.where(without.oscillates[:, None], 0.0, np.maximum(with_noise.rms - without.rms, 0.0))
        return costs.reshape(len(problems), len(self.sizes), -1)


def quiet(problem: Any) -> Any:
    """The problem without its measurement noise; unchanged if it has none."""
    if problem.noise is None:
        return problem
    return problem.with_sensor(lambda sensor: None if sensor is None else replace(sensor, noise=None))


def quiet_members(members: Sequence[Member]) -> list[Member]:
    """Each member without noise; members that share a problem still do so."""
    made = {id(problem): problem for problem, _ in members}
    silent = {key: quiet(problem) for key, problem in made.items()}
    return [(silent[id(problem)], controller) for problem, controller in members]


def with_error(problem: Any, error: ModellingError, size: float) -> Any:
    """The problem with a modelling error added at each input."""
    return problem.with_inputs(lambda path: error.added(path, size))


def with_errors(members: Sequence[Member], error: ModellingError, sizes: Array) -> list[Member]:
    """Each member with an error of its size; members that share a problem still do so and are then read faster."""
    made: dict[tuple[int, float], Any] = {}
    found = []
    for (problem, controller), size in zip(members, sizes, strict=True):
        key = id(problem), float(size)
        if key not in made:
            made[key] = with_error(problem, error, float(size))
        found.append((made[key], controller))
    return found


@dataclass(frozen=True, eq=False)
class Judging:
    """The criteria by which runs are judged: the case's bands, and the loss of the motion."""

    judge: Judge = field(default_factory=Judge)
    lost: Lost = field(default_factory=Lost)


@dataclass(frozen=True, eq=False)
class Undelayed:
    """M members without a modelling error: with and without noise; the two are equal if there is no noise."""

    noisy: Verdicts
    quiet: Verdicts

    @classmethod
    def run(
        cls,
        members: Sequence[Member],
        simulation: Simulation,
        judge: Judge,
        numbers: Array,
        threads: int | None = None,
        *,
        twin: bool = True,
    ) -> Undelayed:
        """Simulate and judge both; without the ``twin``, simulate only the noisy runs and use them for both."""
        noisy = Verdicts.run(members, simulation, judge, numbers=numbers, threads=threads)
        if members[0][0].noise is None or not twin:
            return cls(noisy, noisy)
        return cls(noisy, Verdicts.run(quiet_members(members), simulation, judge, threads=threads))

    def of(self, chosen: Array | slice) -> Undelayed:
        """The results for some members."""
        return Undelayed(self.noisy.of(chosen), self.quiet.of(chosen))

    @classmethod
    def together(cls, parts: Sequence[Undelayed]) -> Undelayed:
        """The results of all parts together."""
        return cls(Verdicts.together([one.noisy for one in parts]), Verdicts.together([one.quiet for one in parts]))


@dataclass(eq=False)
class JudgedRuns:
    """M members of one structure, and the judge of their runs with a modelling error.

    undelayed  the members' runs without a modelling error
    numbers    (M,) numbers of the members' noise streams
    runs       number of simulations so far, without those of ``undelayed``
    ends       why a member's margin ends at a size according to the onset, in words, for both criteria
    """

    members: Sequence[Member]
    simulation: Simulation
    undelayed: Undelayed
    numbers: Array
    ideals: Ideals
    by: Judging = field(default_factory=Judging)
    threads: int | None = None
    runs: int = 0
    ends: dict[tuple[int, float], str] = field(default_factory=dict)

    @property
    def noisy(self) -> bool:
        """Whether the members' measurement is noisy."""
        return self.members[0][0].noise is not None

    @cached_property
    def quiet(self) -> Sequence[Member]:
        """The members with the noise removed."""
        return quiet_members(self.members) if self.noisy else self.members

    @property
    def tracks(self) -> Array:
        """(M,) whether a member follows its model without a modelling error, with and without its noise."""
        return np.asarray(self.undelayed.noisy.tracks & self.undelayed.quiet.tracks)

    @property
    def oscillates(self) -> Array:
        """(M,) whether it oscillates without a modelling error, judged without noise."""
        return self.undelayed.quiet.oscillates

    @property
    def fills(self) -> Array:
        """(M,) whether its estimates fill their known range without a modelling error, with the noise."""
        metrics = self.undelayed.noisy.metrics
        found = [fills(metrics.of(slice(i, i + 1)), known_width(*member)) for i, member in enumerate(self.members)]
        return np.concatenate(found)

    def lost(
        self, chosen: Array, added: Array, *, asked: Criterion | None = None, progress: Progress | None = None
    ) -> tuple[Array, Array]:
        """Return (J,) whether each of the members ``chosen`` oscillates, and whether it is lost, with errors of the sizes
        ``added``.

        If only one criterion is ``asked``, the result for the other may be too favourable, because runs that are decided without
        noise are not repeated with it.
        """
        if not len(chosen):
            return np.zeros(0, dtype=bool), np.zeros(0, dtype=bool)
        without = self._run(self.quiet, chosen, added, part_of(progress, 0.0, 0.5 if self.noisy else 1.0))
        loss = self.by.lost.judge(without, self.undelayed.quiet.of(chosen))
        begun = without.oscillates.copy()
        for i, size, lost in zip(chosen[begun], added[begun], without.lost[begun], strict=True):
            self.ends[int(i), float(size)] = "it is lost" if lost else "it is in a limit cycle, or an oscillation grows"
        left = ~{Criterion.ONSET: begun, Criterion.LOSS: loss, None: begun & loss}[asked]
        if self.noisy and left.any():
            which, sizes = chosen[left], added[left]
            seen = self._run(self.members, which, sizes, part_of(progress, 0.5, 0.5))
            loss[left] |= self.by.lost.judge(seen, self.undelayed.noisy.of(which))
            shaken = seen.oscillates
            if asked is not Criterion.LOSS:
                shaken = shaken | self._costs_more(seen, without.of(left), which, sizes)
            for i, size, itself in zip(which[shaken], sizes[shaken], seen.oscillates[shaken], strict=True):
                ended = "with the noise it is in a limit cycle or lost" if itself else "the noise increases its error too much"
                self.ends.setdefault((int(i), float(size)), ended)
            begun[left] |= shaken
        return begun, loss

    def _costs_more(self, noisy: Verdicts, without: Verdicts, chosen: Array, added: Array) -> Array:
        """(J,) whether the noise increases the RMS error by more than both its increase without the modelling error and its
        increase with known theta."""
        with np.errstate(invalid="ignore"):
            usual = np.maximum((self.undelayed.noisy.rms - self.undelayed.quiet.rms)[chosen], 0.0)
            more = noisy.rms - without.rms - usual - NOISE_BAND_SHARE * without.band
        beyond = np.asarray((more > 0).any(axis=1))
        which = np.flatnonzero(beyond)  # the loop with known theta is run only for these
        if len(which):
            problems = [self.members[i][0] for i in chosen[which]]
            known = self.ideals.noise_costs(problems, self.numbers[chosen[which]], added[which], self.by.judge)
            beyond[which] = (more[which] > known).any(axis=1)
        return beyond

    def _run(self, members: Sequence[Member], chosen: Array, added: Array, progress: Progress | None) -> Verdicts:
        changed = with_errors([members[i] for i in chosen], self.ideals.error, added)
        self.runs += len(chosen)
        return Verdicts.run(
            changed, self.simulation, self.by.judge, numbers=self.numbers[chosen], threads=self.threads, progress=progress
        )
