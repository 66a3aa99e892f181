"""Checks whether verdicts depend on the solver by repeating some members of a finished sweep, each with half the step that gave
its verdict."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.run.engine.by_tolerance import FINER
from barbalat.run.results.step_comparison import EQUAL_FIGURES_SHARE
from barbalat.sweeps.chunks import Columns, Rows
from barbalat.sweeps.evidence import judged_by, largest_error
from barbalat.sweeps.requirement import Requirement
from barbalat.sweeps.settling import Rerun, Settling, Step, Work, settled_by
from barbalat.sweeps.statistics import Share
from barbalat.sweeps.study import OSCILLATED, RINGS, SETTLED, VERDICT
from barbalat.validate import Array, InputError

AUDITED_SHARE, FEWEST_AUDITED = 0.02, 30
"""Fraction of the members, and smallest number of members, that are repeated: if 10 % of all verdicts are due to the solver, 96
of 100 audits find one."""
FINER_BY = 2
AGAIN = "run again"
"""A column of each controller during the audit: whether a drawn member could be run with half the step."""


@dataclass(frozen=True, kw_only=True)
class Changed:
    """The number of audited members for which one verdict on one controller is known, and how many of these verdicts changed."""

    changed: int
    judged: int


@dataclass(frozen=True, kw_only=True)
class Audit:
    """The effect of halving the step on the verdicts of a sweep.

    members    numbers of the members that were repeated with at least one controller; ``of`` is the sweep's number of members
    drawn      number of selected members; members that are unsettled, or for which half the step is rejected, cannot be repeated
    changed    number of ``members`` whose verdict changed for some controller; None if no member could be repeated (see ``why``)
    verdicts   by verdict, and then by controller
    errors     by controller, members whose largest |e| differs by more than a tenth
    tolerance  whether the members run with a tolerance, in which case 1/32 of it is used instead of half the step
    """

    members: tuple[int, ...] = ()
    of: int = 0
    drawn: int = 0
    changed: int | None = None
    verdicts: Mapping[str, Mapping[str, Changed]] = field(default_factory=dict)
    errors: Mapping[str, int] = field(default_factory=dict)
    why: str = ""
    tolerance: bool = False

    @property
    def _finer(self) -> tuple[str, str]:
        """The refined setting in words, and its name."""
        return ("1/32 of the tolerance", "simulation.tolerance") if self.tolerance else ("half the step", "simulation.dt")

    @property
    def share(self) -> Share | None:
        """The fraction of members with a changed verdict; None if no member could be repeated."""
        return None if self.changed is None else Share(count=self.changed, judged=len(self.members))

    @property
    def sentences(self) -> list[str]:
        """The audit in sentences."""
        if self.share is None:
            finer = "1/32 of its tolerance" if self.tolerance else "half its step"
            return [f"no member was repeated at {finer}, so any fraction may be due to the solver: {self.why}"]
        low, high = self.share.interval
        again = f"{validate.counted(len(self.members), 'member')} repeated at {self._finer[0]}"
        within = f"{100 * self.share.share:.3g} %, 95 % interval {100 * low:.3g} to {100 * high:.3g} %"
        if self.changed:
            smaller = f"a smaller {self._finer[1]} is needed"
            said = [f"{self.changed} of {again} changed a verdict ({within}; {self._changes}): {smaller}"]
        else:
            said = [f"no verdict changed in {again} ({within})"]
        if left := self.drawn - len(self.members):
            said.append(f"{validate.counted(left, 'further drawn member')} could not be repeated, because no step settles them")
        if errors := {name: count for name, count in self.errors.items() if count}:
            counts = ", ".join(f"{count} of {name}" for name, count in errors.items())
            said.append(f"the largest |e| changed by more than {EQUAL_FIGURES_SHARE:.0%} in these members: {counts}")
        return said

    @property
    def _changes(self) -> str:
        return ", ".join(
            f"{name} of {controller} {one.changed}"
            for name, by in self.verdicts.items()
            for controller, one in by.items()
            if one.changed
        )

    def as_json(self) -> dict[str, Any]:
        """Return the JSON object, in which ``share`` is the fraction of members with a changed verdict."""
        return {
            "members": list(self.members),
            "drawn": self.drawn,
            "finer_by": round(1 / FINER) if self.tolerance else FINER_BY,
            "changed": self.changed,
            "share": None if self.share is None else self.share.share,
            "interval": None if self.share is None else list(self.share.interval),
            "verdicts": {name: {c: dict(vars(one)) for c, one in by.items()} for name, by in self.verdicts.items()},
            "errors": dict(self.errors),
            "sentences": self.sentences,
        }


def audit(
    settling: Settling,
    rows: Rows,
    requirements: Sequence[Requirement] = (),
    *,
    members: int | None = None,
    run: Callable[[Work], Columns],
) -> Audit:
    """Repeat some members, for each controller with half the step that settled its run; unsettled runs are omitted.

    The plan's seed selects them from all members, so the changed verdicts estimate a fraction of the whole sweep. ``members`` is
    how many are repeated, by default AUDITED_SHARE of all and at least FEWEST_AUDITED; ``run`` does the work.
    """
    study, by_tolerance = settling.study, settling.study.example.simulation.tolerance is not None
    count = max(FEWEST_AUDITED, round(AUDITED_SHARE * len(study))) if members is None else members
    if count == 0:
        return Audit(why="none was requested", of=len(study), tolerance=by_tolerance)
    generator = np.random.default_rng([study.plan.seed, FINER_BY])
    drawn = min(count, len(study))
    chosen = np.sort(generator.choice(len(study), drawn, replace=False))
    before = _Chosen({name: rows.column(name)[chosen] for name in rows.names})
    try:
        after = _Chosen(run(_work(settling, before)))
    except InputError as error:
        return Audit(why=str(error), of=len(study), drawn=drawn, tolerance=by_tolerance)
    if not any(after.column(f"{controller}/{AGAIN}").any() for controller in study.controllers):
        why = f"no step settles any of the {validate.counted(drawn, 'member')} drawn"
        return Audit(why=why, of=len(study), drawn=drawn, tolerance=by_tolerance)
    return _compared(before, after, settling, requirements)


@dataclass(frozen=True, eq=False)
class _Chosen:
    """The columns of some members, with the interface of a finished sweep."""

    columns: Columns

    @property
    def names(self) -> list[str]:
        return list(self.columns)

    def column(self, name: str) -> Array:
        return self.columns[name]

    def row(self, member: int) -> dict[str, float]:
        place = int(np.flatnonzero(self.columns["member"] == member)[0])
        return {name: float(values[place]) for name, values in self.columns.items()}


def _work(settling: Settling, before: _Chosen) -> Work:
    """The columns recomputed with half the step, and the members for which this was possible."""
    study, numbers, found = settling.study, before.column("member"), {name: v.copy() for name, v in before.columns.items()}
    reruns: list[Rerun] = []
    for i, controller in enumerate(study.controllers):
        found[f"{controller}/{AGAIN}"] = np.zeros(len(numbers), dtype=bool)
        judged = f"{controller}/{SETTLED}" in before.names
        factors = settled_by(before.column, controller) if judged else np.zeros(len(numbers))
        for factor in np.unique(factors[~np.isnan(factors)]):
            step = Step(FINER_BY * int(factor), refined=True) if factor else Step(FINER_BY, refined=False)
            reruns += settling.again(numbers, np.flatnonzero(factors == factor), i, step)
    if reruns:
        figures = yield [one.part for one in reruns]
        for rerun, (fine,) in zip(reruns, figures, strict=True):
            stalled = np.isinf(fine.finer_by) if study.example.simulation.tolerance is not None else np.zeros(1, dtype=bool)
            found[f"{study.controllers[rerun.controller]}/{AGAIN}"][rerun.places] = ~stalled
            (rings,) = rerun.study.oscillated(rerun.part.setting, [fine.metrics], rerun.controller)
            ring = RINGS if f"{study.controllers[rerun.controller]}/{RINGS}" in found else OSCILLATED  # from an old store
            for name, values in (fine.metrics.columns() | {VERDICT: fine.kinds, ring: rings}).items():
                if (column := f"{study.controllers[rerun.controller]}/{name}") in found:
                    found[column][rerun.places] = values
    return found


def _compared(before: _Chosen, after: _Chosen, settling: Settling, requirements: Sequence[Requirement]) -> Audit:
    numbers = before.column("member")
    changed, run_again = np.zeros(len(numbers), dtype=bool), np.zeros(len(numbers), dtype=bool)
    found: dict[str, dict[str, Changed]] = {}
    errors: dict[str, int] = {}
    for controller in settling.study.controllers:
        again = after.column(f"{controller}/{AGAIN}")
        run_again |= again
        for one, other in zip(*(judged_by(rows, controller, requirements) for rows in (before, after)), strict=True):
            judged = one.judged & one.settled & other.judged & again
            differs = (one.counted != other.counted) & judged
            changed |= differs
            found.setdefault(one.name, {})[controller] = Changed(changed=int(differs.sum()), judged=int(judged.sum()))
        coarse, fine = largest_error(before, controller), largest_error(after, controller)
        with np.errstate(invalid="ignore"):
            errors[controller] = int((np.abs(fine - coarse) > EQUAL_FIGURES_SHARE * np.maximum(fine, coarse)).sum())
    return Audit(
        members=tuple(map(int, numbers[run_again])),
        of=len(settling.study),
        drawn=len(numbers),
        changed=int(changed.sum()),
        verdicts=found,
        errors=errors,
        tolerance=settling.study.example.simulation.tolerance is not None,
    )
