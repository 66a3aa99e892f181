"""Is it the solver's? Some members of a finished sweep once more, each at half of the step that its verdict comes from."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.run.results.step_comparison import EQUAL_FIGURES_SHARE
from barbalat.sweeps.chunks import Columns, Rows
from barbalat.sweeps.evidence import judged_by, largest_error
from barbalat.sweeps.requirement import Requirement
from barbalat.sweeps.settling import Rerun, Settling, Step, Work, settled_by
from barbalat.sweeps.statistics import Share
from barbalat.sweeps.study import OSCILLATED, RINGS, SETTLED, VERDICT, columns_of
from barbalat.validate import Array, InputError

AUDITED_SHARE, FEWEST_AUDITED = 0.02, 30
"""Of the members, and members at least, that are run again: with 10 % of all verdicts the solver's, 96 of 100 audits find one."""
FINER_BY = 2
AGAIN = "run again"
"""A column of each controller while the audit lasts: of which members drawn a run at half the step could be had."""


@dataclass(frozen=True, kw_only=True)
class Changed:
    """How many audited members one verdict on one controller could be given, and how many of them lose or gain it."""

    changed: int
    judged: int


@dataclass(frozen=True, kw_only=True)
class Audit:
    """What half the step says of a sweep's verdicts.

    members    numbers of those that were run again with one controller at least; ``of`` how many the sweep has
    drawn      how many were to be run again: what no step settled is not, nor what half the step refuses
    changed    of ``members``, those with another verdict on any controller; None where nothing could be run, see ``why``
    verdicts   by what is judged, and then by controllers
    errors     by controllers, members whose largest |e| differs by more than a tenth
    """

    members: tuple[int, ...] = ()
    of: int = 0
    drawn: int = 0
    changed: int | None = None
    verdicts: Mapping[str, Mapping[str, Changed]] = field(default_factory=dict)
    errors: Mapping[str, int] = field(default_factory=dict)
    why: str = ""

    @property
    def share(self) -> Share | None:
        """Of members with a changed verdict; None where nothing could be run."""
        return None if self.changed is None else Share(count=self.changed, judged=len(self.members))

    @property
    def sentences(self) -> list[str]:
        """The audit in sentences."""
        if self.share is None:
            return [f"no member was run again at half its step, so that any share may be the solver's: {self.why}"]
        low, high = self.share.interval
        again = f"of {validate.counted(len(self.members), 'member')} run again at half the step"
        within = f"{100 * self.share.share:.3g} %, 95 % interval {100 * low:.3g} to {100 * high:.3g} %"
        if self.changed:
            said = [f"{again}, {self.changed} changed a verdict ({within}; {self._changes}): a smaller simulation.dt is needed"]
        else:
            said = [f"{again}, none changed a verdict ({within})"]
        if left := self.drawn - len(self.members):
            said.append(f"{validate.counted(left, 'member')} drawn beside them could not be run again: no step settles them")
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
        """``share`` is that of the members with a changed verdict."""
        return {
            "members": list(self.members),
            "drawn": self.drawn,
            "finer_by": FINER_BY,
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
    """Run some members again, each controller's at half of the step that settled it; those that are not settled stay as they are.

    They are drawn from all members by the plan's seed: what changes among them is a share of the sweep. ``members`` says how
    many, by default AUDITED_SHARE of all and FEWEST_AUDITED at least; ``run`` does the work.
    """
    study = settling.study
    count = max(FEWEST_AUDITED, round(AUDITED_SHARE * len(study))) if members is None else members
    if count == 0:
        return Audit(why="none was asked for", of=len(study))
    generator = np.random.default_rng([study.plan.seed, FINER_BY])
    drawn = min(count, len(study))
    chosen = np.sort(generator.choice(len(study), drawn, replace=False))
    before = _Chosen({name: rows.column(name)[chosen] for name in rows.names})
    try:
        after = _Chosen(run(_work(settling, before)))
    except InputError as error:
        return Audit(why=str(error), of=len(study), drawn=drawn)
    if not any(after.column(f"{controller}/{AGAIN}").any() for controller in study.controllers):
        return Audit(why=f"no step settles any of the {validate.counted(drawn, 'member')} drawn", of=len(study), drawn=drawn)
    return _compared(before, after, settling, requirements)


@dataclass(frozen=True, eq=False)
class _Chosen:
    """Columns of some members, as a finished sweep can be asked."""

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
    """The same columns, by half the steps, and which members have them."""
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
            found[f"{study.controllers[rerun.controller]}/{AGAIN}"][rerun.places] = True
            (rings,) = rerun.study.oscillated(rerun.part.setting, [fine.metrics], rerun.controller)
            ring = RINGS if f"{study.controllers[rerun.controller]}/{RINGS}" in found else OSCILLATED  # of a store of old
            for name, values in (columns_of(fine.metrics) | {VERDICT: fine.kinds, ring: rings}).items():
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
    )
