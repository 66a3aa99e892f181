"""Tunes one entrant under the rule: the search, the choice, its margins, and the factor by which they exceed the requirement."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from barbalat.budget import Progress
from barbalat.certificates.certify import certify
from barbalat.comparison.contest.entrant import Entrant, VariedEntrant
from barbalat.comparison.contest.rule import Rule
from barbalat.comparison.ranges import Space
from barbalat.comparison.search.aim import Plants, StepCheck, Trial
from barbalat.comparison.search.probing import Probing
from barbalat.comparison.search.quantity import PROBES
from barbalat.comparison.search.search import least_trials, search
from barbalat.comparison.search.trials import Trials, in_one_kernel
from barbalat.comparison.starts import start_of
from barbalat.comparison.tune.result import best_of
from barbalat.judge.settings import Judge
from barbalat.judge.verdict import Verdict
from barbalat.loop.binding import bound
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller, SampledEquations
from barbalat.solvers.simulation import Simulation
from barbalat.study.delay_margin import DelayMargins
from barbalat.study.ideal_benchmark import Judging
from barbalat.study.verdicts import Criterion, verdict_of
from barbalat.validate import Array

EDGE_SHARE = 0.02
"""Fraction of the range of a parameter. A tuning this close to an end might improve beyond it."""


@dataclass(frozen=True, kw_only=True)
class Probed:
    """The delay [s] that a loop tolerates, and the factors by which the input's effectiveness may be multiplied and divided."""

    delay: float
    gain_up: float
    gain_down: float

    def slack(self, rule: Rule) -> dict[str, float]:
        """Return the factor by which each margin exceeds its requirement."""
        return {
            "delay": self.delay / rule.delay_margin,
            "gain_up": self.gain_up / rule.gain_margin,
            "gain_down": self.gain_down / rule.gain_margin,
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class Qualified:
    """An entrant with its tuning under the rule.

    tuning       values of the knobs; if no tuning meets the rule, those of the nearest tuning
    meets        whether the tuning keeps both margins
    error        RMS |e| on the worst tuning plant; infinite if a run diverged
    margins      the margins by each criterion, on the worst tuning plant
    own          the certificate values that designers examine, by key, as far as the certificate claims them
    settled      the fraction of the error that the second half of the trials removed, from 0 to 1; None if the first half found
                 no tuning that meets the rule
    at_edge      knobs that lie at an end of their range, if values beyond it exist
    sample_time  the sample time [s]; None for a continuous controller
    start        (p,) the initial estimates of theta; None without estimates, or if they are not known to be estimates of theta
    step         the result of a finer step for the tuning; None if the tuning does not even meet the rule at the step of the case
    refused      results of a finer step for better tunings, which meet the rule only at the step of the case
    verdict      the judge's verdict on the run of the tuning on the plant of the case
    """

    entrant: Entrant
    controller: Controller
    tuning: Mapping[str, float]
    meets: bool
    error: float
    margins: Mapping[Criterion, Probed]
    own: Mapping[str, float]
    settled: float | None
    at_edge: tuple[str, ...]
    trials: int
    runs: int
    sample_time: float | None
    start: Array | None
    step: StepCheck | None
    refused: tuple[StepCheck, ...]
    verdict: Verdict

    @property
    def delay_margin_measured(self) -> float:
        """The delay margin [s] on the worst tuning plant: the delay at which the run is lost or enters a limit cycle."""
        return self.margins[Criterion.ONSET].delay

    @property
    def gain_margin_measured(self) -> float:
        """The factor by which the input gain may be multiplied or divided on the worst tuning plant."""
        found = self.margins[Criterion.ONSET]
        return min(found.gain_up, found.gain_down)

    @property
    def name(self) -> str:
        return self.entrant.name

    def as_json(self, rule: Rule) -> dict[str, object]:
        """Return the fields of the JSON document, without the measurements on validation plants."""
        return {
            "meets": self.meets,
            "verdict": self.verdict.as_json(),
            "delay_margin_measured": self.delay_margin_measured,
            "gain_margin_measured": self.gain_margin_measured,
            "tuning": dict(self.tuning),
            "ranges": {name: str(one) for name, one in zip(self.tuning, self.entrant.space.ranges.values(), strict=True)},
            "sample_time": self.sample_time,
            "theta_hat0": None if self.start is None else self.start.tolist(),
            "rms_e": self.error if np.isfinite(self.error) else None,
            "margins": {which.value: dict(vars(found)) for which, found in self.margins.items()},
            "slack": self.margins[rule.until].slack(rule),
            "own_objective": dict(self.own),
            "settled": self.settled,
            "at_edge": list(self.at_edge),
            "trials": self.trials,
            "runs": self.runs,
            "finer_step": None if self.step is None else self.step.as_json(),
            "refused_at_finer_step": [one.as_json() for one in self.refused],
        }


def qualify(
    entrant: Entrant,
    rule: Rule,
    plants: Plants,
    simulation: Simulation,
    *,
    judge: Judge,
    check: Simulation | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Qualified:
    """Search under the rule. ``plants`` are the plants of the rule, in the form that this entrant accepts; ``check`` as in
    ``Trials``."""
    space, problem = entrant.space, plants.problems[0]
    assert isinstance(problem, Problem)
    varied = VariedEntrant(entrant, problem, simulation, space.paths, judge)
    together = not len(space) or in_one_kernel(varied, space)
    trials = Trials(varied, 0, rule.aim, together=together, shared=plants, threads=threads, check=check)
    _try_tunings(trials, space, rule, progress)
    best = best_of(trials)
    found = best.nearest
    controller = entrant.controller(found.row)
    equations = bound(problem, controller)
    margins = _probed(trials, plants, controller, rule, simulation, judge)
    return Qualified(
        entrant=entrant,
        controller=controller,
        tuning=dict(zip(entrant.knobs.values, map(float, found.row), strict=True)),
        meets=best.chosen is not None,
        error=np.inf if found.value is None else float(found.value),
        margins=margins,
        own=_own(entrant, problem, controller, simulation),
        settled=_settled(trials.all, rule),
        at_edge=_at_edge(entrant, found.row),
        trials=len(trials.all),
        runs=trials.runs,
        sample_time=equations.sample_time if isinstance(equations, SampledEquations) else None,
        start=start_of(problem, controller),
        step=best.check,
        refused=tuple(best.refused),
        verdict=verdict_of(problem, controller, simulation, judge),
    )


def _try_tunings(trials: Trials, space: Space, rule: Rule, progress: Progress | None) -> None:
    """Try as many tunings as the rule allows, but at least as many as the search needs; without knobs, only one."""
    if not len(space):
        trials.judged(np.zeros((1, 0)), np.inf)
        return
    count = max(rule.trials, least_trials(len(space)))
    search(trials.scoring(space), len(space), trials=count, seed=rule.seed, start=None, progress=progress)


def _probed(
    trials: Trials, plants: Plants, controller: Controller, rule: Rule, simulation: Simulation, judge: Judge
) -> dict[Criterion, Probed]:
    """Return all margins of the tuning, by both criteria, on the worst plant."""
    members = [(problem, controller) for problem in plants.problems]
    probing = Probing(members, simulation, np.arange(len(members)), plants, Judging(judge), trials.threads)
    delays, gains = (PROBES[one.quantity.name] for one in rule.constraints)
    (delay,) = probing.each_margin(delays, rule.delay_margin)
    up, down = probing.each_margin(gains, rule.gain_margin - 1)
    trials.runs += probing.runs

    def least(which: Criterion, found: DelayMargins) -> float:
        return float((found.onset if which is Criterion.ONSET else found.loss).tolerates.min())

    return {
        which: Probed(delay=least(which, delay), gain_up=1 + least(which, up), gain_down=1 + least(which, down))
        for which in Criterion
    }


def _own(entrant: Entrant, problem: Problem, controller: Controller, simulation: Simulation) -> dict[str, float]:
    """Return the examined values of the certificate on the plant of the problem, if there are any."""
    if not entrant.knobs.aims:
        return {}
    certificate = certify(problem, (controller,), simulation, keys=entrant.knobs.aims)[controller.name]
    found = {}
    for key in entrant.knobs.aims:
        value = certificate.values.get(key)
        if isinstance(value, dict):
            value = value.get("value_upper", value.get("upper"))
        if isinstance(value, (int, float)):
            found[key] = float(value)
    return found


def _settled(trials: list[Trial], rule: Rule) -> float | None:
    """Return the fraction by which the best trial improves on the best trial of the first half."""
    scores = [trial.score if trial.meets(rule.aim) else np.inf for trial in trials]
    half, all_of_them = min(scores[: max(len(scores) // 2, 1)]), min(scores)
    return float(1 - all_of_them / half) if np.isfinite(half) and half > 0 else None


def _at_edge(entrant: Entrant, row: Array) -> tuple[str, ...]:
    shares = [one.share(float(value)) for one, value in zip(entrant.space.ranges.values(), row, strict=True)]
    near = [share is None or min(share, 1 - share) < EDGE_SHARE for share in shares]
    return tuple(
        name for name, close in zip(entrant.knobs.values, near, strict=True) if close and name not in entrant.knobs.whole
    )
