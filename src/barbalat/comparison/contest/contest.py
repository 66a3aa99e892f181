"""The contest: the entrants, the search for each under the rule, and the validation of all on new plants, commands and noise."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np

from barbalat import budget, validate
from barbalat.budget import Estimate, Progress, part_of
from barbalat.cases.build import Case
from barbalat.cases.load import load_case
from barbalat.comparison.contest.entrant import Entrant, entrants_of
from barbalat.comparison.contest.result import Contest, paired
from barbalat.comparison.contest.rule import (
    DEFAULT_GAIN_MARGIN,
    DEFAULT_NOISE_SHARE,
    DEFAULT_PLANTS,
    DEFAULT_TRIALS,
    Rule,
    added_noise,
    default_delay_margin,
    with_noise,
)
from barbalat.comparison.contest.tuned import Qualified, qualify
from barbalat.comparison.contest.validation import Draws, Remeasured, Validation, measure, measured_again
from barbalat.comparison.plants import parameters_of, plants_of, require_delays
from barbalat.comparison.search.aim import Plants
from barbalat.comparison.search.search import least_trials
from barbalat.comparison.starts import initial_estimates
from barbalat.judge.settings import Judge
from barbalat.loop.structure import comes_from_outside
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.run.kernel.costs import steps_of
from barbalat.solvers.simulation import Simulation
from barbalat.study.finer_step import refined
from barbalat.study.fixed_steps import fixed_steps
from barbalat.study.ideal_benchmark import NOISE_SENTENCE
from barbalat.study.reference_motion import REST_SENTENCE, ReferenceMotion
from barbalat.study.resolved import resolved
from barbalat.study.verdicts import Criterion
from barbalat.targets import CONTEST, Target, require_continuous_reading
from barbalat.validate import InputError, Named, counted

DEFAULT_MEMBERS = 200
"""Number of validation runs. With this number, the interval of a median ratio extends over 7 % of the runs to either side."""
TUNING_SHARE = 0.85
"""The search takes approximately this fraction of the time. The validation runs take the rest."""


def contest(
    case: str | Path | Case,
    *,
    delay_margin: float | None = None,
    gain_margin: float = DEFAULT_GAIN_MARGIN,
    until: str | Criterion = Criterion.ONSET,
    schemes: Sequence[str] = (),
    sample_time: float | None = None,
    noise: float = DEFAULT_NOISE_SHARE,
    plants: int = DEFAULT_PLANTS,
    trials: int = DEFAULT_TRIALS,
    members: int = DEFAULT_MEMBERS,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Contest:
    """Tune every scheme under one rule, and measure the schemes that meet it on validation plants, commands and noise.

    case          a case file, a bundled case's name, or a ``Case``: its problem and its simulation. Controllers of the case take
                  part only if their class is from outside the package and declares tuned settings
    delay_margin  required delay margin [s]; by default ``default_delay_margin``
    until         "onset": a margin ends where the loop begins to oscillate; "loss": where it loses the commanded motion
    schemes       by their names in case files; by default all that declare tuned settings and support the problem
    sample_time   sample time of all controllers [s]; by default, continuous controllers stay continuous
    noise         noise as a fraction of the model's motion, if the case has no noise
    members       number of validation runs

    Further arguments are as in ``Rule``. Raises InputError.
    """
    whole = case if isinstance(case, Case) else load_case(case)
    problem = posed(whole.problem)
    if sample_time is None and not schemes:
        require_continuous_reading(problem, "give sample_time (--sample-time S)")
    steps = fixed_steps(problem, whole.controllers, whole.simulation)
    simulation = steps.simulation
    margin = default_delay_margin(problem, simulation) if delay_margin is None else delay_margin
    rule = Rule(delay_margin=margin, gain_margin=gain_margin, until=until, plants=plants, trials=trials, seed=seed)
    rule.require_steps(simulation)
    held = margin if sample_time is None else sample_time
    noisy = with_noise(problem, noise, simulation, held, seed)
    own = [one for one in whole.controllers if comes_from_outside(one)]
    entrants, left_out = entrants_of(noisy, simulation, schemes=schemes, own=own, sample_time=sample_time)
    if not entrants:
        raise InputError(f"no scheme takes part: {'; '.join(left_out)}")
    check = None if steps.tolerance is None else resolved(problem, whole.controllers, steps.tolerance)
    found = compete(
        noisy, simulation, entrants, rule, judge=whole.judge, members=members, left_out=left_out, check=check,
        threads=threads, progress=progress,
    )  # fmt: skip
    said = filter(None, (steps.chosen_sentence, added_noise(problem, noisy, noise)))
    return replace(found, notes=(*said, *found.notes))


def posed(problem: TrackingProblem, target: Target = CONTEST) -> Problem:
    """Return the problem if a contest, or another target, can be held on it; raise InputError otherwise."""
    target.require(problem)
    assert isinstance(problem, Problem)
    return problem


def compete(
    problem: Problem,
    simulation: Simulation,
    entrants: Sequence[Entrant],
    rule: Rule,
    *,
    judge: Judge | None = None,
    members: int = DEFAULT_MEMBERS,
    left_out: Sequence[str] = (),
    finer: bool = True,
    check: Simulation | None = None,
    family: Sequence[Problem] | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Contest:
    """Tune every entrant on the problem under the rule, and measure those entrants that meet it on ``members`` validation runs.

    judge     the criteria for the verdicts; by default derived from the model's motion
    left_out  sentences on schemes that do not take part, which are passed on
    finer     whether the first validation run of each command is repeated with a finer step
    check     the simulation with which each chosen tuning is repeated; by default one with a finer step
    family    the plants for tuning, in place of those that the rule draws

    Raises InputError for a problem without a known set, and for entrants with the same name.
    """
    started, judge = time.perf_counter(), judge or Judge()
    _require(problem, simulation, entrants, rule, members)
    _require_budget(simulation, len(entrants), rule, members)
    assert problem.uncertainty is not None
    draws = Draws.drawn(problem, members, rule)
    family = plants_of(problem, problem.uncertainty, rule.plants, rule.seed) if family is None else family
    require_delays([*family, *draws.problems], simulation)
    plants = _Shared(family, rule, simulation)
    tuned = []
    for i, one in enumerate(entrants):
        part = part_of(progress, TUNING_SHARE * i / len(entrants), TUNING_SHARE / len(entrants))
        tuned.append(
            qualify(one, rule, plants.read_by(one), simulation, judge=judge, check=check, threads=threads, progress=part)
        )
    qualified = [one for one in tuned if one.meets]
    rest = part_of(progress, TUNING_SHARE, 1 - TUNING_SHARE)
    held = measure(qualified, draws, rule, simulation, judge=judge, threads=threads, progress=rest)
    ordered = sorted(tuned, key=lambda one: _rank(one, held))
    best = [one for one in ordered if one.meets]
    again = measured_again(best, draws, rule, simulation, held, judge=judge, threads=threads) if finer else {}
    pairs = [paired((a.name, held[a.name]), (b.name, held[b.name])) for a, b in combinations(ordered, 2) if a.meets and b.meets]
    return Contest(
        problem=problem,
        simulation=simulation,
        rule=rule,
        thetas=np.array([parameters_of(one) for one in family]),
        entrants=tuple(ordered),
        draws=draws,
        held_out=Named.of("entrant that satisfies the rule", held),
        pairs=tuple(pairs),
        left_out=tuple(left_out),
        notes=tuple(_notes(problem, simulation, ordered, again, rule, check)),
        again=again,
        seconds=time.perf_counter() - started,
    )


class _Shared:
    """The rule's plants, with the motion of the model and of the loop with known theta. They are computed once for all entrants
    that take the plants in the same form."""

    def __init__(self, family: Sequence[Problem], rule: Rule, simulation: Simulation) -> None:
        self.family, self.rule, self.simulation = family, rule, simulation
        self.found: list[Plants] = []

    def read_by(self, entrant: Entrant) -> Plants:
        """Return the plants in the form that this entrant accepts."""
        problems = [entrant.reads(problem) for problem in self.family]
        for one in self.found:
            if all(a is b for a, b in zip(one.problems, problems, strict=True)):
                return one
        self.found.append(Plants.of(Case(problems[0], (), self.simulation), self.rule.aim, problems))
        return self.found[-1]


def _require(problem: Problem, simulation: Simulation, entrants: Sequence[Entrant], rule: Rule, members: int) -> None:
    validate.instance("problem", problem, TrackingProblem)
    validate.instance("simulation", simulation, Simulation)
    validate.instance("rule", rule, Rule)
    validate.whole("members", members, least=8)
    simulation.require_steps("a contest between entrants")
    rule.require_steps(simulation)
    posed(problem)
    if not entrants:
        raise InputError("a contest needs entrants, got none")
    names = [one.name for one in entrants]
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(f"entrants must have different names, got {validate.show(twice[0])} twice")


RUNS_EACH_PLANT = 12
"""Number of runs of a tuning on one plant, including those with modelling errors. It is 6 for the template case, and 18 with an
observer and a specification of delay and gain."""
RUN_SECONDS = 2e-3
"""Seconds for preparing the equations of a run, in addition to its steps: 1 ms for a small loop and 3 ms with an observer."""
STEP_SECONDS = 1e-8
"""Seconds per step of a member. A small loop takes 3 ns, but most loops are larger."""
CHOSEN_SECONDS, CHOSEN_STEP_SECONDS = 20.0, 3.5e-4
"""Seconds for an entrant after its search, and additionally per step: its best tuning at a finer step, its margins and its
validation runs. Making the kernels of each command takes most of it. For MRAC on the third-order plant, 25 s were measured with
12,000 steps and 41 s with 60,000, equally for 8 and for 64 validation runs."""
HELD_OUT = Estimate(memory=20e3, seconds=2e-3)
"""Seconds for the plant and command of a validation run, in addition to its steps."""


def search_seconds(steps: float, entrants: int, trials: int, plants: int) -> float:
    """Return the time [s] on one core of a search over this number of tunings of each entrant on this number of plants."""
    return entrants * trials * plants * RUNS_EACH_PLANT * (RUN_SECONDS + steps * STEP_SECONDS)


def _require_budget(simulation: Simulation, entrants: int, rule: Rule, members: int) -> None:
    """Raise InputError if the plants, the trials on them or the validation runs exceed the budget."""
    steps, chosen = entrants * steps_of(simulation) * STEP_SECONDS, CHOSEN_SECONDS + CHOSEN_STEP_SECONDS * steps_of(simulation)
    searched = Estimate(seconds=search_seconds(steps_of(simulation), entrants, 1, 1))

    def held_out(count: float) -> Estimate:
        return (HELD_OUT + Estimate(seconds=steps)).times(count) + Estimate(seconds=entrants * chosen)

    drawn = Estimate(memory=HELD_OUT.memory, seconds=HELD_OUT.seconds)
    rest = held_out(members)
    least = min(rule.trials, least_trials(1))
    budget.require("members", members, held_out, least=8)
    budget.require("plants", rule.plants, lambda n: drawn.times(n) + searched.times(least * n) + rest)
    budget.require("trials", rule.trials, lambda n: searched.times(rule.plants * n) + rest, least=least, what="the contest")


def _rank(one: Qualified, held: dict[str, Validation]) -> tuple[bool, int, float]:
    if one.name not in held:
        return (True, 0, one.error)
    return (False, int(held[one.name].lost.sum()), held[one.name].quantiles["median"])


def _notes(
    problem: Problem,
    simulation: Simulation,
    tuned: Sequence[Qualified],
    again: Mapping[str, Remeasured],
    rule: Rule,
    check: Simulation | None,
) -> list[str]:
    """Return sentences on the limitations of the result."""
    said = []
    for one in tuned:
        if not one.meets:
            also = f" even at {one.refused[0].how}" if one.refused else ""
            said.append(f"{one.name}: none of {counted(one.trials, 'tuning')} satisfies the rule{also}")
        elif one.refused:
            own = "the step of the case" if one.refused[0].simulation.tolerance is None else "fixed steps"
            said.append(
                f"{one.name}: {len(one.refused)} better tunings satisfy the rule only at {own}: "
                f"{'; '.join(one.refused[0].broken)}"
            )
        said += [f"{one.name}: {sentence}" for sentence in ([] if one.step is None else one.step.sentences)]
    remedy = "make simulation.dt smaller" if check is None else f"give a simulation.dt below {simulation.dt:g}"
    said += [one.sentence(name, refined(simulation), remedy) for name, one in again.items()]
    if rule.until is Criterion.ONSET and problem.noise is not None:
        said.append(NOISE_SENTENCE)
    for one in tuned:
        if one.at_edge:
            are = "is" if len(one.at_edge) == 1 else "are"
            edge = f"{' and '.join(one.at_edge)} {are} at the end of the search range"
            said.append(f"{one.name}: {edge}; values beyond it may be better")
    said += _starts(problem, tuned)
    if ReferenceMotion.of(problem, simulation).comes_to_rest:
        said.append(REST_SENTENCE)
    return said


def _starts(problem: Problem, tuned: Sequence[Qualified]) -> list[str]:
    """Return sentences on entrants whose initial knowledge differs from that of the others."""
    said = []
    for one in tuned:
        read = one.entrant.reads(problem)
        theta_set = read.known.theta_set
        if theta_set is None:
            continue
        if one.start is None:
            if theta_set.middle.any() and len(initial_estimates(read, one.controller)):
                said.append(f"{one.name}: its estimates may not be estimates of theta, so they start at the scheme's own values")
        elif not np.array_equal(one.start, theta_set.middle):
            said.append(
                f"{one.name} starts with estimates of {validate.show(one.start)} instead of the centre of the known set, "
                f"{validate.show(theta_set.middle)}: its class has no field theta_hat0 that the contest may set"
            )
    return said
