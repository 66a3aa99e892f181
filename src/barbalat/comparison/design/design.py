"""A guided design. Every scheme and the fixed loop are tuned under a specification and measured, and at most one is
recommended."""

from __future__ import annotations

import math
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
from barbalat.comparison.contest.validation import VALIDATION_SEED, Draws, Validation, measure
from barbalat.comparison.design.meeting import FIGURES, StepTest, measured, model_settling
from barbalat.comparison.plants import extreme_plants, plants_of, require_delays
from barbalat.controllers import BaselineAlone, Sampled
from barbalat.judge.specification import Specification
from barbalat.problem.known_set import KnownSet
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.study.fixed_steps import fixed_steps
from barbalat.study.resolved import resolved
from barbalat.sweeps.statistics import Share
from barbalat.targets import DESIGN
from barbalat.validate import Array, InputError, counted

DEFAULT_PLANTS, DEFAULT_TRIALS, DEFAULT_MEMBERS = 4, 288, 64
LEAST_GAIN = 1.001
"""The rule's gain margin if the specification requires none. This is almost no margin."""
STEP_MEMBERS, EXTREME_MEMBERS = 12, 6
"""Numbers of random validation plants, and of extreme validation plants in addition to the extreme plants of the tuning. Each
takes three recorded runs."""
SEARCH_SHARE, FIRST_ROUND_SHARE = 0.85, 0.4
"""The search, and the first round of it, take approximately these fractions of the time."""
ROUNDS = 2
"""Number of validation plants with failures that are added to the tuning plants. They are added once, unless an entrant with a
smaller error on the tuning plants meets everything."""
ASKED_IN_WORDS = {
    "settling": "settles in {:.3g} s", "overshoot": "overshoots by {:.3g} % of the step", "u_max": "demands |u| up to {:.4g}",
    "error": "has |e| up to {:.4g} under the command of the case",
    "noise": "has noise in u of {:.3g} times its largest value", "delay": "tolerates {:.3g} s of added delay",
    "gain": "tolerates the gain multiplied and divided by {:.3g}",
}  # fmt: skip
CLEARLY_LESS = 0.9
"""A candidate misses a requirement by clearly less than another one if the ratio of the factors by which they miss it is below
this."""
LOST = "lost"
"""The requirement, which always applies, that no validation run is lost or in a limit cycle."""


class NobodyTakesPart(InputError):
    """No entrant supports the case. ``left_out`` contains the reasons as sentences."""

    def __init__(self, left_out: Sequence[str]) -> None:
        super().__init__(f"no scheme takes part: {'; '.join(left_out)}")
        self.left_out = tuple(left_out)


@dataclass(frozen=True, eq=False, kw_only=True)
class Candidate:
    """A tuned entrant compared with the specification.

    worst     by requirement, the value on the worst tuning plant
    factor    by requirement, the used fraction of the admissible value; above 1 the requirement is not met
    held_out  by requirement, the fraction of the validation plants on which it is not met
    step      by requirement on a step, the worst of the judged steps; empty if only one step is judged
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
        """The factors of the requirements that the candidate violates."""
        return {name: value for name, value in self.factor.items() if not value <= 1}

    @property
    def distance(self) -> float:
        """The distance from the specification: the root of the sum of the squared logarithms of the factors by which requirements
        are violated. Requirements that are violated beyond any factor are left out."""
        return math.hypot(*(math.log(value) for value in self.misses.values() if math.isfinite(value)))

    @property
    def meets(self) -> bool:
        return self.tuned.meets and not self.misses

    @property
    def tightest(self) -> str:
        """The requirement with the largest used fraction, which would fail first."""
        return max(self.factor, key=self.factor.__getitem__)

    @property
    def sentence(self) -> str:
        """A sentence on what the candidate meets, or on the requirements that it violates and by how much."""
        if not self.misses:
            said = ", ".join(self._said(name) for name in self.worst if name != LOST)
            return said if self.tuned.meets else f"{said}; but no tuning of it meets every constraint of the search"
        return "misses " + "; ".join(map(self._missed, self.misses))

    def missed_less(self, other: Candidate, name: str) -> bool:
        """Whether both candidates miss a requirement, and this one misses it by clearly less or on at most half as many
        validation plants."""
        counts = [0 if name not in one.held_out else one.held_out[name].count for one in (self, other)]
        return self.misses[name] < CLEARLY_LESS * other.misses[name] or 2 * counts[0] <= counts[1] > 0

    def _missed(self, name: str) -> str:
        share = self.held_out.get(name)
        on = "" if share is None or not share.count else f" on {share.count} of {counted(share.judged, 'validation plant')}"
        if name == LOST:
            return f"it is lost or in a limit cycle{on}"
        if name in ("delay", "gain") and on and share is not None and self.misses[name] == 1 + share.share:
            return f"{name}: {self._said(name)}, but less than required{on}"
        far = "beyond any factor" if np.isinf(self.misses[name]) else f"{self.misses[name]:.3g} times the limit"
        return f"{name}: {self._said(name)}, {far}{f' and missed{on}' if on else ''}"

    def _said(self, name: str) -> str:
        value, step = self.worst[name], self.step.get(name)
        if not np.isfinite(value):
            return {"settling": "does not settle"}.get(name, "diverges")
        where = " on the tuning plants" if name in ("delay", "gain") and name in self.held_out else ""
        said = ASKED_IN_WORDS[name].format(100 * value if name == "overshoot" else value)
        return f"{said}{where}{f' (the step {step})' if step else ''}"

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

    added_noise  a sentence on the measurement noise that the design adds because the case has none; None if the case has noise
    tried        the numbers of plants for tuning and for validation on which everything was measured
    """

    case: Case
    specification: Specification
    test: StepTest
    sample_time: float
    model_settling: float
    candidates: tuple[Candidate, ...]
    contest: Contest
    added_noise: str | None = None
    tried: tuple[int, int] = (0, 0)

    @property
    def recommended(self) -> Candidate | None:
        """The first candidate that meets everything, or None."""
        return self.candidates[0] if self.candidates[0].meets else None

    @property
    def controller(self) -> Controller:
        """The recommended controller, or the controller that is closest to the specification."""
        return self.candidates[0].tuned.controller

    def failed(self, one: Candidate) -> Share | None:
        """The fraction of the contest's validation runs, with other plants and commands, in which a candidate failed; None if no
        tuning of it satisfies the rule of the search."""
        held = self.contest.held_out.get(one.name)
        return None if held is None else held.failures["lost"]

    def failure(self, one: Candidate) -> str | None:
        """A sentence on the validation runs in which a candidate failed; None if it failed in none."""
        share = self.failed(one)
        if share is None or not share.count:
            return None
        return (
            f"{share.count} of {counted(share.judged, 'validation run')}, whose commands are {self.contest.draws.words}, were "
            f"lost, ended in a limit cycle, or followed the model in no component"
        )

    @property
    def headline(self) -> str:
        """Which controller meets the specification, and whether it fails under other commands; or that none meets it."""
        first = self.recommended
        if first is None:
            return "No scheme meets the specification"
        failure = self.failure(first)
        meets = f"{first.name} meets the specification"
        return meets if failure is None else f"{meets} only under the command of the case: {failure}"

    @property
    def reasons(self) -> list[str]:
        """Sentences on the recommendation and its reasons, on the tightest requirement, and on what no scheme can change."""
        first = self.candidates[0]
        said = []
        if first.meets:
            said.append(f"{first.name} is recommended: it {first.sentence}")
            said += self._failing_otherwise()
            others = [one.name for one in self.candidates[1:] if one.meets]
            if others:
                also = "meets" if len(others) == 1 else "meet"
                said.append(
                    f"{', '.join(others)} {also} the specification too, with more failed validation runs or larger errors"
                )
            said.append(
                f"the tightest requirement is {first.tightest}: {first.factor[first.tightest] * 100:.0f} % of the limit is used"
            )
        else:
            said.append("none of the schemes meets the specification")
            said += [f"the scheme that comes nearest, by all its misses together, is {first.name}, which {first.sentence}"]
            if any(first.held_out[name].count for name in first.misses if name in first.held_out):
                said.append("a larger --plants tunes on more plants, which may prevent failures on validation plants")
        if self.tried[1]:
            said.append(
                f"all of this is measured on {sum(self.tried)} plants, {self.tried[0]} for tuning and {self.tried[1]} for "
                f"validation: the plant of the case, extremes of its ranges, and random plants. Delay and gain are tested on "
                f"validation plants only up to the required values. Nothing is guaranteed for plants in between"
            )
        said += self._of_the_baseline()
        asked = self.specification.settling
        if asked is not None or self.specification.overshoot is not None:
            said.append(self.test.sentence)
        if asked is not None and self.model_settling > asked:
            said.append(
                f"the reference model itself settles in {self.model_settling:.3g} s, but {asked:.3g} s is required. "
                f"Controllers track the model{self._faster_model}"
            )
        if self.added_noise is not None:
            decides = "" if self.specification.noise is None else ", on which the required noise fraction of u depends"
            said.append(f"{self.added_noise}{decides}")
        return said

    def _failing_otherwise(self) -> list[str]:
        """Return sentences on the failures of the recommended controller under other commands, and on candidates without such
        failures."""
        failure = self.failure(self.candidates[0])
        if failure is None:
            return []
        sound = [one.name for one in self.candidates if (share := self.failed(one)) is not None and not share.count]
        said = [f"the specification does not ask for other commands, but {failure}"]
        if sound:
            said.append(f"candidates that failed in none of these runs miss the specification: {'; '.join(sound)}")
        return said

    @property
    def _faster_model(self) -> str:
        around = self.contest.problem.plant.baseline is not None
        own = ", which is the loop of the baseline with the nominal plant: make the baseline faster"
        return own if around else ": make its poles faster"

    @property
    def baseline(self) -> Candidate | None:
        """The fixed loop without adaptation, or None if it does not take part."""
        return next((one for one in self.candidates if isinstance(_unsampled(one.tuned.controller), BaselineAlone)), None)

    def _of_the_baseline(self) -> list[str]:
        """Return a sentence if the loop without adaptation violates the specification, and a sentence on the requirements that no
        scheme meets either."""
        found = self.baseline
        if found is None or found.meets:
            return []
        what = "the baseline alone" if self.contest.problem.plant.baseline is not None else "the nominal state feedback alone"
        beside = "" if self.contest.problem.observer is None else ", with the observer,"
        others = [one for one in self.candidates if one is not found]
        shared = [name for name in found.misses if others and all(name in one.misses for one in others)]
        said = [] if found is self.candidates[0] else [f"{what}{beside} already {found.sentence}"]
        if shared:
            helps = any(one.missed_less(found, name) for name in shared for one in others)
            end = "adaptation helps, but not enough" if helps else "adaptation does not help"
            said.append(f"every scheme misses {' and '.join(shared)}, and so does {what}{beside.rstrip(',')}: {end}")
        return said

    def as_json(self) -> dict[str, Any]:
        """Return the document of ``design --json``."""
        asked = {name: value for name, value in vars(self.specification).items() if value is not None}
        first = self.recommended
        contest = self.contest.as_json()
        contest.pop("seconds")  # the rest is the same, bit for bit, when the command is repeated
        return {
            "case": self.case.name, "specification": asked, "sample_time": self.sample_time,
            "judged": {
                "component": self.test.name, "band": self.test.band,
                "steps": [{"from": one.start, "to": one.end} for one in self.test.stages],
            },
            "model_settling": finite(self.model_settling), "added_noise": self._added_as_json(),
            "recommended": None if first is None else first.name, "headline": self.headline, "reasons": self.reasons,
            "candidates": {one.name: one.as_json() | {"failed": self._failed_as_json(one)} for one in self.candidates},
            "contest": contest,
        }  # fmt: skip

    def _failed_as_json(self, one: Candidate) -> dict[str, Any] | None:
        share = self.failed(one)
        return None if share is None else share.as_json()

    def _added_as_json(self) -> dict[str, Any] | None:
        """Return the noise that the design added, in the plant's units."""
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
    validated: bool = True,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Design:
    """Compare every scheme and the fixed loop under a specification, and recommend one controller or none.

    Each is tuned for the smallest RMS error on the worst of some plants, which are the case's own and extremes of its ranges.
    Only tunings that tolerate the specified delay and gain factors and respect ``u_max`` and ``error`` are admitted. Then
    everything in the specification is measured on these plants and on validation plants, which are further extremes and random
    ones. A controller meets the specification if it does so on all of them.

    specification  by default the case's ``[specification]``
    sample_time    sample time of all controllers [s]; by default the sample time of the case's first sampled controller, or else
                   a tenth of the fastest time constant of model and known set
    noise          noise as a fraction of the model's largest motion, which is added and reported if the case has no noise
    schemes        registered schemes, by their names in case files; by default all
    baseline       whether the fixed loop without adaptation takes part in any case; this is [baseline] or, without one, the
                   nominal state feedback
    own            user-defined controllers that are tuned too, by their declared settings
    as_set         controllers that take part without tuning
    ours           whether the registered schemes take part
    validated      whether extreme plants take part in the tuning, the specification must hold on validation plants too, and
                   validation runs are repeated with a finer step
    Further arguments are as in ``contest``. Raises InputError.
    """
    whole = case if isinstance(case, Case) else load_case(case)
    asked = specification or whole.specification
    if asked is None:
        raise InputError(
            "the case has no [specification]: add this table with requirements, such as settling = 1.0 and u_max = 10.0"
        )
    validate.instance("specification", asked, Specification)
    problem = posed(whole.problem, DESIGN)
    steps = fixed_steps(problem, whole.controllers, whole.simulation)
    check = None if steps.tolerance is None else resolved(problem, whole.controllers, steps.tolerance)
    simulation, whole = steps.simulation, replace(whole, simulation=steps.simulation)
    held = _sample_time(whole, problem) if sample_time is None else sample_time
    rule = Rule(
        delay_margin=asked.delay or 2 * simulation.dt, gain_margin=asked.gain or LEAST_GAIN, plants=plants, trials=trials,
        seed=seed,
    )  # fmt: skip
    rule.require_steps(simulation, "specification.delay" if asked.delay else "simulation.dt: the delay that is always required")
    noisy = with_noise(problem, noise, simulation, held, seed)
    test = StepTest.of(noisy, simulation, whole.judge, asked)
    limits = {"max_abs_u": asked.u_max, f"max_abs_e[{test.component}]": asked.error}
    rule = replace(rule, also=tuple(f"{metric} <= {limit!r}" for metric, limit in limits.items() if limit is not None))
    entrants, left_out = entrants_of(noisy, simulation, schemes=schemes, own=own, sample_time=held, ours=ours)
    entrants += [Entrant.as_set(one) for one in as_set]
    if baseline and not any(one.name == BaselineAlone().name for one in entrants):
        alone, _ = entrants_of(noisy, simulation, schemes=["baseline"], sample_time=held)
        entrants += alone
    if not entrants:
        raise NobodyTakesPart(left_out)
    assert noisy.uncertainty is not None
    tuning, unseen = _plants(noisy, noisy.uncertainty, plants, seed, validated)
    require_delays(unseen, simulation)
    for round_ in range(ROUNDS):
        begun = FIRST_ROUND_SHARE if round_ else 0.0
        part = part_of(progress, begun, 1 - FIRST_ROUND_SHARE if round_ else FIRST_ROUND_SHARE)
        found = compete(
            noisy, simulation, entrants, replace(rule, plants=len(tuning)), judge=whole.judge, members=members,
            left_out=[*filter(None, [steps.chosen_sentence]), *left_out],
            finer=validated, check=check, family=tuning, threads=threads, progress=part_of(part, 0, SEARCH_SHARE),
        )  # fmt: skip
        tolerated = {}
        if validated:  # the command of the case, whose control demand the specification limits
            streams, same = len(tuning) + np.arange(len(unseen)), np.ones((len(unseen), 2))
            drawn = Draws(problems=unseen, streams=streams, commands=same)
            tolerated = measure(found.entrants, drawn, found.rule, simulation, judge=whole.judge, threads=threads)
        candidates, missed = [], []
        for i, one in enumerate(found.entrants):
            made, on = _candidate(one, tuning, unseen, tolerated.get(one.name), test, whole, asked)
            candidates.append(made)
            missed.append(on)
            if part is not None:
                part(SEARCH_SHARE + (1 - SEARCH_SHARE) * (i + 1) / len(found.entrants))
        fails = _failed_by_better(candidates, missed)
        if not fails.any() or round_ + 1 == ROUNDS:
            break
        joining = [int(i) for i in np.argsort(-fails, kind="stable")[:plants] if fails[i]]
        tuning = [*tuning, *(unseen[i] for i in joining)]
        left = [one for i, one in enumerate(unseen) if i not in joining]
        unseen = [*left, *plants_of(noisy, noisy.uncertainty, len(joining) + 1, seed + VALIDATION_SEED + 1)[1:]]
    order = sorted(range(len(candidates)), key=lambda i: _rank(candidates[i], i))
    return Design(
        case=replace(whole, problem=problem), specification=asked, test=test, sample_time=held,
        model_settling=model_settling(noisy, test), candidates=tuple(candidates[i] for i in order), contest=found,
        added_noise=added_noise(problem, noisy, noise), tried=(len(tuning), len(unseen)),
    )  # fmt: skip


def _failed_by_better(candidates: Sequence[Candidate], missed: Sequence[Array]) -> Array:
    """Return how many candidates fail on each validation plant, among those with a smaller error in the tuning than all
    candidates that meet everything."""
    least = min((one.tuned.error for one in candidates if one.meets), default=np.inf)
    better = np.array([one.tuned.error < least for one in candidates])
    return np.asarray(np.array(missed)[better].sum(axis=0))


def _plants(problem: Problem, known_set: KnownSet, count: int, seed: int, validated: bool) -> tuple[list[Problem], list[Problem]]:
    """Return the plants for tuning and for validation. The plant of the case and its extremes come first."""
    if not validated:
        return plants_of(problem, known_set, count, seed), []
    extremes = extreme_plants(problem, known_set, count - 1 + EXTREME_MEMBERS, seed)
    tuning = [problem, *extremes[: count - 1]]
    tuning += plants_of(problem, known_set, count - len(tuning) + 1, seed)[1:]
    return tuning, [*extremes[count - 1 :], *plants_of(problem, known_set, STEP_MEMBERS + 1, seed + VALIDATION_SEED)[1:]]


def _unsampled(controller: Controller) -> Controller:
    return controller.controller if isinstance(controller, Sampled) else controller


def _sample_time(case: Case, problem: Problem) -> float:
    for one in case.controllers:
        if isinstance(one, Sampled):
            return float(one.sample_time)
    fastest = default_delay_margin(problem, case.simulation)
    return max(round(fastest / case.simulation.dt), 1) * case.simulation.dt


def _rank(one: Candidate, place: int) -> tuple[bool, int, float, int]:
    """Return the key for sorting. Candidates that meet everything come first, in the contest's order: by failed validation runs,
    then by error. The others are sorted by the number of requirements that they violate beyond any factor, and then by their
    distance from the remaining requirements."""
    beyond = sum(math.isinf(value) for value in one.misses.values())
    return not one.meets, 0 if one.meets else beyond, 0.0 if one.meets else one.distance, place


def _candidate(
    one: Qualified,
    tuning: Sequence[Problem],
    unseen: Sequence[Problem],
    tolerated: Validation | None,
    test: StepTest,
    case: Case,
    asked: Specification,
) -> tuple[Candidate, Array]:
    """Return the candidate and, if it meets the specification on the tuning plants, the validation plants on which it violates
    something."""
    reads = one.entrant.reads
    figures, steps = measured([reads(problem) for problem in (*tuning, *unseen)], one.controller, test, case.judge)
    worst, factor, shares, which = {}, {}, {}, {}
    missed, met = np.zeros(len(unseen), dtype=bool), one.meets
    for name in FIGURES:
        limit = getattr(asked, name)
        if limit is None:
            continue
        worst[name] = float(figures[name].max())
        factor[name] = _used(worst[name], limit)
        met = met and _used(float(figures[name][: len(tuning)].max()), limit) <= 1
        if name in steps and len(test.stages) > 1:
            which[name] = steps[name][int(figures[name].argmax())]
        if unseen:
            fails = np.array([_used(float(value), limit) > 1 for value in figures[name][len(tuning) :]])
            shares[name], missed = Share.of(fails), missed | fails
    if asked.delay is not None:
        worst["delay"] = one.delay_margin_measured
        factor["delay"] = np.inf if worst["delay"] <= 0 else asked.delay / worst["delay"]
    if asked.gain is not None:
        worst["gain"] = one.gain_margin_measured
        factor["gain"] = np.inf if worst["gain"] <= 1 else (asked.gain - 1) / (worst["gain"] - 1)
    if tolerated is not None:
        asked_of = {"delay": tolerated.delay, "gain": tolerated.gain_up | tolerated.gain_down}
        for name in [one for one in asked_of if one in factor]:
            shares[name], missed = Share.of(asked_of[name]), missed | asked_of[name]
            if shares[name].count:  # there is no search for the tolerated size
                factor[name] = max(factor[name], 1 + shares[name].share)
        shares[LOST], missed = Share.of(tolerated.unsound), missed | tolerated.unsound
        worst[LOST], factor[LOST] = shares[LOST].share, np.inf if shares[LOST].count else 0.0
    return Candidate(tuned=one, worst=worst, factor=factor, held_out=shares, step=which), missed & met


def _used(value: float, limit: float) -> float:
    """Return the used fraction of the admissible value. If that is zero, the fraction is infinite as soon as anything is used."""
    return value / limit if limit > 0 else 0.0 if value == 0 else np.inf
