"""The evaluation of many runs: fractions with intervals, and extremes with the members that attain them. Failures come first."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import NamedTuple, TypeVar

import numpy as np

from barbalat.judge.judged import CLASSES
from barbalat.judge.verdict import Class
from barbalat.sweeps.bounds import ERROR_BOUND
from barbalat.sweeps.chunks import Rows
from barbalat.sweeps.plan import Design, Plan
from barbalat.sweeps.requirement import Requirement
from barbalat.sweeps.sensitivity import Sensitivity, sensitivities
from barbalat.sweeps.statistics import Share, SplitShare
from barbalat.sweeps.study import FINER_BY, OSCILLATED, RINGS, SETTLED, VERDICT
from barbalat.validate import Array, Named

DIVERGED, OUT_OF_BOUND = "diverged", "above the guaranteed bound"
RING, NOT_SETTLED = "estimates ring", "not settled"
"""Fractions found with finer steps: the parts of ``oscillated``, and the members whose verdict no affordable step settles."""
VERDICTS = (*(str(kind) for kind in Class if kind is not Class.FOLLOWS), RING, NOT_SETTLED)
"""The judge's classes whose fractions are reported."""
FINDINGS = frozenset({DIVERGED, OSCILLATED, OUT_OF_BOUND, *VERDICTS})
"""Names of fractions; every other fraction is named after a requirement and counts the members that violate it."""
EXAMINED = "only the estimates: a limit cycle of the control or of the state with constant estimates is not counted"
"""The signals of ``oscillated``."""
DIVERGES = "beyond 1e12 within the horizon: a run that is still growing, or lost at a smaller size, is not counted"
"""The meaning of ``diverged``; see ``run.kernel.metrics.DIVERGENCE_LIMIT``."""
NO_FIGURES = (OSCILLATED, ERROR_BOUND, VERDICT, SETTLED, RINGS, FINER_BY)
"""Columns of a controller that are not metrics of a run."""


@dataclass(frozen=True, kw_only=True)
class Extremes:
    """The extremes and the median of a metric over the members that have it.

    worst_member  the member with the largest value; for ``diverged_at``, the member with the smallest value
    finite        number of members that have the metric: those that did not diverge
    """

    min: float
    median: float
    max: float
    worst_member: int
    finite: int

    @classmethod
    def of(cls, values: Array, *, smallest: bool = False) -> Extremes | None:
        """The extremes of a column; None if no member has a finite value."""
        finite = np.isfinite(values)
        if not finite.any():
            return None
        worst = np.nanargmin(values) if smallest else np.nanargmax(values)
        kept = values[finite]
        return cls(
            min=float(kept.min()),
            max=float(kept.max()),
            median=float(np.median(kept, overwrite_input=True)),  # avoids one more copy of 10^7 numbers
            worst_member=int(worst),
            finite=len(kept),
        )

    def as_json(self) -> dict[str, object]:
        return dict(vars(self))


@dataclass(frozen=True, eq=False, kw_only=True)
class Evidence:
    """Fractions, extremes and sensitivities, keyed by verdict or metric and then by controller.

    unexamined  by controller, why ``oscillated`` is unknown for every member
    filled  median and largest max |e| relative to the guaranteed bound: how much of the guarantee the runs use
    """

    shares: dict[str, dict[str, Share]]
    metrics: dict[str, dict[str, Extremes]]
    filled: dict[str, Extremes]
    sensitivities: list[Sensitivity]
    notes: list[str]
    intervals: str
    unexamined: dict[str, str]


def evidence(
    rows: Rows,
    controllers: Sequence[str],
    requirements: Sequence[Requirement],
    plan: Plan,
    notes: Sequence[str] = (),
    unexamined: Mapping[str, str] | None = None,
) -> Evidence:
    """Compute the evidence, one column after another; ``notes`` are known limitations."""
    shares: dict[str, dict[str, Share]] = {DIVERGED: {}, OSCILLATED: {}}
    metrics: dict[str, dict[str, Extremes]] = {}
    filled: dict[str, Extremes] = {}
    lacking_bounds: list[str] = []
    names, unexamined = list(rows.names), dict(unexamined or {})
    for controller in controllers:
        for verdict in judged_by(rows, controller, requirements):
            if verdict.judged.any():
                shares.setdefault(verdict.name, {})[controller] = verdict.share
        _fill(filled, rows, controller)
        lacking_bounds += _without_bound(rows, controller)
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
        notes=[*notes, *lacking_bounds, *lacking],
        shares=_named("share", {name: found for name, found in shares.items() if found or name == DIVERGED}),
        metrics=_named("metric", metrics),
        filled=Named.of("controller", filled),
        intervals=_meaning(plan),
        unexamined=unexamined,
    )


T = TypeVar("T")


def _named(kind: str, found: Mapping[str, Mapping[str, T]]) -> dict[str, dict[str, T]]:
    """A dictionary by names and then by controllers; the error for an unknown name suggests the closest name."""
    return Named.of(kind, {name: Named.of("controller", by) for name, by in found.items()})


class Verdict(NamedTuple):
    """A verdict on M members.

    counted  (M,) whether the verdict is true for each member
    judged   (M,) whether it is known
    settled  (M,) whether it is not due to the solver
    split    whether the fraction distinguishes settled members; ``diverged`` and ``oscillated`` do not, because they describe the
             runs
    """

    name: str
    counted: Array
    judged: Array
    settled: Array
    split: bool = True

    @property
    def share(self) -> Share:
        """The fraction of members for which the verdict is true; it is split if settled members are distinguished."""
        if not self.split:
            return Share.of(self.counted, self.judged)
        count, unsettled = int((self.counted & self.judged & self.settled).sum()), int((self.judged & ~self.settled).sum())
        return SplitShare(count=count, judged=int(self.judged.sum()), unsettled=unsettled)


def judged_by(rows: Rows, controller: str, requirements: Sequence[Requirement]) -> Iterator[Verdict]:
    """All verdicts on the members with one controller. A member that diverged violates every requirement."""
    names, diverged = list(rows.names), np.isfinite(rows.column(f"{controller}/diverged_at"))
    everyone, split = np.ones(len(diverged), dtype=bool), f"{controller}/{SETTLED}" in names
    known = rows.column(f"{controller}/{SETTLED}") == 1 if split else everyone
    swings = rows.column(f"{controller}/{OSCILLATED}")
    yield Verdict(DIVERGED, diverged, everyone, everyone, split=False)
    yield Verdict(OSCILLATED, swings == 1, np.isfinite(swings), everyone, split=False)
    if split:
        verdict, rings = rows.column(f"{controller}/{VERDICT}"), rows.column(f"{controller}/{RINGS}")
        for number, kind in enumerate(CLASSES):
            if kind is not Class.FOLLOWS:
                yield Verdict(str(kind), verdict == number, np.isfinite(verdict), known)
        yield Verdict(RING, rings == 1, np.isfinite(rings), known)
        yield Verdict(NOT_SETTLED, ~known, everyone, everyone)
    for requirement in requirements:
        columns = requirement.columns(names, controller)
        if columns:
            broken = np.logical_or.reduce([requirement.broken(rows.column(name)) for name in columns])
            yield Verdict(str(requirement), broken, everyone, known, split)
    if f"{controller}/{ERROR_BOUND}" in names:
        bound = rows.column(f"{controller}/{ERROR_BOUND}")
        judged = np.isfinite(bound)
        with np.errstate(invalid="ignore"):
            yield Verdict(OUT_OF_BOUND, ~(largest_error(rows, controller) <= bound) & judged, judged, known, split)


def largest_error(rows: Rows, controller: str) -> Array:
    """(M,) the largest error over all components; NaN if the member diverged."""
    return reduce(np.maximum, (rows.column(name) for name in rows.names if name.startswith(f"{controller}/max_abs_e[")))


def _fill(filled: dict[str, Extremes], rows: Rows, controller: str) -> None:
    """Compare with the guaranteed bound of each member, if there is one."""
    if f"{controller}/{ERROR_BOUND}" not in rows.names:
        return
    bound = rows.column(f"{controller}/{ERROR_BOUND}")
    with np.errstate(invalid="ignore", divide="ignore"):
        found = Extremes.of(np.where(np.isfinite(bound), largest_error(rows, controller) / bound, np.nan))
    if found is not None:
        filled[controller] = found


def _without_bound(rows: Rows, controller: str) -> list[str]:
    """The reason why only some members are compared with a bound, as a sentence; empty if all or none are compared."""
    if f"{controller}/{ERROR_BOUND}" not in rows.names:
        return []
    bounded = np.isfinite(rows.column(f"{controller}/{ERROR_BOUND}"))
    if bounded.all() or not bounded.any():
        return []
    return [
        f"{controller}: {int((~bounded).sum())} of {len(bounded)} "
        "members have no guaranteed bound for comparison: their parameters lie outside the known set, or the certificate's "
        "conditions do not hold on their plant"
    ]


def _meaning(plan: Plan) -> str:
    """The meaning of the intervals, which depends on how the members were chosen."""
    kind = {
        Design.RANDOM: "exact: the members are independent draws",
        Design.LATIN: "computed as if the members were independent draws; the variance of a Latin hypercube's fraction is at "
        "most n/(n - 1) times that of as many independent draws",
        Design.SOBOL: "computed as if the members were independent draws, as a guide: points of a Sobol sequence are not "
        "independent",
        Design.SALTELLI: "computed as if the members were independent draws, as a guide: rows of Saltelli's design share "
        "their numbers",
    }[plan.design]
    if not plan.draws:
        return "computed as if the members were independent draws, as a guide: a grid is not a random sample"
    if plan.axes:
        return "computed as if the members were independent draws, as a guide: at each point of the grid the draws are the same"
    return kind
