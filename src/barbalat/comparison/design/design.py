"""A guided design: every scheme and the fixed loop tuned under a specification and measured, with at most one recommendation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
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
from barbalat.comparison.contest.rule import DEFAULT_NOISE_SHARE, Rule, added_noise, default_delay_margin, with_noise
from barbalat.comparison.contest.tuned import Qualified
from barbalat.comparison.design.meeting import FIGURES, StepTest, measured, model_settling
from barbalat.comparison.plants import plants_of
from barbalat.controllers import BaselineAlone, Sampled
from barbalat.judge.specification import Specification
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.sweeps.statistics import Share
from barbalat.validate import InputError

DEFAULT_PLANTS, DEFAULT_TRIALS, DEFAULT_MEMBERS = 3, 288, 64
LEAST_GAIN = 1.001
"""The rule's gain margin if the specification requires none: almost none."""
STEP_MEMBERS = 16
"""Validation plants with measured step responses; each takes two recorded runs."""
SEARCH_SHARE = 0.85
"""Approximate share of the time."""
ASKED_IN_WORDS = {
    "settling": "settles in {:.3g} s", "overshoot": "overshoots by {:.3g} of the step", "u_max": "demands |u| up to {:.4g}",
    "noise": "has noise in u of {:.3g} of its largest value", "delay": "tolerates {:.3g} s of added delay",
    "gain": "tolerates the gain multiplied and divided by {:.3g}",
}  # fmt: skip


class NobodyTakesPart(InputError):
    """No entrant takes the case; ``left_out`` are sentences with the reasons."""

    def __init__(self, left_out: Sequence[str]) -> None:
        super().__init__(f"no scheme takes part: {'; '.join(left_out)}")
        self.left_out = tuple(left_out)


@dataclass(frozen=True, eq=False, kw_only=True)
class Candidate:
    """A tuned entrant compared with the specification.

    worst     by requirement, the value on the worst of the tuning's plants
    factor    by requirement, the used share of the admissible value: above 1 it is not met
    held_out  by requirement, the share of the validation plants on which it is not met
    step      by requirement on a step, the worst of the judged ones; empty if there is only one
    """

    tuned: Qualified
    worst: Mapping[str, float]
    factor: Mapping[str, float]
    held_out: Mapping[str, Share]
    step: Mapping[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return self.tuned.name

    @property
    def misses(self) -> dict[str, float]:
        """The factors of the requirements that it misses."""
        return {name: value for name, value in self.factor.items() if not value <= 1}

    @property
    def meets(self) -> bool:
        return self.tuned.meets and not self.misses

    @property
    def tightest(self) -> str:
        """The requirement with the largest used share, which fails first."""
        return max(self.factor, key=self.factor.__getitem__)

    @property
    def broken(self) -> str:
        """The requirements that validation plants do not meet, and how many; empty if they meet all."""
        return ", ".join(f"{name} on {one.count} of {one.judged}" for name, one in self.held_out.items() if one.count)

    @property
    def sentence(self) -> str:
        """What it meets, or what it misses and by how much."""
        if not self.misses:
            said = ", ".join(map(self._said, self.worst))
            return said if self.tuned.meets else f"{said}; but no tuning of it meets every constraint of the search"
        by = {
            name: "beyond any factor" if np.isinf(value) else f"{value:.3g} times the limit"
            for name, value in self.misses.items()
        }
        return "misses " + "; ".join(f"{name}: {self._said(name)}, {how}" for name, how in by.items())

    def _said(self, name: str) -> str:
        value, step = self.worst[name], self.step.get(name)
        if not np.isfinite(value):
            return {"settling": "does not settle"}.get(name, "diverges")
        return f"{ASKED_IN_WORDS[name].format(value)}{f' (the step {step})' if step else ''}"

    def as_json(self) -> dict[str, Any]:
        return {
            "meets": self.meets,
            "tuning": dict(self.tuned.tuning),
            "worst": {name: finite(value) for name, value in self.worst.items()},
            "factor": {name: finite(value) for name, value in self.factor.items()},
            "step": dict(self.step),
            "fails_first": self.tightest,
            "held_out": {name: share.as_json() for name, share in self.held_out.items()},
            "sentence": self.sentence,
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class Design:
    """The result of ``design``: candidates, those that meet the specification first, and the contest that tuned them.

    added_noise  a sentence on the measurement noise that the design adds because the case has none; None if it has its own
    """

    case: Case
    specification: Specification
    test: StepTest
    sample_time: float
    model_settling: float
    candidates: tuple[Candidate, ...]
    contest: Contest
    added_noise: str | None = None

    @property
    def recommended(self) -> Candidate | None:
        """The first candidate that meets everything; None if none does."""
        return self.candidates[0] if self.candidates[0].meets else None

    @property
    def controller(self) -> Controller:
        """The recommended controller, or the one that misses the specification least."""
        return self.candidates[0].tuned.controller

    @property
    def reasons(self) -> list[str]:
        """Plain sentences: the recommendation and its reasons, what fails first, and what no scheme can change."""
        first = self.candidates[0]
        said = []
        if first.meets:
            said.append(f"{first.name} is recommended: it {first.sentence}")
            if first.broken:
                said.append(
                    f"it meets the specification on the tuning's plants, but on validation plants it fails {first.broken}: with "
                    "--plants more of them take part in the tuning"
                )
            others = [one.name for one in self.candidates[1:] if one.meets]
            if others:
                also = "meets" if len(others) == 1 else "meet"
                said.append(f"{', '.join(others)} {also} the specification too, with larger errors on validation plants")
            said.append(f"what fails first is {first.tightest}: {first.factor[first.tightest]:.0%} of what is allowed is used")
        else:
            said.append("none of the schemes meets the specification")
            said += [f"the nearest is {first.name}, which {first.sentence}"]
        said += self._of_the_baseline()
        asked = self.specification.settling
        if asked is not None or self.specification.overshoot is not None:
            said.append(self.test.sentence)
        if asked is not None and self.model_settling > asked:
            said.append(
                f"the reference model itself settles in {self.model_settling:.3g} s where {asked:.3g} s is asked: "
                "make its poles faster, since controllers follow it"
            )
        if self.added_noise is not None:
            decides = "" if self.specification.noise is None else ", on which the required noise share of u depends"
            said.append(f"{self.added_noise}{decides}")
        return said

    @property
    def baseline(self) -> Candidate | None:
        """The fixed loop without adaptation; None if it does not take part."""
        return next((one for one in self.candidates if isinstance(_unsampled(one.tuned.controller), BaselineAlone)), None)

    def _of_the_baseline(self) -> list[str]:
        """A sentence if the loop without adaptation misses the specification, and which misses no scheme mends."""
        found = self.baseline
        if found is None or found.meets:
            return []
        what = "the baseline alone" if self.contest.problem.plant.baseline is not None else "the nominal state feedback alone"
        beside = "" if self.contest.problem.observer is None else ", with the observer,"
        others = [one for one in self.candidates if one is not found]
        shared = [name for name in found.misses if others and all(name in one.misses for one in others)]
        said = [] if found is self.candidates[0] else [f"{what}{beside} already {found.sentence}"]
        if shared:
            said.append(f"every scheme misses {' and '.join(shared)}, and {what}{beside} too: adaptation does not mend it")
        return said

    def as_json(self) -> dict[str, Any]:
        """The document of ``design --json``."""
        asked = {name: value for name, value in vars(self.specification).items() if value is not None}
        first = self.recommended
        contest = self.contest.as_json()
        contest.pop("seconds")  # the rest is bit for bit the same when the command is repeated
        return {
            "case": self.case.name, "specification": asked, "sample_time": self.sample_time,
            "judged": {
                "component": self.test.name, "band": self.test.band,
                "steps": [{"from": one.start, "to": one.end} for one in self.test.stages],
            },
            "model_settling": finite(self.model_settling), "added_noise": self._added_as_json(),
            "recommended": None if first is None else first.name, "reasons": self.reasons,
            "candidates": {one.name: one.as_json() for one in self.candidates}, "contest": contest,
        }  # fmt: skip

    def _added_as_json(self) -> dict[str, Any] | None:
        """The noise that the design added, in the plant's units."""
        noise = self.contest.problem.noise
        if self.added_noise is None or noise is None:
            return None
        return {"std": np.atleast_1d(noise.std).tolist(), "sample_time": noise.sample_time, "meaning": self.added_noise}


def design(
    case: str | Path | Case,
    specification: Specification | None = None,
    *,
    sample_time: float | None = None,
    schemes: Sequence[str] = (),
    baseline: bool = True,
    plants: int = DEFAULT_PLANTS,
    trials: int = DEFAULT_TRIALS,
    members: int = DEFAULT_MEMBERS,
    seed: int = 0,
    noise: float = DEFAULT_NOISE_SHARE,
    own: Sequence[Controller] = (),
    as_set: Sequence[Controller] = (),
    ours: bool = True,
    held_out_steps: bool = True,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Design:
    """Let every scheme and the fixed loop compete under a specification, and recommend one or none.

    All are tuned for the smallest RMS error on the worst of some plants, among the tunings that tolerate the specified delay and
    gain factors and demand no more than ``u_max``. Then settling, overshoot, demand and the effect of noise are measured on these
    plants and on validation plants.

    specification  by default the case's ``[specification]``
    sample_time    sample time of all controllers [s]; by default that of the case's first sampled controller, or else a tenth of
                   the fastest time constant of model and known set
    noise          share of the model's largest motion, added and reported if the case has no noise of its own
    schemes        of the registered ones, by their names in case files; by default all
    baseline       whether the fixed loop without adaptation takes part whatever ``schemes`` are: [baseline], or without one the
                   nominal state feedback
    own            controllers from outside that are tuned too, by their declared settings
    as_set         controllers that take part as they are
    ours           whether the registered schemes take part
    held_out_steps  whether steps are measured on validation plants too, and validation runs are repeated with a finer step
    Further arguments as in ``contest``. Raises InputError.
    """
    whole = case if isinstance(case, Case) else load_case(case)
    asked = specification or whole.specification
    if asked is None:
        raise InputError("the case has no [specification], which states the requirements on a design, such as settling and u_max")
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
    test = StepTest.of(noisy, simulation, whole.judge, asked)
    entrants, left_out = entrants_of(noisy, simulation, schemes=schemes, own=own, sample_time=held, ours=ours)
    entrants += [Entrant.as_set(one) for one in as_set]
    if baseline and not any(one.name == BaselineAlone().name for one in entrants):
        alone, _ = entrants_of(noisy, simulation, schemes=["baseline"], sample_time=held)
        entrants += alone
    if not entrants:
        raise NobodyTakesPart(left_out)
    found = compete(
        noisy, simulation, entrants, rule, judge=whole.judge, members=members, left_out=left_out,
        finer=held_out_steps, threads=threads, progress=part_of(progress, 0, SEARCH_SHARE),
    )  # fmt: skip
    assert noisy.uncertainty is not None
    tuning = plants_of(noisy, noisy.uncertainty, plants, seed)
    unseen = found.draws.problems[: min(STEP_MEMBERS, len(found.draws))] if held_out_steps else []
    candidates = []
    for i, one in enumerate(found.entrants):
        candidates.append(_candidate(one, tuning, unseen, test, whole, asked))
        if progress is not None:
            progress(SEARCH_SHARE + (1 - SEARCH_SHARE) * (i + 1) / len(found.entrants))
    order = sorted(range(len(candidates)), key=lambda i: _rank(candidates[i], i))
    return Design(
        case=replace(whole, problem=problem), specification=asked, test=test, sample_time=held,
        model_settling=model_settling(noisy, test), candidates=tuple(candidates[i] for i in order), contest=found,
        added_noise=added_noise(problem, noisy, noise),
    )  # fmt: skip


def _unsampled(controller: Controller) -> Controller:
    return controller.controller if isinstance(controller, Sampled) else controller


def _sample_time(case: Case, problem: Problem) -> float:
    for one in case.controllers:
        if isinstance(one, Sampled):
            return float(one.sample_time)
    fastest = default_delay_margin(problem, case.simulation)
    return max(round(fastest / case.simulation.dt), 1) * case.simulation.dt


def _rank(one: Candidate, place: int) -> tuple[bool, float, int]:
    """Those that meet everything come first, in the contest's order; then by the largest miss, which is infinite without a
    tuning."""
    return not one.meets, 0.0 if one.meets else max(one.factor.values()), place


def _candidate(
    one: Qualified, tuning: Sequence[Problem], unseen: Sequence[Problem], test: StepTest, case: Case, asked: Specification
) -> Candidate:
    reads = one.entrant.reads
    known, steps = measured([reads(problem) for problem in tuning], one.controller, test, case.judge)
    held, _ = measured([reads(problem) for problem in unseen], one.controller, test, case.judge)
    worst, factor, shares, which = {}, {}, {}, {}
    for name in FIGURES:
        limit = getattr(asked, name)
        if limit is None:
            continue
        worst[name] = float(known[name].max())
        factor[name] = _used(worst[name], limit)
        if name in steps and len(test.stages) > 1:
            which[name] = steps[name][int(known[name].argmax())]
        if unseen:
            shares[name] = Share.of(np.array([_used(float(value), limit) > 1 for value in held[name]]))
    if asked.delay is not None:
        worst["delay"] = one.delay_margin_measured
        factor["delay"] = np.inf if worst["delay"] <= 0 else asked.delay / worst["delay"]
    if asked.gain is not None:
        worst["gain"] = one.gain_margin_measured
        factor["gain"] = np.inf if worst["gain"] <= 1 else (asked.gain - 1) / (worst["gain"] - 1)
    return Candidate(tuned=one, worst=worst, factor=factor, held_out=shares, step=which)


def _used(value: float, limit: float) -> float:
    """The used share of the admissible value; for an admissible value of zero, infinite if anything is used."""
    return value / limit if limit > 0 else 0.0 if value == 0 else np.inf
