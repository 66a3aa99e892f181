"""Is it the solver's? Some members of a finished sweep once more at a finer step, and which verdicts that changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.run.results.step_comparison import EQUAL_FIGURES_SHARE
from barbalat.study.finer_step import FINER_BY
from barbalat.sweeps.bounds import ERROR_BOUND, Bounds
from barbalat.sweeps.chunks import Columns
from barbalat.sweeps.evidence import Evidence, largest_error, verdicts
from barbalat.sweeps.requirement import Requirement
from barbalat.sweeps.study import Figured, Finer, Study, StudyPart, batches_run, figured
from barbalat.validate import Array, InputError

MOST_AUDITED = 32
"""Members that are run again: with 10 % of all verdicts the solver's, 97 of 100 audits of so many find one."""
LARGEST_SHARE = 8
"""At most one part in so many of the sweep's solver steps goes into its audit."""
ALWAYS_AFFORDED = 10**8
"""Solver steps that an audit may take in a small sweep too: a second of one core."""
WORST_SHARE = 4
"""At most one in so many of the members that are run again is there for having the largest error."""


@dataclass(frozen=True, kw_only=True)
class Changed:
    """How many audited members one verdict on one controller could be given, and how many of them lose or gain it."""

    changed: int
    judged: int


@dataclass(frozen=True, kw_only=True)
class Audit:
    """What a finer step says of a sweep's verdicts.

    members    numbers of those that were run again; ``of`` how many there are
    changed    of them, those with another verdict on any controller; None where nothing could be run, see ``why``
    verdicts   by what is judged, and then by controllers
    errors     by controllers, members whose largest |e| differs by more than a tenth
    """

    members: tuple[int, ...] = ()
    of: int = 0
    changed: int | None = None
    verdicts: Mapping[str, Mapping[str, Changed]] = field(default_factory=dict)
    errors: Mapping[str, int] = field(default_factory=dict)
    why: str = ""

    @property
    def sentences(self) -> list[str]:
        """The audit in sentences."""
        if self.changed is None:
            return [f"no member was run again with a finer step, so that any share may be the solver's: {self.why}"]
        again = f"of {validate.counted(len(self.members), 'member')} run again with a step {FINER_BY} times smaller"
        if self.changed:
            said = [
                f"{again}, {self.changed} changed a verdict ({self._changes}): the shares are partly artefacts of the solver, "
                "and a smaller simulation.dt is needed"
            ]
        else:
            said = [f"{again}, none changed a verdict"]
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
        count = len(self.members)
        return {
            "members": list(self.members),
            "finer_by": FINER_BY,
            "changed": self.changed,
            "share": None if self.changed is None else self.changed / count,
            "verdicts": {name: {c: dict(vars(one)) for c, one in by.items()} for name, by in self.verdicts.items()},
            "errors": dict(self.errors),
            "sentences": self.sentences,
        }


def audit(
    study: Study,
    evidence: Evidence,
    requirements: Sequence[Requirement] = (),
    bounds: Bounds | None = None,
    *,
    members: int | None = None,
    threads: int | None = None,
) -> Audit:
    """Run some members again, as they were and with a finer step.

    Half of them are drawn from those that failed and half from the others, as far as there are, by the plan's seed; the members
    with the largest errors come first. ``members`` says how many, by default MOST_AUDITED or what an eighth of the sweep's
    solver steps affords, and a second of one core.
    """
    count = _affordable(study) if members is None else min(members, len(study))
    if count == 0:
        return Audit(why="none was asked for", of=len(study))
    chosen = _chosen(evidence, count, study.plan.seed)
    try:
        plain = Study(study.varied, study.plan, settling=False)
        before = _Rows(_run(plain, chosen, threads), study, bounds)
        finer = Study(Finer(study.varied, FINER_BY), study.plan, settling=False)
        columns = _run(finer, chosen, threads)
    except InputError as error:
        return Audit(why=str(error), of=len(study))
    return _compared(chosen, before, _Rows(columns, study, bounds), study, evidence, requirements)


def _affordable(study: Study) -> int:
    steps = max(len(study) * study.steps // LARGEST_SHARE, ALWAYS_AFFORDED)
    each = (FINER_BY + 1) * study.steps
    return int(min(max(steps // each, 1), MOST_AUDITED, len(study)))


def _chosen(evidence: Evidence, count: int, seed: int) -> Array:
    """(K,) numbers in their order."""
    errors = [by for name, by in evidence.metrics.items() if name.startswith("max_abs_e[")]
    worst = list(dict.fromkeys(one.worst_member for by in errors for one in by.values()))[: -(-count // WORST_SHARE)]
    failed = evidence.failed.copy()
    sound = ~failed
    failed[worst] = sound[worst] = False
    left, generator = count - len(worst), np.random.default_rng([seed, FINER_BY])
    of_failed = min(max((left + 1) // 2, left - int(sound.sum())), int(failed.sum()))
    drawn = [
        generator.choice(np.flatnonzero(which), size, replace=False)
        for which, size in ((failed, of_failed), (sound, left - of_failed))
    ]
    return np.sort(np.concatenate([np.array(worst, dtype=int), *drawn]))


class _Rows:
    """Columns of some members, with what is guaranteed of each, as a finished sweep can be asked."""

    def __init__(self, columns: Columns, study: Study, bounds: Bounds | None) -> None:
        self.columns = dict(columns)
        if bounds is not None:
            guaranteed = bounds.of(study.plan.values_for(columns["member"]))
            self.columns |= {f"{name}/{ERROR_BOUND}": values for name, values in guaranteed.items()}

    @property
    def names(self) -> list[str]:
        return list(self.columns)

    def column(self, name: str) -> Array:
        return self.columns[name]

    def row(self, member: int) -> dict[str, float]:
        place = int(np.flatnonzero(self.columns["member"] == member)[0])
        return {name: float(values[place]) for name, values in self.columns.items()}


def _run(study: Study, numbers: Array, threads: int | None) -> Columns:
    """All columns of these members."""
    parts: list[StudyPart] = []
    figures: list[list[Figured]] = []
    for part in study.parts_for(numbers):
        simulation = part.setting.simulation
        batches = batches_run(part.setting, part.members, threads=threads)
        parts.append(replace(part, members=()))
        figures.append([figured(batch, simulation, part.setting.terms, threads) for batch in batches])
    return study.columns_for(numbers, parts, figures)


def _compared(
    chosen: Array,
    before: _Rows,
    after: _Rows,
    study: Study,
    evidence: Evidence,
    requirements: Sequence[Requirement],
) -> Audit:
    changed = np.zeros(len(chosen), dtype=bool)
    found: dict[str, dict[str, Changed]] = {}
    errors: dict[str, int] = {}
    for controller in study.controllers:
        pairs = zip(*(verdicts(rows, controller, requirements, evidence.unexamined) for rows in (before, after)), strict=True)
        for one, other in pairs:
            judged = one.judged & other.judged
            differs = (one.counted != other.counted) & judged
            changed |= differs
            found.setdefault(one.name, {})[controller] = Changed(changed=int(differs.sum()), judged=int(judged.sum()))
        coarse, fine = largest_error(before, controller), largest_error(after, controller)
        with np.errstate(invalid="ignore"):
            errors[controller] = int((np.abs(fine - coarse) > EQUAL_FIGURES_SHARE * np.maximum(fine, coarse)).sum())
    return Audit(
        members=tuple(map(int, chosen)),
        of=len(study),
        changed=int(changed.sum()),
        verdicts=found,
        errors=errors,
    )
