"""Runs with a modelling error, judged: the onset of oscillation without measurement noise, the loss with it.

They are judged against the undelayed runs, the model's motion and the loop that knows theta.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from barbalat.budget import Progress, part_of
from barbalat.controllers import KnownParameters
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.true_values import estimate_set, true_values
from barbalat.problem.known_set import Projecting
from barbalat.problem.modelling_error import DelayError, ModellingError
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.kernel.metrics import Metrics
from barbalat.signals import Constant
from barbalat.solvers.simulation import Simulation
from barbalat.study.criteria import Expected, Lost, Onset, ReferenceMotion, tail_error, tracks
from barbalat.validate import Array

Member = tuple[TrackingProblem, Controller]

SHORTEST_DELAY_STEPS = 2
"""Solver steps: the shortest delay that can be simulated."""
SIZES_TRIED = 40
"""Sizes of a modelling error with which the loop that knows theta is run; in between its error is interpolated."""


def without_error(members: Sequence[Member], metrics: Metrics, motions: Sequence[ReferenceMotion]) -> Expected:
    """What the runs of M members with a modelling error are judged against; ``metrics`` and ``motions`` of those without."""
    return Expected(
        error=tail_error(metrics),
        rate=metrics.theta_hat_variation_rate,
        motion=np.array([motion.largest for motion in motions]),
        width=np.stack([known_width(*member) for member in members]),
        crossings=np.array([motion.crossings for motion in motions]),
        explained=np.zeros(len(members)),
    )


@dataclass(eq=False)
class Ideals:
    """What the model and the loop that knows theta do on problems, found once for each; the problems are kept.

    sizes  (K,) of the modelling error with which the loop is run; of a delay [s]
    """

    simulation: Simulation
    sizes: Array
    error: ModellingError = field(default_factory=DelayError)
    known: dict[int, tuple[TrackingProblem, ReferenceMotion, Array]] = field(default_factory=dict)

    @classmethod
    def over(cls, simulation: Simulation, longest: float) -> Ideals:
        """For delays from the shortest one on [s]."""
        return cls(simulation, np.geomspace(SHORTEST_DELAY_STEPS * simulation.dt, longest, SIZES_TRIED))

    def of(self, problem: TrackingProblem) -> tuple[ReferenceMotion, Array]:
        """The model's motion, and (K,) what the sizes explain, without measurement noise."""
        if id(problem) not in self.known:
            self.find([problem])
        return self.known[id(problem)][1:]

    def find(self, problems: Sequence[TrackingProblem]) -> None:
        """Find motions and ideal errors of several problems of one structure, side by side."""
        motions = [ReferenceMotion.of(problem, self.simulation) for problem in problems]
        if isinstance(problems[0], Problem):
            silent = [quiet(problem) for problem in problems]
            groups = [[problem, *(with_error(problem, self.error, float(s)) for s in self.sizes)] for problem in silent]
            added = _added_errors(groups, self.simulation, motions)
        else:
            added = np.array([np.full(len(self.sizes), motion.largest) for motion in motions])
        self.known |= {id(one): (one, *found) for one, *found in zip(problems, motions, added, strict=True)}


@dataclass(frozen=True, eq=False)
class Benchmark:
    """What runs are judged against with a modelling error of any size: ``explained`` (M, K) at the ``sizes`` (K,)."""

    without: Expected
    sizes: Array
    explained: Array

    @classmethod
    def of(cls, members: Sequence[Member], undelayed: Metrics, ideals: Ideals) -> Benchmark:
        """Members that share a problem share its motion and its ideal loop."""
        found = [ideals.of(problem) for problem, _ in members]
        without = without_error(members, undelayed, [motion for motion, _ in found])
        return cls(without, ideals.sizes, np.stack([explained for _, explained in found]))

    def at(self, chosen: Array, added: Array) -> Expected:
        """For these members with errors of these sizes."""
        explained = [np.interp(np.log(s), np.log(self.sizes), self.explained[i]) for i, s in zip(chosen, added, strict=True)]
        return self.without.of(chosen, np.array(explained))


def known_width(problem: TrackingProblem, controller: Controller) -> Array:
    """(p,) of the known set in each estimate's direction; without one, of -|theta|_2 ... |theta|_2; infinite without theta."""
    loop = ClosedLoop.of(problem, controller)
    theta, known_set = true_values(problem, loop), estimate_set(loop)
    if known_set is None and theta is not None and isinstance(problem.known, Projecting):
        known_set = problem.known.estimate_set  # a network's weights, say, lie in no known set
    if known_set is not None and known_set.bounds_theta:
        extents = [part.extent for part in (known_set.sphere, known_set.intervals) if part is not None]
        return np.concatenate([high - low for low, high in extents])[: loop.parameters]
    return np.full(loop.parameters, np.inf if theta is None else 2 * float(np.linalg.norm(theta)))


def ideal_errors(problems: Sequence[Any], simulation: Simulation, motion: ReferenceMotion) -> Array | None:
    """(K,) what each problem's modelling error adds to the tail's error where the controller knows theta.

    The first problem is the one without it; all others have one structure. Measurement noise, if any, is left out: see
    ``quiet``. At most the model's own motion: there is no more to
    be explained. Nothing where the loop that knows theta is not stable itself, so that its own limit cycle explains nothing.
    ``None`` where the problem has no theta, as with output feedback.
    """
    if not isinstance(problems[0], Problem):
        return None
    return _added_errors([[quiet(problem) for problem in problems]], simulation, [motion])[0]


def _added_errors(groups: Sequence[Sequence[Any]], simulation: Simulation, motions: Sequence[ReferenceMotion]) -> Array:
    """(P, K) the same for P groups of as many problems, which all have one structure and no noise; each with its motion."""
    first, others = [group[0] for group in groups], [problem for group in groups for problem in group[1:]]
    without = tail_error(simulate_ensemble([ideal(problem) for problem in first], simulation).metrics)
    knowing = [KnownParameters(theta=group[0].parameters) for group in groups for _ in group[1:]]  # not the error
    found = tail_error(simulate_ensemble(list(zip(others, knowing, strict=True)), simulation).metrics)
    left_alone = [(_left_alone(problem), one) for problem, one in zip(others, knowing, strict=True)]
    alone = simulate_ensemble(left_alone, simulation).metrics
    decays = tail_error(alone) < DECAY_SHARE * alone.max_abs_e.max(axis=1)
    most = np.array([motion.largest for motion in motions])[:, None]
    added, decays = (values.reshape(len(groups), -1) for values in (found, decays))
    with np.errstate(invalid="ignore"):
        clipped = np.clip(added - without[:, None], 0.0, most)
    return np.where(decays, np.where(np.isnan(clipped), most, clipped), 0.0)


DECAY_SHARE = 0.5
"""A disturbed linear loop is stable if in the last quarter of the run its error is below this part of its largest: one that
grows has its largest there."""


def ideal(problem: Problem) -> Member:
    """The problem with the controller that knows its parameters."""
    return problem, KnownParameters(theta=problem.parameters)


def _left_alone(problem: Problem) -> Problem:
    """The problem with no limits at its input, no command and no disturbance, a little away from rest."""
    paths = tuple(replace(path, quantization=None, saturation=None, rate_limit=None) for path in problem.plant.paths)
    plant = replace(problem.plant, input=paths if len(paths) > 1 else paths[0], x0=np.full(problem.plant.n, SMALL_DISTURBANCE))
    silent = tuple(Constant(0.0) for _ in problem.commands)
    return replace(
        problem,
        plant=plant,
        reference=silent if isinstance(problem.reference, tuple) else silent[0],
        disturbance=None,
        unmatched=(),
    )


SMALL_DISTURBANCE = 1e-6
"""A disturbance [units of x] at which a nonlinear phi(x) is linear, to that part."""


def quiet(problem: Any) -> Any:
    """The problem without its measurement noise; itself where it has none.

    Noise moves estimates as fast as an oscillation does: margins are looked for without it.
    """
    return problem if problem.noise is None else replace(problem, sensor=replace(problem.sensor, noise=None))


def quiet_members(members: Sequence[Member]) -> list[Member]:
    """Each member without noise; those that shared a problem still do."""
    made = {id(problem): problem for problem, _ in members}
    silent = {key: quiet(problem) for key, problem in made.items()}
    return [(silent[id(problem)], controller) for problem, controller in members]


def with_error(problem: Any, error: ModellingError, size: float) -> Any:
    """The problem with a modelling error at each input, beside what is there."""
    paths = tuple(error.added(path, size) for path in problem.plant.paths)
    return replace(problem, plant=replace(problem.plant, input=paths[0] if len(paths) == 1 else paths))


def with_errors(members: Sequence[Member], error: ModellingError, sizes: Array) -> list[Member]:
    """Each member with an error of its size; those that shared a problem still do, which are then read faster."""
    made: dict[tuple[int, float], Any] = {}
    found = []
    for (problem, controller), size in zip(members, sizes, strict=True):
        key = id(problem), float(size)
        if key not in made:
            made[key] = with_error(problem, error, float(size))
        found.append((made[key], controller))
    return found


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
