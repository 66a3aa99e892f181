"""Numbers of a case that stay open in an export: gains, limits, initial estimates that enter the operations as they are.

A number that stands in the loop and in its initial state as it is becomes a parameter; one from which others follow, as P from
A_m or a filter's matrices from its poles, is compiled in. The
lists are those of an ensemble whose members differ in these numbers.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.structure import comes_from_outside
from barbalat.loop.true_values import estimate_set
from barbalat.open_numbers.kernel_numbers import Family, Member
from barbalat.open_numbers.numbers import beside, in_case
from barbalat.open_numbers.path import FieldPath
from barbalat.open_numbers.probe import examined
from barbalat.open_numbers.varied import VariedObjects
from barbalat.problem.known_set import UNREACHED_BOUND
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.kernel import breaks
from barbalat.run.kernel.members import Members
from barbalat.run.kernel.template import Columns, StructureError, Template
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

if TYPE_CHECKING:
    from barbalat.cases.build import Case

START = "theta_hat0"
"""The field of settings that says where estimates begin."""
OFFERED = ("controller", "uncertainty", "plant")
"""First keys of the numbers that are offered: of the controller, of its known set, of the plant, in this order."""


@dataclass(frozen=True)
class Parameter:
    """One open number.

    path      in the case; the controller is there at the place of which it is told
    value     in this case
    positive  whether the case refuses 0 and the negative of the value, as it does for gains
    """

    path: FieldPath
    value: float
    positive: bool = False

    @property
    def name(self) -> str:
        """The path as FMI writes it."""
        return self.path.structured

    @property
    def meaning(self) -> str:
        """A phrase for the descriptions of variables."""
        first, last = self.path.keys[0], self.path.vector[-1]
        if first == "controller":
            return "initial estimate" if last == START else "setting of the controller"
        if first == "uncertainty":
            return "of the known set"
        return "setting of the plant" if self.limit is None else "limit of the control"

    @property
    def limit(self) -> tuple[int, int] | None:
        """(input, side) of a limit of u, side 0 for the lower one; None for any other number."""
        keys = self.path.keys
        if keys[:2] != ("plant", "input") or "saturation" not in keys:
            return None
        return (int(keys[2]) if isinstance(keys[2], int) else 0), int(keys[-1])


@dataclass(frozen=True, eq=False)
class Opened:
    """The loop's lists with parameters in them.

    cases   this case, then for each parameter the case with another value of it, ``tried``: an ensemble with these lists
    feeds   by entries of the lists' third argument, which parameter each is; None for a number that is none
    starts  by entries of the loop's flat state, which parameter it begins with
    """

    parameters: tuple[Parameter, ...]
    tried: tuple[float, ...]
    cases: tuple[Member, ...]
    members: Members
    template: Template
    feeds: tuple[int | None, ...]
    starts: dict[int, int]

    @classmethod
    def of(
        cls, problem: TrackingProblem, controller: Controller, simulation: Simulation, *, tunable: bool, place: int = 0
    ) -> Opened:
        """InputError where the controller does not fit the problem; without ``tunable`` every number is compiled in.

        place  of the controller in its case, as paths tell it
        """
        case = VariedObjects.around(problem, _explicit_estimates(problem, controller), simulation).case
        found = list(_copied(case)) if tunable else []
        members = [(one.problem, one.controllers[0]) for one in (case, *(other for _, _, other in found))]
        family = Family.of(members, simulation)
        read = family.members
        return cls(
            tuple(Parameter(_placed(path, place), value, _positive(case, path, value)) for (path, value), _, _ in found),
            tuple(tried for _, tried, _ in found),
            tuple(members),
            read,
            Template.of(family.reader.columns, opened=not simulation.fused),
            tuple(_followed(row) for row in read.parameters),
            {row: k for row, values in enumerate(read.states) if (k := _followed(values)) is not None},
        )

    @cached_property
    def open_limits(self) -> Array:
        """(2, p) which of the estimates' limits, as of ``estimate_limits``, follow a parameter."""
        every = (estimate_limits(ClosedLoop.of(*case)) for case in self.cases)
        given = np.array([limits for limits in every if limits is not None])  # all have some, or none
        return np.asarray((given != given[0]).any(axis=0)) if len(given) else np.zeros((2, 0), dtype=bool)

    @property
    def values(self) -> Array:
        """(p,) what the lists' third argument is in this case."""
        return np.asarray(self.members.parameters[:, 0])

    def whole_samples(self, samples: int) -> int:
        """How many samples, of so many, pass before a signal breaks inside of a solver step: exports take whole ones."""
        simulation, signals = self.members.simulation, self.members.signals
        if not breaks.can_be_split(signals, simulation):
            return samples
        every = self.members.rhythm.sample_every
        found = breaks.breaks_inside(signals, simulation, 0, samples * every)
        return min(samples, int(found.min() / (every * simulation.dt))) if len(found) else samples


def _followed(row: Array) -> int | None:
    """Member k + 1 is the case with another value of parameter k."""
    moved = np.flatnonzero(row != row[0])
    return int(moved[0]) - 1 if len(moved) else None


def _placed(path: FieldPath, place: int) -> FieldPath:
    """The path in a case in which the controller, the only one here, stands at this place."""
    return FieldPath(("controller", place, *path.keys[2:])) if path.keys[0] == "controller" else path


def _copied(case: Case) -> Iterator[tuple[tuple[FieldPath, float], float, Case]]:
    """The numbers that stand in the loop as they are, each with another value of it and the case with that."""
    offered = [(path, value) for path, value in in_case(case) if path.keys[0] in OFFERED and isinstance(value, float)]
    for path, value in sorted(offered, key=lambda one: OFFERED.index(str(one[0].keys[0]))):
        if (found := _other(case, path, value)) is not None:
            yield (path, value), *found


def _other(case: Case, path: FieldPath, value: float) -> tuple[float, Case] | None:
    """Another value of the number and the case with it; None where it does not stand in the loop as it is."""
    base, varied = (case.problem, case.controllers[0]), VariedObjects(case, (path,))
    for tried in beside(value):
        try:
            other = varied.at([tried])
            effect, family = examined([base, (other.problem, other.controllers[0])], np.array([value, tried]), case.simulation)
        except (InputError, StructureError):
            continue
        copied = effect is not None and effect.copied and not effect.nothing
        return (tried, other) if copied and _bears_symbols(family) else None
    return None


def _positive(case: Case, path: FieldPath, value: float) -> bool:
    """Whether it must be above 0 by itself; a bound, or what has to lie between bounds, depends on other parameters."""
    if value <= 0.0 or path.keys[0] == "uncertainty" or path.vector[-1] == START or "saturation" in path.keys:
        return False
    varied = VariedObjects(case, (path,))
    return all(_is_refused(varied, tried) for tried in (0.0, -value))


def _is_refused(varied: VariedObjects, value: float) -> bool:
    try:
        other = varied.at([value])
        ClosedLoop.of(other.problem, other.controllers[0])
    except InputError:
        return True
    return False


def _bears_symbols(family: Family) -> bool:
    """Whether equations from outside the package compute with a symbol what they do with a number: none branches on it."""
    if not comes_from_outside(family.reader.loop.equations):
        return True
    try:
        Template.of(family.reader.columns)
    except InputError:
        return False
    return True


def _explicit_estimates(problem: TrackingProblem, controller: Controller) -> Controller:
    """With the initial estimates written out, where the settings have none."""
    loop = ClosedLoop.of(problem, controller)
    initial = loop.initial()[loop.theta_hat_rows]

    def written(part: Any) -> Any:
        if not is_dataclass(part) or isinstance(part, type):
            return part
        given = {one.name: getattr(part, one.name) for one in fields(part) if one.init}
        changed = {name: inner for name, value in given.items() if (inner := written(value)) is not value}
        if initial.size and given.get(START, initial) is None:
            changed[START] = initial
        return replace(part, **changed) if changed else part

    explicit = written(controller)
    same = Columns(loop)
    try:
        same.add(ClosedLoop.of(problem, explicit))
    except (StructureError, InputError):
        return controller
    return controller if same.differing()[0].any() else explicit


def estimate_limits(loop: ClosedLoop) -> tuple[Array, Array] | None:
    """The least and the largest value of each estimate in the set that it is projected onto; infinite where it has none."""
    box = estimate_set(loop)
    if box is None:
        return None
    low, high = np.full((2, loop.parameters), np.inf) * [[-1.0], [1.0]]
    if box.sphere is not None:
        first = slice(0, box.sphere.size)
        low[first], high[first] = box.sphere.extent
    if box.intervals is not None:
        last = slice(len(low) - box.intervals.size, len(low))
        low[last], high[last] = box.intervals.extent
    return np.where(low <= -UNREACHED_BOUND, -np.inf, low), np.where(high >= UNREACHED_BOUND, np.inf, high)
