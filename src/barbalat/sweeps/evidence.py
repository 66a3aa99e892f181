"""What many runs are evidence of: shares with intervals, extremes with the members that have them. Failures come first."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import TypeVar

import numpy as np

from barbalat.sweeps.bounds import ERROR_BOUND
from barbalat.sweeps.plan import Design, Plan
from barbalat.sweeps.requirement import Requirement
from barbalat.sweeps.rows import Rows
from barbalat.sweeps.sensitivity import Sensitivity, sensitivities
from barbalat.sweeps.study import OSCILLATED
from barbalat.validate import Array, Named

CONFIDENCE_LEVEL = 0.95
"""Of the intervals."""
DIVERGED, OUT_OF_BOUND = "diverged", "above the guaranteed bound"
FINDINGS = frozenset({DIVERGED, OSCILLATED, OUT_OF_BOUND})
"""Names of shares; any other share is that of the members which broke the requirement that it is named after."""
NO_FIGURES = (OSCILLATED, ERROR_BOUND)
"""Columns of a controller that are no figures of a run."""


@dataclass(frozen=True, kw_only=True)
class Share:
    """How many of the members that could be judged; the interval is Clopper and Pearson's.

    judged  members; what is not known of a member is not counted as met
    """

    count: int
    judged: int
    confidence: float = CONFIDENCE_LEVEL

    @property
    def share(self) -> float:
        return self.count / self.judged

    @property
    def interval(self) -> tuple[float, float]:
        from scipy.stats import binomtest

        found = binomtest(self.count, self.judged).proportion_ci(self.confidence, method="exact")
        return float(found.low), float(found.high)

    @property
    def chance(self) -> float:
        """How likely a share so far from one half, or farther, is where both ways are equally likely: the exact sign test."""
        from scipy.stats import binomtest

        return float(binomtest(self.count, self.judged).pvalue)

    def as_json(self) -> dict[str, object]:
        return {
            "count": self.count,
            "share": self.share,
            "interval": list(self.interval),
            "confidence": self.confidence,
            "judged": self.judged,
        }


Compared = TypeVar("Compared", bound=Hashable)


def beyond_chance(shares: Mapping[Compared, Share]) -> dict[Compared, int]:
    """1 where a share is above one half beyond chance, -1 where it is below, 0 where neither is known.

    Holm's correction (Scandinavian Journal of Statistics 6, 1979) holds for however many comparisons, dependent or not: where all
    shares are one half, any is called otherwise with a probability of 1 - CONFIDENCE at most.
    """
    found = dict.fromkeys(shares, 0)
    for left, name in zip(range(len(shares), 0, -1), sorted(shares, key=lambda one: shares[one].chance), strict=True):
        if shares[name].chance > (1 - CONFIDENCE_LEVEL) / left:
            break
        found[name] = 1 if shares[name].share > 1 / 2 else -1
    return found


@dataclass(frozen=True, kw_only=True)
class Extremes:
    """Of a figure over the members that have it.

    worst_member  the one with the largest value; of ``diverged_at`` the one with the smallest
    finite        members that have the figure: those that did not diverge
    """

    min: float
    median: float
    max: float
    worst_member: int
    finite: int

    @classmethod
    def of(cls, values: Array, *, smallest: bool = False) -> Extremes | None:
        """None where no member has a finite value."""
        finite = np.isfinite(values)
        if not finite.any():
            return None
        worst = np.nanargmin(values) if smallest else np.nanargmax(values)
        kept = values[finite]
        return cls(
            min=float(kept.min()),
            max=float(kept.max()),
            median=float(np.median(kept, overwrite_input=True)),  # without another copy of 10^7 members
            worst_member=int(worst),
            finite=len(kept),
        )

    def as_json(self) -> dict[str, object]:
        return dict(vars(self))


@dataclass(frozen=True, eq=False, kw_only=True)
class Evidence:
    """By what is judged, or by a figure, and then by controllers.

    filled  median and largest max |e| as a part of the guaranteed bound: how much of what is promised a run can use up
    """

    shares: dict[str, dict[str, Share]]
    metrics: dict[str, dict[str, Extremes]]
    filled: dict[str, Extremes]
    sensitivities: list[Sensitivity]
    notes: list[str]
    intervals: str


def evidence(
    rows: Rows, controllers: Sequence[str], requirements: Sequence[Requirement], plan: Plan, notes: Sequence[str] = ()
) -> Evidence:
    """Read off the columns, one after another; ``notes`` are what is known beforehand to be missing."""
    shares: dict[str, dict[str, Share]] = {DIVERGED: {}, OSCILLATED: {}}
    metrics: dict[str, dict[str, Extremes]] = {}
    filled: dict[str, Extremes] = {}
    names = list(rows.names)
    for controller in controllers:
        diverged = np.isfinite(rows.column(f"{controller}/diverged_at"))
        everyone = np.ones(len(diverged), dtype=bool)
        _count(shares, DIVERGED, controller, diverged, everyone)
        _swinging(shares, rows, controller)
        for requirement in requirements:
            columns = requirement.columns(names, controller)
            if columns:
                broken = np.logical_or.reduce([requirement.broken(rows.column(name)) for name in columns])
                _count(shares, str(requirement), controller, broken, everyone)
        _bounded(shares, filled, rows, controller)
        for name in names:
            figure = name.removeprefix(f"{controller}/")
            if name == figure or figure in NO_FIGURES:
                continue
            found = Extremes.of(rows.column(name), smallest=figure == "diverged_at")
            if found is not None:
                metrics.setdefault(figure, {})[controller] = found
    found_sensitivities, lacking = sensitivities(rows, controllers, plan)
    return Evidence(
        sensitivities=found_sensitivities,
        notes=[*notes, *lacking],
        shares=_named("share", {name: found for name, found in shares.items() if found or name == DIVERGED}),
        metrics=_named("metric", metrics),
        filled=Named.of("controller", filled),
        intervals=_meaning(plan),
    )


T = TypeVar("T")


def _named(kind: str, found: Mapping[str, Mapping[str, T]]) -> dict[str, dict[str, T]]:
    """By what is judged, or by a figure, and then by controllers; a name that there is not is told with the one that is meant."""
    return Named.of(kind, {name: Named.of("controller", by) for name, by in found.items()})


def _count(shares: dict[str, dict[str, Share]], name: str, controller: str, counted: Array, judged: Array) -> None:
    if judged.any():
        shares.setdefault(name, {})[controller] = Share(count=int((counted & judged).sum()), judged=int(judged.sum()))


def _swinging(shares: dict[str, dict[str, Share]], rows: Rows, controller: str) -> None:
    swings = rows.column(f"{controller}/{OSCILLATED}")
    _count(shares, OSCILLATED, controller, swings == 1, np.isfinite(swings))


def _bounded(shares: dict[str, dict[str, Share]], filled: dict[str, Extremes], rows: Rows, controller: str) -> None:
    """Against what is guaranteed of each member, where something is."""
    if f"{controller}/{ERROR_BOUND}" not in rows.names:
        return
    bound = rows.column(f"{controller}/{ERROR_BOUND}")
    judged = np.isfinite(bound)
    if not judged.any():
        return
    errors = (rows.column(name) for name in rows.names if name.startswith(f"{controller}/max_abs_e["))
    largest = reduce(np.maximum, errors)
    with np.errstate(invalid="ignore"):
        _count(shares, OUT_OF_BOUND, controller, ~(largest <= bound), judged)
        found = Extremes.of(np.where(judged, largest / bound, np.nan))
    if found is not None:
        filled[controller] = found


def _meaning(plan: Plan) -> str:
    """What the intervals say, by how the members came about."""
    kind = {
        Design.RANDOM: "exact: the members are independent draws",
        Design.LATIN: "those of as many independent draws; a Latin hypercube's share varies by n/(n - 1) of theirs at most",
        Design.SOBOL: "those of as many independent draws, for orientation: points of a Sobol sequence are not independent",
        Design.SALTELLI: "those of as many independent draws, for orientation: rows of Saltelli's design share their numbers",
    }[plan.design]
    if not plan.draws:
        return "those of as many independent draws, for orientation: a grid is no sample"
    if plan.axes:
        return "those of as many independent draws, for orientation: at each point of the grid the draws are the same"
    return kind
