"""Runs tuned entrants on validation plants, commands and noise. A failure counts as worse than any error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from barbalat.budget import Progress
from barbalat.certificates.linear_loops.margin_values import finite
from barbalat.comparison.contest.rule import Rule
from barbalat.comparison.contest.tuned import Qualified
from barbalat.comparison.plants import one_plant_because, plants_of
from barbalat.comparison.search.probing import Question
from barbalat.judge.settings import Judge
from barbalat.problem.modelling_error import DelayError, GainError, ModellingError
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import BreakingSignal, Signal
from barbalat.run.results.step_comparison import EQUAL_FIGURES_SHARE
from barbalat.solvers.simulation import Simulation
from barbalat.study.finer_step import different, refined
from barbalat.study.ideal_benchmark import Ideals, Judging, Undelayed
from barbalat.study.reference_motion import ReferenceMotion
from barbalat.study.verdicts import Criterion, Member
from barbalat.sweeps.statistics import Median, Share
from barbalat.validate import Array, InputError, counted

VALIDATION_COMMANDS = 8
"""Number of commands. Each has the same number of plants, enough to fill the kernel's lanes."""
AMPLITUDE_FACTORS = (0.5, 1.5)
"""Range of the factors of the case's command, because a fair comparison must test a tuning with commands of different sizes."""
PACE_FACTORS = (0.5, 2.0)
"""Range of the factors of the case's frequency, an octave to either side."""


@dataclass(frozen=True)
class Paced:
    """A signal that is ``size`` times as large and ``pace`` times as fast."""

    signal: Signal
    size: float
    pace: float

    def __call__(self, t: Array) -> Array:
        return self.size * self.signal(self.pace * np.asarray(t))

    def before(self, t: Array) -> Array:
        return self.size * self.signal.before(self.pace * np.asarray(t))

    def breaks(self, start: float, stop: float) -> Array:
        if not isinstance(self.signal, BreakingSignal):
            return np.zeros(0)
        return np.asarray(self.signal.breaks(self.pace * start, self.pace * stop) / self.pace)


def with_command(problem: Problem, size: float, pace: float) -> Problem:
    """Return the problem with each of its commands changed. Disturbances are unchanged."""
    commands = tuple(Paced(command, size, pace) for command in problem.commands)
    return replace(problem, reference=commands if isinstance(problem.reference, tuple) else commands[0])


def drawn_commands(count: int, seed: int) -> Array:
    """Return sizes and paces (count, 2) from a Latin hypercube, uniform in the size and in the logarithm of the pace."""
    from scipy.stats import qmc

    shares = qmc.LatinHypercube(2, rng=np.random.default_rng(seed)).random(count)
    sizes = AMPLITUDE_FACTORS[0] + (AMPLITUDE_FACTORS[1] - AMPLITUDE_FACTORS[0]) * shares[:, 0]
    return np.column_stack([sizes, PACE_FACTORS[0] * (PACE_FACTORS[1] / PACE_FACTORS[0]) ** shares[:, 1]])


@dataclass(frozen=True, eq=False, kw_only=True)
class Draws:
    """The draws of ``members`` runs, grouped by command.

    problems  (M,) problems, each with its plant and its command; ``streams`` (M,) are the noise streams
    commands  (C, 2) size and pace of each command
    """

    problems: list[Problem]
    streams: Array
    commands: Array

    @classmethod
    def drawn(cls, problem: Problem, members: int, rule: Rule) -> Draws:
        """Draw new plants from the known set, new commands and new noise. Raises InputError if the truth is a single plant."""
        assert problem.uncertainty is not None
        if (why := one_plant_because(problem)) is not None:
            raise InputError(f"validation plants cannot be drawn, because {why}")
        seed = rule.seed + VALIDATION_SEED
        plants = plants_of(problem, problem.uncertainty, members + 1, seed)[1:]
        commands = drawn_commands(min(VALIDATION_COMMANDS, members), seed)
        which = np.sort(np.arange(members) % len(commands))
        made = [with_command(problem, float(size), float(pace)) for size, pace in commands]
        problems = [replace(made[c], plant=plant.plant, truth=plant.truth) for c, plant in zip(which, plants, strict=True)]
        return cls(problems=problems, streams=rule.plants + np.arange(members), commands=commands[which])

    def __len__(self) -> int:
        return len(self.problems)

    @property
    def words(self) -> str:
        """The ranges of the commands' sizes and paces, relative to the command of the case."""
        sizes, paces = self.commands.T
        return f"{sizes.min():.2g} to {sizes.max():.2g} times as large and {paces.min():.2g} to {paces.max():.2g} times as fast"

    @property
    def groups(self) -> list[Array]:
        """The runs of each command."""
        edges = np.flatnonzero(np.diff(self.commands, axis=0).any(axis=1)) + 1
        return np.split(np.arange(len(self)), edges)


VALIDATION_SEED = 1
"""Number that is added to the seed of the rule, so that no tuning plant occurs again."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Validation:
    """The results of one entrant on all draws.

    error     (M,) RMS |e| relative to the RMS of |x_m|; infinite for a run that failed
    unsound   (M,) whether the judge calls the run lost or a limit cycle
    diverged  (M,) whether the run diverged
    lost      (M,) whether the judge calls the run lost (or a limit cycle, if the rule ends margins at the onset), or the run
              follows its model in no component
    delay, gain_up, gain_down  (M,) whether the run does not tolerate the delay and gains of the rule, on these plants
        and commands
    effort    (M,) the largest |u|; NaN if the run diverged
    """

    error: Array
    diverged: Array
    lost: Array
    delay: Array
    gain_up: Array
    gain_down: Array
    effort: Array
    unsound: Array

    @property
    def failures(self) -> dict[str, Share]:
        """The fractions of failures, which count before the error."""
        found = {
            "diverged": self.diverged,
            "lost": self.lost,
            "delay": self.delay,
            "gain_up": self.gain_up,
            "gain_down": self.gain_down,
        }
        return {name: Share.of(values) for name, values in found.items()}

    def as_json(self) -> dict[str, object]:
        """Return the fractions of failures and the quantiles of the error."""
        return {
            "failures": {name: share.as_json() for name, share in self.failures.items()},
            "error": {name: finite(value) for name, value in self.quantiles.items()},
            "max_abs_u": finite(self.largest_control),
            "errors": [finite(value) for value in self.error.tolist()],
        }

    @property
    def largest_control(self) -> float:
        """The median of max |u|, which is infinite if half of the runs diverged."""
        return Median.of(np.where(self.diverged, np.inf, self.effort)).value

    @property
    def quantiles(self) -> dict[str, float]:
        """The quantiles of the errors of all runs, which are infinite if too many runs failed."""
        ordered = np.sort(self.error)
        upper = float(ordered[min(int(np.ceil(0.9 * len(ordered))), len(ordered)) - 1])
        return {"median": Median.of(self.error).value, "upper_tenth": upper, "worst": float(ordered[-1])}


@dataclass(frozen=True, kw_only=True)
class Remeasured:
    """Some validation runs of one entrant, repeated with the ``refined`` simulation.

    verdicts  runs whose verdict changed: lost, or not tolerating what the rule requires
    errors    runs whose error changed
    """

    runs: int
    verdicts: int
    errors: int

    def sentence(self, name: str, fine: Simulation, remedy: str) -> str:
        """Return the finding as a sentence, with a remedy if something changes."""
        again = f"{name}: repeating {counted(self.runs, 'validation run')} at {fine.step}"
        if not (self.verdicts or self.errors):
            return f"{again} changes no verdict and no error"
        return (
            f"{again} changes the verdict on {self.verdicts}, and the error by more than "
            f"{100 * EQUAL_FIGURES_SHARE:.0f} % on {self.errors}: some of these changes are due to the solver; {remedy}"
        )


def measured_again(
    entrants: Sequence[Qualified],
    trials: Draws,
    rule: Rule,
    simulation: Simulation,
    found: Mapping[str, Validation],
    *,
    judge: Judge | None = None,
    threads: int | None = None,
) -> dict[str, Remeasured]:
    """Repeat the first run of each command with a finer step. Return the results by the entrants' names."""
    fine, first = refined(simulation), [which[:1] for which in trials.groups]
    changed = {one.name: [0, 0] for one in entrants}
    for which in first:
        asked, streams = _Asked.of(rule, fine, judge), trials.streams[which]
        for one in entrants:
            members = [(one.entrant.reads(trials.problems[i]), one.controller) for i in which]
            again, before = _measured(members, streams, asked, fine, threads), found[one.name]
            verdicts = [vars(again)[name] != vars(before)[name][which] for name in ("lost", "delay", "gain_up", "gain_down")]
            changed[one.name][0] += int(np.any(verdicts, axis=0).sum())
            pairs = zip(before.error[which], again.error, strict=True)
            changed[one.name][1] += sum(np.isfinite(a + b) and different(float(a), float(b)) for a, b in pairs)
    return {
        name: Remeasured(runs=len(first), verdicts=verdicts, errors=int(errors)) for name, (verdicts, errors) in changed.items()
    }


def measure(
    entrants: Sequence[Qualified],
    trials: Draws,
    rule: Rule,
    simulation: Simulation,
    *,
    judge: Judge | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> dict[str, Validation]:
    """Measure all entrants on the same plants, commands and noise. Return the results by their names."""
    parts: dict[str, list[Validation]] = {one.name: [] for one in entrants}
    groups = trials.groups
    for g, which in enumerate(groups):
        streams = trials.streams[which]
        asked = _Asked.of(rule, simulation, judge)
        for k, one in enumerate(entrants):
            members = [(one.entrant.reads(trials.problems[i]), one.controller) for i in which]
            parts[one.name].append(_measured(members, streams, asked, simulation, threads))
            if progress is not None:
                progress((g + (k + 1) / len(entrants)) / len(groups))
    return {
        name: Validation(**{field: np.concatenate([vars(part)[field] for part in several]) for field in vars(several[0])})
        for name, several in parts.items()
    }


@dataclass(frozen=True, eq=False)
class _Asked:
    """The delay and gain factors that the rule requires, together with the loops that know theta, for comparison."""

    errors: dict[str, tuple[float, Ideals]]
    rule: Rule
    by: Judging

    @classmethod
    def of(cls, rule: Rule, simulation: Simulation, judge: Judge | None) -> _Asked:
        asked: dict[str, tuple[float, ModellingError]] = {
            "delay": (rule.delay_margin, DelayError()),
            "gain_up": (rule.gain_margin - 1, GainError()),
            "gain_down": (rule.gain_margin - 1, GainError(downwards=True)),
        }
        errors = {name: (size, Ideals(simulation, np.array([size]), error)) for name, (size, error) in asked.items()}
        return cls(errors, rule, Judging(judge or Judge()))


def _measured(
    members: Sequence[Member], streams: Array, asked: _Asked, simulation: Simulation, threads: int | None
) -> Validation:
    """Return the errors with noise, the verdicts, and whether the required margins are tolerated."""
    found, until = Undelayed.run(members, simulation, asked.by.judge, streams, threads), asked.rule.until
    motion = ReferenceMotion.of(members[0][0], simulation)  # all members have one command and one model
    metrics, lost = found.noisy.metrics, found.noisy.lost | ~found.noisy.tracks
    if until is Criterion.ONSET:
        lost = lost | found.noisy.oscillates | found.quiet.oscillates
    tolerated = {}
    for name, (size, ideals) in asked.errors.items():
        question = Question(members, simulation, found, size, until, streams, ideals, np.zeros(0), asked.by, threads)
        tolerated[name] = question.tolerates(np.arange(len(members)), graded=False) >= size
    return Validation(
        error=np.where(lost, np.inf, np.linalg.norm(metrics.rms_e, axis=1) / motion.rms),
        diverged=np.isfinite(metrics.diverged_at),
        lost=lost,
        delay=~tolerated["delay"],
        gain_up=~tolerated["gain_up"],
        gain_down=~tolerated["gain_down"],
        effort=metrics.max_abs_u.reshape(len(members), -1).max(axis=1),
        unsound=found.noisy.lost | found.noisy.oscillates | found.quiet.oscillates,
    )
