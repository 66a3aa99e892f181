"""The contest: entrants, the rule's search for each, then all of them on what no tuning saw."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np

from barbalat import validate
from barbalat.cases.build import Case
from barbalat.cases.load import load_case
from barbalat.contests.entrant import Entrant, entrants_of
from barbalat.contests.held_out import Draws, HeldOut, measure, median
from barbalat.contests.noise import DEFAULT_SHARE, quiet, with_noise
from barbalat.contests.paired import paired
from barbalat.contests.result import Contest
from barbalat.contests.rule import DEFAULT_GAIN_MARGIN, DEFAULT_PLANTS, DEFAULT_TRIALS, Rule, default_delay_margin
from barbalat.contests.tuned import Qualified, qualify
from barbalat.loop.structure import comes_from_outside
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.run.progress import Progress, part_of
from barbalat.solvers.simulation import Simulation
from barbalat.study.delay_search import Criterion
from barbalat.study.motion import REST_SENTENCE, ModelMotion
from barbalat.study.tradeoff import plants_of
from barbalat.tuning.trial import Plants
from barbalat.validate import InputError, Named, counted

DEFAULT_MEMBERS = 200
"""Held-out runs: the median of a ratio then has an interval of 7 % of the runs to either side."""
TUNING_SHARE = 0.85
"""Of the time, about; the rest is the held-out runs'."""


def contest(
    case: str | Path | Case,
    *,
    delay_margin: float | None = None,
    gain_margin: float = DEFAULT_GAIN_MARGIN,
    until: str | Criterion = Criterion.ONSET,
    schemes: Sequence[str] = (),
    sample_time: float | None = None,
    noise: float = DEFAULT_SHARE,
    plants: int = DEFAULT_PLANTS,
    trials: int = DEFAULT_TRIALS,
    members: int = DEFAULT_MEMBERS,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Contest:
    """Tune every scheme under one rule, and measure those that meet it on plants, commands and noise that no tuning saw.

    case          a case file, a bundled case's name, or a ``Case``: its problem and its simulation; its own controllers take part
                  only where their class is from outside and says what is tuned of it
    delay_margin  [s]; by default ``default_delay_margin``
    until         "onset": a margin ends where the loop begins to oscillate; "loss": where it loses its motion
    schemes       by their names in case files; by default all that say what is tuned of them and take the problem
    sample_time   with which all run sampled [s]; by default what is continuous stays so
    noise         share of the model's motion, where the case has no noise of its own
    members       held-out runs
    The rest as of ``Rule``. Raises InputError.
    """
    whole = case if isinstance(case, Case) else load_case(case)
    problem = posed(whole.problem)
    margin = default_delay_margin(problem, whole.simulation) if delay_margin is None else delay_margin
    rule = Rule(delay_margin=margin, gain_margin=gain_margin, until=criterion(until), plants=plants, trials=trials, seed=seed)
    rule.require_steps(whole.simulation)
    held = margin if sample_time is None else sample_time
    noisy = with_noise(problem, noise, whole.simulation, held, seed)
    own = [one for one in whole.controllers if comes_from_outside(one)]
    entrants, left_out = entrants_of(noisy, whole.simulation, schemes=schemes, own=own, sample_time=sample_time)
    if not entrants:
        raise InputError(f"no scheme takes part: {'; '.join(left_out)}")
    return compete(
        noisy, whole.simulation, entrants, rule, members=members, left_out=left_out, threads=threads, progress=progress
    )


def posed(problem: TrackingProblem) -> Problem:
    """InputError for what no contest can be held on."""
    if not isinstance(problem, Problem):
        raise InputError("a contest needs a plant whose state is measured, and this case measures an output")
    if problem.uncertainty is None:
        raise InputError("a contest needs the known set: give uncertainty.lower and .upper, or .center and .radius")
    return problem


def criterion(name: str | Criterion) -> Criterion:
    """By its name; InputError for another one."""
    try:
        return Criterion(name)
    except ValueError:
        known = " or ".join(one.value for one in Criterion)
        raise InputError(f"until must be {known}, got {validate.show(name)}") from None


def compete(
    problem: Problem,
    simulation: Simulation,
    entrants: Sequence[Entrant],
    rule: Rule,
    *,
    members: int = DEFAULT_MEMBERS,
    left_out: Sequence[str] = (),
    threads: int | None = None,
    progress: Progress | None = None,
) -> Contest:
    """Tune every entrant on the problem under the rule, then measure those that meet it on ``members`` runs that it never saw.

    left_out  sentences on who does not take part, which are handed on

    Raises InputError for a problem without a known set, and for entrants of one name.
    """
    started = time.perf_counter()
    _require(problem, simulation, entrants, rule, members)
    assert problem.uncertainty is not None
    family = plants_of(problem, problem.uncertainty, rule.plants, rule.seed)
    plants = _Shared(family, rule, simulation)
    tuned = []
    for i, one in enumerate(entrants):
        part = part_of(progress, TUNING_SHARE * i / len(entrants), TUNING_SHARE / len(entrants))
        tuned.append(qualify(one, rule, *plants.read_by(one), simulation, threads=threads, progress=part))
    qualified = [one for one in tuned if one.meets]
    draws = Draws.drawn(problem, members, rule)
    rest = part_of(progress, TUNING_SHARE, 1 - TUNING_SHARE)
    held = measure(qualified, draws, rule, simulation, threads=threads, progress=rest)
    ordered = sorted(tuned, key=lambda one: _rank(one, held))
    pairs = [paired((a.name, held[a.name]), (b.name, held[b.name])) for a, b in combinations(ordered, 2) if a.meets and b.meets]
    return Contest(
        problem=problem,
        simulation=simulation,
        rule=rule,
        thetas=np.array([one.parameters for one in family]),
        entrants=tuple(ordered),
        draws=draws,
        held_out=Named.of("entrant that meets the rule", held),
        pairs=tuple(pairs),
        left_out=tuple(left_out),
        notes=tuple(_notes(problem, simulation, tuned)),
        seconds=time.perf_counter() - started,
    )


class _Shared:
    """The rule's plants, with what the model and the loop that knows theta do there: found once for all that read them alike."""

    def __init__(self, family: Sequence[Problem], rule: Rule, simulation: Simulation) -> None:
        self.family, self.rule, self.simulation = family, rule, simulation
        self.found: list[tuple[Plants, Plants]] = []

    def read_by(self, entrant: Entrant) -> tuple[Plants, Plants]:
        """With the noise, and without it."""
        problems = [entrant.reads(problem) for problem in self.family]
        for one in self.found:
            if all(a is b for a, b in zip(one[0].problems, problems, strict=True)):
                return one
        case, aim = Case(problems[0], (), self.simulation), self.rule.aim
        noisy = Plants.of(case, replace(aim, constraints=()), problems)
        self.found.append((noisy, Plants.of(case, aim, [quiet(problem) for problem in problems])))
        return self.found[-1]


def _require(problem: Problem, simulation: Simulation, entrants: Sequence[Entrant], rule: Rule, members: int) -> None:
    validate.instance("problem", problem, TrackingProblem)
    validate.instance("simulation", simulation, Simulation)
    validate.instance("rule", rule, Rule)
    validate.whole("members", members, least=8)
    rule.require_steps(simulation)
    posed(problem)
    if not entrants:
        raise InputError("a contest needs entrants, got none")
    names = [one.name for one in entrants]
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(f"entrants must have different names, got {validate.show(twice[0])} twice")


def _rank(one: Qualified, held: dict[str, HeldOut]) -> tuple[bool, int, float]:
    if one.name not in held:
        return (True, 0, one.error)
    return (False, int(held[one.name].lost.sum()), median(held[one.name].error))


def _notes(problem: Problem, simulation: Simulation, tuned: Sequence[Qualified]) -> list[str]:
    """Sentences on what the result is not."""
    said = [f"{one.name}: none of {counted(one.trials, 'tuning')} meets the rule" for one in tuned if not one.meets]
    for one in tuned:
        if one.at_edge:
            said.append(f"{one.name}: {' and '.join(one.at_edge)} at the end of what was searched; beyond it may be better")
    if ModelMotion.of(problem, simulation).comes_to_rest:
        said.append(REST_SENTENCE)
    return said
