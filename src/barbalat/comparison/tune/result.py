"""The result of a tuning: the chosen point with its certificate, the front, the validation plants, and the choice."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barbalat.budget import Progress
from barbalat.cases.build import Case
from barbalat.certificates.certificate import Certificate
from barbalat.certificates.certify import certify
from barbalat.comparison.plants import drawn_values
from barbalat.comparison.ranges import Space
from barbalat.comparison.search.aim import Aim, Plants, StepCheck, Trial
from barbalat.comparison.search.quantity import Constraint, Origin
from barbalat.comparison.search.trials import Trials
from barbalat.comparison.tradeoff.tradeoff import pareto_front
from barbalat.judge.verdict import Verdict
from barbalat.open_numbers.path import FieldPath
from barbalat.pictures.plotted import Plotted
from barbalat.study.verdicts import verdict_of
from barbalat.validate import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True)
class Point:
    """A tuning, its value of the objective, and the value of the quantity of each constraint; None without a value."""

    tuning: Mapping[FieldPath, float]
    value: float | None
    found: Mapping[Constraint, float | None]
    meets: bool

    def as_json(self) -> dict[str, Any]:
        return {
            "tuning": {str(path): value for path, value in self.tuning.items()},
            "value": _finite(self.value),
            "constraints": {str(one.requirement): _finite(value) for one, value in self.found.items()},
            "meets": self.meets,
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class UnseenPlants:
    """The chosen tuning on validation plants, which the search did not use.

    quantity  the quantity of the values: the objective, or the quantity of the first constraint that follows from runs
    thetas    (P, p) the plants' theta; None if the truth has different states
    drawn     for each plant, the values of the parameters with ranges; None if theta was drawn from the known set
    values    (P,) the quantity, infinite if the run diverged
    broken    (P,) whether each constraint that follows from runs is violated
    """

    quantity: str
    thetas: Array | None
    drawn: tuple[dict[str, float], ...] | None
    values: Array
    broken: Mapping[Constraint, Array]
    worst: int

    @property
    def worst_plant(self) -> dict[str, Any]:
        """The theta of the worst plant, and its parameters if plants are drawn from their ranges; None for what does not
        exist."""
        theta = {} if self.thetas is None else {"theta": self.thetas[self.worst].tolist()}
        return theta if self.drawn is None else {**theta, "parameters": self.drawn[self.worst]}

    def as_json(self) -> dict[str, Any]:
        return {
            "plants": len(self.values),
            "quantity": self.quantity,
            "diverged_or_lost": int((~np.isfinite(self.values)).sum()),
            "median": _finite(float(np.median(self.values))),
            "worst": {**self.worst_plant, "value": _finite(float(self.values[self.worst]))},
            "broken": {str(one.requirement): int(values.sum()) for one, values in self.broken.items()},
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class Tuned:
    """The tuning of one controller.

    chosen   the best tuning that meets every constraint; None if no tuning does (``nearest`` is then the closest tuning)
    start    the tuning in the case
    front    the trials that no other trial beats both in the objective and in the quantity of the first constraint
    trials, runs  numbers of tried tunings and of simulations
    step     the result of a finer step for the chosen tuning. If the finer step alone prevents any choice, it is the result
             for the nearest tuning
    refused  results of a finer step for better tunings, which meet every constraint only at the step of the case
    verdict  the judge's verdict on the run of the chosen tuning, or of the nearest tuning, on the plant of the case
    delay_margin_measured  the delay margin [s] of this tuning on the worst plant, if a linear delay margin is requested;
                           otherwise None
    """

    controller: str
    space: Space
    start: Point
    chosen: Point | None
    nearest: Point
    front: tuple[Point, ...]
    held_out: UnseenPlants | None
    certificate: Certificate | None
    trials: int
    runs: int
    step: StepCheck | None
    refused: tuple[StepCheck, ...]
    verdict: Verdict
    delay_margin_measured: float | None = None

    def as_json(self) -> dict[str, Any]:
        return {
            "varied": {str(path): str(one) for path, one in self.space.ranges.items()},
            "meets": self.chosen is not None,
            "start": self.start.as_json(),
            "chosen": None if self.chosen is None else self.chosen.as_json(),
            "nearest": None if self.chosen else self.nearest.as_json(),
            "front": [point.as_json() for point in self.front],
            "held_out": None if self.held_out is None else self.held_out.as_json(),
            "certificate": None if self.certificate is None else self.certificate.as_json(),
            "trials": self.trials,
            "runs": self.runs,
            "finer_step": None if self.step is None else self.step.as_json(),
            "refused_at_finer_step": [one.as_json() for one in self.refused],
            "verdict": self.verdict.as_json(),
            "delay_margin_measured": self.delay_margin_measured,
        }


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Tuning(Plotted):
    """All tuned controllers. ``case`` has the chosen values, and ``text`` is the text of its file, if there was a file.

    plants  P, the number of plants of the search
    thetas  (P, p) theta of these plants; empty if they have none, as for a truth with different states
    drawn   for each plant, the values of the parameters with ranges; None if theta was drawn from the known set
    """

    aim: Aim
    case: Case
    text: str | None
    plants: int
    thetas: Array
    drawn: tuple[dict[str, float], ...] | None
    controllers: Mapping[str, Tuned]
    notes: tuple[str, ...]
    seconds: float

    def __repr__(self) -> str:
        values = {name: None if one.chosen is None else one.chosen.value for name, one in self.controllers.items()}
        found = (f"{name} {'none found' if value is None else f'{value:.4g}'}" for name, value in values.items())
        return f"<Tuning of {self.case.name!r} for {self.aim.quantity.name}: {'; '.join(found)}>"

    def as_json(self) -> dict[str, Any]:
        """Return the document of ``tune --json``."""
        return {
            "case": self.case.name,
            "for": self.aim.quantity.name,
            "maximize": self.aim.maximize,
            "subject_to": [str(one.requirement) for one in self.aim.constraints],
            "plants": self.plants,
            "thetas": self.thetas.tolist(),
            **({} if self.drawn is None else {"parameters": list(self.drawn)}),
            "quantile": self.aim.quantile,
            "seed": self.aim.seed,
            "controllers": {name: one.as_json() for name, one in self.controllers.items()},
            "notes": list(self.notes),
            "case_file": self.text,
            "seconds": self.seconds,
        }

    def plot(self, *, shown: bool = True) -> Figure:
        """Draw the front of each controller as a Matplotlib figure. Raises InputError without a constraint.

        shown  whether to display the figure at once, if pyplot is in use
        """
        from barbalat.comparison.tune.picture import draw

        return draw(self, shown=shown)


def _finite(value: float | None) -> float | None:
    return value if value is not None and np.isfinite(value) else None


FRONT_TUNINGS = 16
"""Number of tunings, from the best to the worst by the aim, for which the quantity of the first constraint is fully computed for
the front."""
CANDIDATES_CHECKED = 8
"""Largest number of the best tunings that are fully evaluated until one meets every constraint. A finer scan of delays can reveal
a loss below the required delay that the coarse scan of the search missed."""


def choose(trials: Trials, space: Space, own: Trial, progress: Progress | None) -> Tuned:
    """Return the result for one controller. ``own`` is the unchanged case."""
    tell = progress or (lambda _: None)
    best = best_of(trials)
    chosen, nearest, wholes = best.chosen, best.nearest, best.wholes
    tell(0.3)
    front = _front(trials, [*wholes, *([own] if len(own.row) else [])])
    tell(0.8)
    made = None if chosen is None else chosen.case
    assert own.case is not None
    which = trials.controller
    controller = own.case.controllers[which]
    found = Tuned(
        controller=controller.name,
        space=space,
        start=_point(trials, space, own),
        chosen=None if chosen is None else _point(trials, space, chosen),
        nearest=_point(trials, space, nearest),
        front=tuple(_point(trials, space, one) for one in front),
        held_out=None if made is None else _held_out(trials, made),
        certificate=None if made is None else certify(made.problem, made.controllers[which], made.simulation)[controller.name],
        trials=len(trials.all),
        runs=trials.runs,
        step=best.check,
        refused=tuple(best.refused),
        verdict=_verdict(nearest, which),
        delay_margin_measured=trials.measured_delay(nearest) if trials.aim.asks_linear_delays else None,
    )
    tell(1.0)
    return found


def _verdict(trial: Trial, controller: int) -> Verdict:
    """Return the judge's verdict on the plant of the case."""
    assert trial.case is not None
    case = trial.case
    return verdict_of(case.problem, case.controllers[controller], case.simulation, case.judge)


class Best(NamedTuple):
    """The best tuning that meets every constraint, also at a finer step, if there is one, the nearest one, and all fully
    evaluated ones.

    check    the result of a finer step for the nearest tuning, which is the chosen tuning if there is one
    refused  the results for better tunings that meet every constraint only at the step of the case
    """

    chosen: Trial | None
    nearest: Trial
    wholes: list[Trial]
    check: StepCheck | None
    refused: list[StepCheck]


def best_of(trials: Trials) -> Best:
    """Return the best of the tried tunings."""
    ordered = sorted((trial for trial in trials.all if trial.case is not None), key=lambda trial: trial.score)
    wholes: list[Trial] = []
    refused: list[tuple[Trial, StepCheck]] = []
    meeting = [one for one in ordered if one.meets(trials.aim)]
    for place in [2**k - 1 for k in range(CANDIDATES_CHECKED) if 2**k <= len(meeting)]:  # neighbours fail for the same reason
        trial = meeting[place]
        whole = trials.whole(trial.row)
        if not whole.meets(trials.aim):
            wholes.append(whole)
            continue
        check = trials.at_finer_step(whole)
        if check.holds:
            return Best(whole, whole, [*wholes, whole], check, [one for _, one in refused])
        refused.append((whole, check))
    if refused:
        nearest, check = refused[0]
        return Best(None, nearest, wholes, check, [one for _, one in refused])
    nearest = trials.whole(ordered[0].row if ordered else trials.all[0].row)
    return Best(None, nearest, wholes, None, [])


def _front(trials: Trials, wholes: Sequence[Trial]) -> list[Trial]:
    """Return the tunings that no other tuning beats. Some of the tried tunings are evaluated further for this purpose."""
    aim = trials.aim
    if not aim.constraints:
        return []
    known = [trial for trial in trials.all if trial.value is not None and np.isfinite(trial.value)]
    known.sort(key=lambda trial: aim.signed(trial.value or 0.0))
    places = np.unique(np.linspace(0, len(known) - 1, min(FRONT_TUNINGS, len(known))).round().astype(int))
    first = aim.constraints[0]
    spread = [replace(known[i], found=dict(known[i].found)) for i in places]
    if spread and first.quantity.origin is not Origin.RUN:
        trials.measure(spread, first)
    candidates = [
        trial
        for trial in (*wholes, *spread)
        if trial.value is not None and np.isfinite(trial.value) and trial.found.get(first) is not None
    ]
    if not candidates:
        return []
    values = np.array([aim.signed(trial.value or 0.0) for trial in candidates])
    reached = np.array([trial.found[first] or 0.0 for trial in candidates])
    better = np.unique(-reached if first.quantity.larger_is_worse else reached, return_inverse=True)[1] + 1.0
    return [candidates[i] for i in pareto_front(values, better)]


def _point(trials: Trials, space: Space, trial: Trial) -> Point:
    known = dict(zip(space.paths, map(float, trial.row), strict=True)) if len(trial.row) else {}
    return Point(tuning=known, value=trial.value, found=trial.found, meets=trial.meets(trials.aim))


def _held_out(trials: Trials, made: Case) -> UnseenPlants | None:
    """Evaluate the chosen tuning on plants drawn with a different seed; None if no run gives a quantity, or without a set to draw
    from."""
    problem, aim = made.problem, trials.aim
    told = [one for one in aim.quantities if one.origin is not Origin.CERTIFICATE]
    others = aim.unseen(problem)
    if not told or not others:
        return None
    plants = Plants.of(made, aim, others)
    values = trials.on_other_plants(made, plants, told[0], None)
    broken = {
        one: one.requirement.broken(trials.on_other_plants(made, plants, one.quantity, one.requirement.limit))
        for one in aim.constraints
        if one.quantity in told
    }
    thetas = [theta for other in others if (theta := other.true_parameters) is not None]
    signs = values if told[0].larger_is_worse else -values
    return UnseenPlants(
        quantity=told[0].name,
        thetas=np.array(thetas) if len(thetas) == len(others) else None,
        drawn=drawn_values(others),
        values=values,
        broken=broken,
        worst=int(np.argmax(signs)),
    )
