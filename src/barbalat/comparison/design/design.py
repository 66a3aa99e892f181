"""A guided design: every scheme and the fixed loop tuned under a specification, measured, and one recommended or none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.budget import Progress, part_of
from barbalat.cases.build import Case
from barbalat.cases.load import load_case
from barbalat.certificates.linear_loops.margin_values import finite
from barbalat.comparison.contest.contest import compete, posed
from barbalat.comparison.contest.entrant import Entrant, entrants_of
from barbalat.comparison.contest.result import Contest
from barbalat.comparison.contest.rule import DEFAULT_NOISE_SHARE, Rule, default_delay_margin, with_noise
from barbalat.comparison.contest.tuned import Qualified
from barbalat.comparison.design.meeting import FIGURES, Step, measured, model_settling
from barbalat.comparison.plants import plants_of
from barbalat.controllers import Sampled
from barbalat.judge.specification import Specification
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.sweeps.statistics import Share
from barbalat.validate import InputError

DEFAULT_PLANTS, DEFAULT_TRIALS, DEFAULT_MEMBERS = 3, 288, 64
LEAST_GAIN = 1.001
"""Of a rule where the specification asks for no gain: next to none."""
STEP_MEMBERS = 16
"""Held-out plants on which steps are measured; each is two recorded runs."""
SEARCH_SHARE = 0.85
"""Of the time, about."""
ASKED_IN_WORDS = {
    "settling": "settles in {:.3g} s", "overshoot": "overshoots by {:.3g} of the step", "u_max": "demands |u| up to {:.4g}",
    "noise": "has noise shake u by {:.3g} of its largest value", "delay": "tolerates {:.3g} s of added delay",
    "gain": "tolerates the gain times and over {:.3g}",
}  # fmt: skip


@dataclass(frozen=True, eq=False, kw_only=True)
class Candidate:
    """A tuned entrant beside the specification.

    worst     by requirement, the value on the worst of the tuning's plants
    factor    by requirement, how much of what is allowed is used: above 1 it is not met
    held_out  by requirement, the share of the held-out plants on which it is not met
    """

    tuned: Qualified
    worst: Mapping[str, float]
    factor: Mapping[str, float]
    held_out: Mapping[str, Share]

    @property
    def name(self) -> str:
        return self.tuned.name

    @property
    def meets(self) -> bool:
        return self.tuned.meets and all(value <= 1 for value in self.factor.values())

    @property
    def tightest(self) -> str:
        """The requirement of which most is used: what fails first."""
        return max(self.factor, key=self.factor.__getitem__)

    @property
    def sentence(self) -> str:
        """What it meets, or what it misses and by how much."""
        misses = {name: value for name, value in self.factor.items() if not value <= 1}
        if not misses:
            said = ", ".join(_said(name, value) for name, value in self.worst.items())
            return said if self.tuned.meets else f"{said}; but no tuning of it meets every constraint of the search"
        by = {
            name: "beyond any factor" if np.isinf(value) else f"{value:.3g} times what is allowed"
            for name, value in misses.items()
        }
        return "misses " + "; ".join(f"{name}: {_said(name, self.worst[name])}, {how}" for name, how in by.items())

    def as_json(self) -> dict[str, Any]:
        return {
            "meets": self.meets,
            "tuning": dict(self.tuned.tuning),
            "worst": {name: finite(value) for name, value in self.worst.items()},
            "factor": {name: finite(value) for name, value in self.factor.items()},
            "fails_first": self.tightest,
            "held_out": {name: share.as_json() for name, share in self.held_out.items()},
            "sentence": self.sentence,
        }


def _said(name: str, value: float) -> str:
    return ASKED_IN_WORDS[name].format(value) if np.isfinite(value) else {"settling": "does not settle"}.get(name, "diverges")


@dataclass(frozen=True, eq=False, kw_only=True)
class Design:
    """The result of ``design``: candidates, those that meet the specification first, and the contest that tuned them."""

    case: Case
    specification: Specification
    step: Step
    sample_time: float
    model_settling: float
    candidates: tuple[Candidate, ...]
    contest: Contest

    @property
    def recommended(self) -> Candidate | None:
        """The first candidate that meets everything; None where none does."""
        return self.candidates[0] if self.candidates[0].meets else None

    @property
    def controller(self) -> Controller:
        """The recommended one, or the nearest miss."""
        return self.candidates[0].tuned.controller

    @property
    def reasons(self) -> list[str]:
        """Plain sentences: what is recommended and why, what fails first, what none of them can change."""
        first = self.candidates[0]
        said = []
        if first.meets:
            said.append(f"{first.name} is recommended: it {first.sentence}")
            others = [one.name for one in self.candidates[1:] if one.meets]
            if others:
                also = "meets" if len(others) == 1 else "meet"
                said.append(f"{', '.join(others)} {also} the specification too, with larger errors on held-out plants")
            said.append(f"what fails first is {first.tightest}: {first.factor[first.tightest]:.0%} of what is allowed is used")
        else:
            said.append("none of the schemes meets the specification")
            said += [f"the nearest is {first.name}, which {first.sentence}"]
        asked = self.specification.settling
        if asked is not None and self.model_settling > asked:
            said.append(
                f"the reference model itself settles in {self.model_settling:.3g} s where {asked:.3g} s is asked: "
                "make its poles faster, since controllers follow it"
            )
        return said

    def as_json(self) -> dict[str, Any]:
        """The document of ``design --json``."""
        asked = {name: value for name, value in vars(self.specification).items() if value is not None}
        first = self.recommended
        contest = self.contest.as_json()
        contest.pop("seconds")  # the rest is the same in every bit when the command is run again
        return {
            "case": self.case.name, "specification": asked, "sample_time": self.sample_time,
            "judged": {"component": self.step.name, "rest": self.step.rest, "band": self.step.band},
            "model_settling": finite(self.model_settling),
            "recommended": None if first is None else first.name, "reasons": self.reasons,
            "candidates": {one.name: one.as_json() for one in self.candidates}, "contest": contest,
        }  # fmt: skip


def design(
    case: str | Path | Case,
    specification: Specification | None = None,
    *,
    sample_time: float | None = None,
    schemes: Sequence[str] = (),
    plants: int = DEFAULT_PLANTS,
    trials: int = DEFAULT_TRIALS,
    members: int = DEFAULT_MEMBERS,
    seed: int = 0,
    noise: float = DEFAULT_NOISE_SHARE,
    own: Sequence[Controller] = (),
    as_set: Sequence[Controller] = (),
    ours: bool = True,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Design:
    """Let every scheme and the fixed loop compete under a specification, and recommend one or none.

    All are tuned for the smallest RMS error on the worst of some plants, among the tunings that tolerate the specified delay and
    gain factors and demand no more than ``u_max``. Then settling, overshoot, demand and the noise's share are measured on these
    plants and on held-out ones.

    specification  by default the case's ``[specification]``
    sample_time    with which all run [s]; by default that of the case's first sampled controller, or else a tenth of the fastest
                   time constant of model and known set
    own            controllers from outside that are tuned too, by what they say of it
    as_set         controllers that take part as they are
    ours           whether the registered schemes take part
    The rest as of ``contest``. Raises InputError.
    """
    whole = case if isinstance(case, Case) else load_case(case)
    asked = specification or whole.specification
    if asked is None:
        raise InputError("the case has no [specification], which says what a design must meet, such as settling and u_max")
    validate.instance("specification", asked, Specification)
    problem, simulation = posed(whole.problem), whole.simulation
    simulation.require_steps("a design")
    held = _sample_time(whole, problem) if sample_time is None else sample_time
    rule = Rule(
        delay_margin=asked.delay or 2 * simulation.dt, gain_margin=asked.gain or LEAST_GAIN, plants=plants, trials=trials,
        seed=seed,
        also=() if asked.u_max is None else (f"max_abs_u <= {asked.u_max!r}",),
    )  # fmt: skip
    rule.require_steps(simulation)
    noisy = with_noise(problem, noise, simulation, held, seed)
    step = Step.of(noisy, simulation, whole.judge, asked)
    entrants, left_out = entrants_of(noisy, simulation, schemes=schemes, own=own, sample_time=held, ours=ours)
    entrants += [Entrant.as_set(one) for one in as_set]
    if not entrants:
        raise InputError(f"no scheme takes part: {'; '.join(left_out)}")
    found = compete(
        noisy, simulation, entrants, rule, judge=whole.judge, members=members, left_out=left_out, threads=threads,
        progress=part_of(progress, 0, SEARCH_SHARE),
    )  # fmt: skip
    assert noisy.uncertainty is not None
    tuning = plants_of(noisy, noisy.uncertainty, plants, seed)
    unseen = found.draws.problems[: min(STEP_MEMBERS, len(found.draws))]
    candidates = []
    for i, one in enumerate(found.entrants):
        candidates.append(_candidate(one, tuning, unseen, step, whole, asked))
        if progress is not None:
            progress(SEARCH_SHARE + (1 - SEARCH_SHARE) * (i + 1) / len(found.entrants))
    order = sorted(range(len(candidates)), key=lambda i: _rank(candidates[i], i))
    return Design(
        case=replace(whole, problem=problem), specification=asked, step=step, sample_time=held,
        model_settling=model_settling(noisy, step), candidates=tuple(candidates[i] for i in order), contest=found,
    )  # fmt: skip


def _sample_time(case: Case, problem: Problem) -> float:
    for one in case.controllers:
        if isinstance(one, Sampled):
            return float(one.sample_time)
    fastest = default_delay_margin(problem, case.simulation)
    return max(round(fastest / case.simulation.dt), 1) * case.simulation.dt


def _rank(one: Candidate, place: int) -> tuple[bool, float, int]:
    """Those that meet everything in the contest's order; then by the largest miss, of which no tuning is infinite."""
    return not one.meets, 0.0 if one.meets else max(one.factor.values()), place


def _candidate(
    one: Qualified, tuning: Sequence[Problem], unseen: Sequence[Problem], step: Step, case: Case, asked: Specification
) -> Candidate:
    reads = one.entrant.reads
    known = measured([reads(problem) for problem in tuning], one.controller, step, case.judge)
    held = measured([reads(problem) for problem in unseen], one.controller, step, case.judge)
    worst, factor, shares = {}, {}, {}
    for name in FIGURES:
        limit = getattr(asked, name)
        if limit is None:
            continue
        worst[name] = float(known[name].max())
        factor[name] = _used(worst[name], limit)
        shares[name] = Share.of(np.array([_used(float(value), limit) > 1 for value in held[name]]))
    if asked.delay is not None:
        worst["delay"] = one.delay_margin_measured
        factor["delay"] = np.inf if worst["delay"] <= 0 else asked.delay / worst["delay"]
    if asked.gain is not None:
        worst["gain"] = one.gain_margin_measured
        factor["gain"] = np.inf if worst["gain"] <= 1 else (asked.gain - 1) / (worst["gain"] - 1)
    return Candidate(tuned=one, worst=worst, factor=factor, held_out=shares)


def _used(value: float, limit: float) -> float:
    """The share of what is allowed that is used; of nothing allowed, infinite where something is used."""
    return value / limit if limit > 0 else 0.0 if value == 0 else np.inf
