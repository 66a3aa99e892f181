"""Computes how the metrics of a run depend on the numbers in its case: derivatives by tangents, checked by finite differences."""

from __future__ import annotations

import time
from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from barbalat import budget, validate
from barbalat.budget import Progress, part_of
from barbalat.cases.build import Case
from barbalat.cases.load import CaseText
from barbalat.gradients.check import Pair, checked
from barbalat.gradients.definitions import is_definition
from barbalat.gradients.neighbourhood import (
    NO_SLOPE,
    SHARES,
    Movable,
    Neighbourhood,
    NoSlope,
    Unmovable,
    examined,
    in_steps,
    numbers_of,
    own_numbers,
    require_given,
    traced,
)
from barbalat.loop.structure import comes_from_outside
from barbalat.open_numbers.path import FieldPath, by_index
from barbalat.problem.output_feedback import OutputProblem
from barbalat.run.engine.tangent_run import TangentRun, run_tangents
from barbalat.run.kernel import costs
from barbalat.run.kernel.members import Members
from barbalat.run.kernel.metrics import Metrics
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

FIGURES = ("max_abs_e", "rms_e", "max_abs_u")
"""The default metrics, with all their components."""
TANGENT_MEMBERS = 2.5
"""Number of members of an ensemble that take as long as a member with a tangent, measured as 2 to 3."""


@dataclass(frozen=True, kw_only=True)
class Derivative:
    """The derivative of a metric of a controller with respect to a number.

    value       the number
    figure      name of the metric, whose value is ``at``; ``instant`` [s] is the time of an extremum, otherwise None
    derivative  None if it is rejected; ``refused`` is the reason
    elasticity  percent of the metric per percent of the number; None if it is rejected, or if either of them is zero
    difference  the central difference with which it was compared; None if a run with a neighbouring value diverges
    differences  the differences with each step, the largest step first; the steps are SHARES of the size of the number
    local       whether the difference with the largest step deviates by more than a tenth; the derivative then holds for smaller
                changes only
    definition  whether the number defines a state or the form of a transfer function, and has no uncertainty of its own
    """

    controller: str
    figure: str
    at: float | None
    instant: float | None
    path: FieldPath
    value: float
    derivative: float | None
    elasticity: float | None
    difference: float | None
    differences: tuple[float | None, ...]
    local: bool
    definition: bool
    refused: str | None

    def as_json(self) -> dict[str, Any]:
        return {**vars(self), "path": str(self.path)}


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Sensitivities:
    """The derivatives of the metrics of a case's runs: by controller and metric, the largest elasticities first and definitions
    last.

    redesign  whether model and controllers are redesigned when the plant's numbers change; if not, only the simulated plant
              changes
    without  the numbers that have no derivatives, with the reason
    runs     number of runs made for the differences, over all controllers
    seconds  time of the runs with tangents, and of the runs for the differences
    steps    for a case with a tolerance, how the fixed steps of the runs were found
    """

    case: str
    controllers: tuple[str, ...]
    derivatives: tuple[Derivative, ...]
    redesign: bool
    without: dict[str, str]
    runs: int
    seconds: dict[str, float]
    steps: str | None = None

    def __repr__(self) -> str:
        refused = sum(one.derivative is None for one in self.derivatives)
        said = f", {refused} refused" if refused else ""
        return f"<Sensitivities {self.case!r}: {validate.counted(len(self.derivatives), 'derivative')}{said}>"

    def of(self, controller: str, figure: str) -> dict[str, Derivative]:
        """The derivatives of one metric by the paths of the numbers, in order; raises InputError for unknown names."""
        if controller not in self.controllers:
            raise validate.unknown_name("controller", controller, self.controllers)
        found = {str(one.path): one for one in self.derivatives if (one.controller, one.figure) == (controller, figure)}
        if not found:
            known = dict.fromkeys(one.figure for one in self.derivatives if one.controller == controller)
            raise validate.unknown_name("figure", figure, list(known))
        return found

    def as_json(self) -> dict[str, Any]:
        """The document of ``sensitivity --json``."""
        return {
            "case": self.case,
            "controllers": list(self.controllers),
            "redesign": self.redesign,
            "derivatives": [one.as_json() for one in self.derivatives],
            "without": self.without,
            "runs": self.runs,
            "seconds": self.seconds,
            "steps": self.steps,
        }


def sensitivity(
    case: str | Path | CaseText | Case,
    *,
    of: Sequence[str] = (),
    to: Sequence[str] = (),
    controllers: Sequence[str] = (),
    redesign: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Sensitivities:
    """Compute the derivatives of the metrics of a case's runs with respect to its numbers, and rank them.

    Each run integrates the tangents of its states by the same steps, so the result is the derivative of the discrete run. The
    slope of an extremum is the slope at its instant. Each derivative is compared with central differences with three steps. Where
    they disagree, the derivative is rejected with the reason: a corner, a jump, or a motion that is too sensitive.

    case         a case file, a bundled case's name, the text of a case file that has been read, or a ``Case``
    of           metrics as in ``run --json``, ``rms_e[0]`` or ``rms_e`` for all components; by default those of FIGURES
    to           paths of numbers, as in ``sweep``; by default all nonzero numbers of the loop
    controllers  names; by default all
    redesign     as in ``sweep``: whether model and controllers are redesigned when the plant's numbers change

    A case with a tolerance is run with the longest fixed steps whose metrics agree with those at the tolerance.

    Raises InputError for unknown names, and for a controller whose code has no derivative.
    """
    source = case if isinstance(case, (Case, CaseText)) else CaseText.read(case)
    own = source if isinstance(source, Case) else source.case()
    names = [one.name for one in own.controllers]
    for name in controllers:
        if name not in names:
            raise InputError(str(validate.unknown_name("controller", name, names)))
    which = [i for i, name in enumerate(names) if not controllers or name in controllers]
    labels = own.problem.labels
    figures = [by_index(one, labels) for one in of or FIGURES]
    require_figures(figures, own)
    given = [FieldPath.parse(by_index(path, labels)) for path in to]
    require_given(source, given)
    source, steps = in_steps(source, [own.controllers[i] for i in which])
    found = [examined(source, path, redesign=redesign) for path in dict.fromkeys(given or own_numbers(source))]
    if any(comes_from_outside(own.controllers[i]) for i in which):
        found = [traced(source, one, which, redesign=redesign) if isinstance(one, Movable) else one for one in found]
    moved = [one for one in found if isinstance(one, Movable)]
    without = {str(one.path): one.why for one in found if isinstance(one, Unmovable) and (given or not one.invalid)}
    known = numbers_of(source, given)
    definitions = {path for path in known if is_definition(own.problem, path, known)}
    study = None
    while moved and study is None:
        try:
            study = _Runs(Neighbourhood.of(source, moved, redesign=redesign), definitions, threads)
        except NoSlope as error:
            moved = [one for one in moved if one.path != error.path]
            without[str(error.path)] = NO_SLOPE
    if study is None:
        reasons = "; ".join(f"{path}: {why}" for path, why in without.items()) if given else "the case has none"
        raise InputError(f"no number has a derivative: {reasons}")
    study.require(which)
    derivatives: list[Derivative] = []
    for k, i in enumerate(which):
        told = part_of(progress, k / len(which), 1 / len(which))
        derivatives += study.of(i, figures, told)
    return Sensitivities(
        case=own.name,
        controllers=tuple(names[i] for i in which),
        derivatives=tuple(derivatives),
        redesign=redesign,
        without=without,
        runs=study.runs,
        seconds=study.seconds,
        steps=steps,
    )


class Beside(NamedTuple):
    """The runs with a number increased and decreased by ``step``, and the positions of the members in them."""

    step: float
    above: TangentRun
    place: int
    below: TangentRun
    other: int

    def of(self, figure: str) -> Pair:
        above, below = (
            (float(run.values[figure][place]), float(run.instants[figure][place]))
            for run, place in ((self.above, self.place), (self.below, self.other))
        )
        return Pair(self.step, above[0], below[0], (above[1], below[1]))


class _Runs:
    """The runs of a case and of its neighbours."""

    def __init__(self, near: Neighbourhood, definitions: Container[FieldPath], threads: int | None) -> None:
        self.near, self.definitions, self.threads = near, definitions, threads
        self.seconds = {"tangents": 0.0, "differences": 0.0}
        self.runs = 0
        self.directions = near.directions(near.base[None])

    @property
    def simulation(self) -> Simulation:
        return self.near.setting.simulation

    def require(self, which: Sequence[int]) -> None:
        """Raise InputError for runs that exceed the budget."""
        loops = [self.near.setting.families[i].reader.loop for i in which]

        def cost(numbers: float) -> budget.Estimate:
            members = (2 * len(SHARES) + TANGENT_MEMBERS) * numbers
            return costs.of_members(loops, self.simulation.steps, members)

        budget.require("the numbers", max(len(self._columns(i)) for i in which), cost, what="the derivatives")

    def _columns(self, place: int) -> list[int]:
        """The numbers on which the run of a controller may depend: all except the numbers of other controllers."""
        paths = [one.path for one in self.near.moved]
        return [i for i, path in enumerate(paths) if path.keys[0] != "controller" or path.keys[1] == place]

    def of(self, place: int, figures: Sequence[str], progress: Progress | None) -> Iterator[Derivative]:
        """The derivatives for one controller."""
        near, name, columns = self.near, self.near.case.controllers[place].name, self._columns(place)
        if not columns:
            return
        started = time.perf_counter()
        exact = run_tangents(
            self._members(place, near.base[None]),
            near.setting.signals,
            [self.directions[place][i] for i in columns],
            threads=self.threads,
            progress=part_of(progress, 0.0, 0.4),
        )
        middle = time.perf_counter()
        beside = self._beside(place, columns, part_of(progress, 0.4, 0.6))
        self.seconds["tangents"] += middle - started
        self.seconds["differences"] += time.perf_counter() - middle
        for figure in chosen(figures, exact.values):
            rows = [self._derivative(name, figure, k, near.moved[i], exact, beside[i]) for k, i in enumerate(columns)]
            yield from sorted(rows, key=_first)

    def _members(self, place: int, rows: Array) -> Members:
        """The members of one controller's kernel with the numbers ``rows``."""
        numbers = self.near.setting.numbers(rows)[place]
        return self.near.setting.families[place].given(numbers, np.zeros(len(rows), dtype=int))

    def _beside(self, place: int, columns: Sequence[int], progress: Progress | None) -> dict[int, list[Beside]]:
        """For each number and each step, the runs above and below it, each with the position of the member."""
        near, numeric = self.near, [i for i in columns if i in self.near.numeric]
        steps = [(i, share) for i in numeric for share in SHARES]
        found: dict[int, list[Beside]] = {i: [] for i in columns}
        if steps:
            rows = np.vstack([row for i, share in steps for row in near.stepped(near.base[None], i, share)])
            together = run_tangents(self._members(place, rows), near.setting.signals, threads=self.threads, progress=progress)
            for k, (i, share) in enumerate(steps):
                found[i].append(Beside(share * near.moved[i].scale, together, 2 * k, together, 2 * k + 1))
        for i in columns:
            if i not in numeric:
                found[i] = [self._driven(place, i, share) for share in SHARES]
        self.runs += 2 * len(SHARES) * len(columns)
        return found

    def _driven(self, place: int, column: int, share: float) -> Beside:
        """The runs with the signals for different values of a number."""
        near = self.near
        above, below = (
            run_tangents(self._members(place, near.base[None]), near.varied.at(row[0]).problem.signals, threads=self.threads)
            for row in near.stepped(near.base[None], column, share)
        )
        return Beside(share * near.moved[column].scale, above, 0, below, 0)

    def _derivative(
        self, controller: str, figure: str, k: int, one: Movable, exact: TangentRun, beside: Sequence[Beside]
    ) -> Derivative:
        value, instant = float(exact.values[figure][0]), float(exact.instants[figure][0])
        tangent = float(exact.tangents[figure][k, 0])
        pairs = [pair.of(figure) for pair in beside]
        found = checked(tangent, value, instant, pairs, dt=self.simulation.dt, scale=one.scale)
        elastic = not found.refused and one.value != 0 and value != 0
        return Derivative(
            controller=controller,
            figure=figure,
            at=_finite(value),
            instant=_finite(instant),
            path=one.path,
            value=one.value,
            derivative=None if found.refused else tangent,
            elasticity=tangent * one.value / value if elastic else None,
            difference=_finite(found.difference),
            differences=tuple(_finite(pair.slope) for pair in pairs),
            local=found.local,
            definition=one.path in self.definitions,
            refused=found.refused or None,
        )


def require_figures(figures: Sequence[str], case: Case) -> None:
    """Raise InputError, before anything is computed, for names without any component that is a metric with a derivative."""
    without = {"diverged_at"} if isinstance(case.problem, OutputProblem) else {"diverged_at", "max_abs_y"}
    chosen([one.split("[")[0] for one in figures], [name for name in Metrics.__dataclass_fields__ if name not in without])


def chosen(figures: Sequence[str], known: Iterable[str]) -> list[str]:
    """The metrics with these names, or with all their components; raises InputError for an unknown name."""
    found: list[str] = []
    for figure in figures:
        named = [name for name in known if figure in (name, name.split("[")[0])]
        if not named:
            hint = "" if figure not in ("verdict", "diverged_at", "lost") else ": a verdict or an instant has no derivative"
            known_names = ", ".join(dict.fromkeys(name.split("[")[0] for name in known))
            raise InputError(
                f"{figure} is not a metric of a run that has a derivative{hint}; those that have one are {known_names}"
            )
        found += named
    return list(dict.fromkeys(found))


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None


def _first(one: Derivative) -> tuple[bool, float, float]:
    """The sort order: first by elasticity, then derivatives without an elasticity by size, then rejected derivatives; definitions
    last."""
    if one.derivative is None:
        return one.definition, 2.0, 0.0
    without = one.elasticity is None
    return one.definition, float(without), -abs(one.derivative if one.elasticity is None else one.elasticity)
