"""Numbers of a case that stay open in an export: gains, limits, initial estimates that enter the operations unchanged.

A number that occurs unchanged in the loop and in its initial state becomes a parameter; one from which others follow, like A_m,
from which P follows, or a filter's poles, is compiled in. The lists are those of an ensemble whose members differ in these
numbers.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
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
"""The field of settings with the initial estimates."""
OFFERED = ("controller", "uncertainty", "plant")
"""First keys of the offered numbers: controller, known set, plant, in this order."""


@dataclass(frozen=True)
class Parameter:
    """One open number.

    path      in the case, with the controller's index there
    value     in this case
    bound  the case's bound on it, whatever the other numbers are: "> 0" for gains, ">= 0", "< 0", "<= 0", "!= 0", or nothing
    """

    path: FieldPath
    value: float
    bound: str = ""

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
            return "bound of the known set"
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
    """The loop's lists with parameters.

    cases   this case, then for each parameter the case with another value of it, ``tried``: an ensemble with these lists
    feeds   by entry of the lists' third argument, the index of its parameter; None for a fixed number
    starts  by entry of the loop's flat state, the index of the parameter that is its initial value
    ordered  pairs of parameters of which the case refuses the first above the second, and whether it also refuses equal values
    """

    parameters: tuple[Parameter, ...]
    tried: tuple[float, ...]
    cases: tuple[Member, ...]
    members: Members
    template: Template
    feeds: tuple[int | None, ...]
    starts: dict[int, int]
    ordered: tuple[tuple[int, int, bool], ...]

    @classmethod
    def of(
        cls, problem: TrackingProblem, controller: Controller, simulation: Simulation, *, tunable: bool, place: int = 0
    ) -> Opened:
        """InputError if the controller does not fit the problem; without ``tunable`` every number is compiled in.

        place  index of the controller in its case, for the paths
        """
        case = VariedObjects.around(problem, _explicit_estimates(problem, controller), simulation).case
        free = VariedObjects.around(problem, _with_estimates(controller, None), simulation).case  # which may start in any set
        found = list(_copied(case)) if tunable else []
        members = [(one.problem, one.controllers[0]) for one in (case, *(other for _, _, other in found))]
        family = Family.of(members, simulation)
        read = family.members
        return cls(
            tuple(Parameter(_placed(path, place), value, _bound(free, path, value)) for (path, value), _, _ in found),
            tuple(tried for _, tried, _ in found),
            tuple(members),
            read,
            Template.of(family.reader.columns, opened=not simulation.fused),
            tuple(_followed(row) for row in read.parameters),
            {row: k for row, values in enumerate(read.states) if (k := _followed(values)) is not None},
            tuple(_ordered(free, [numbered for numbered, _, _ in found])),
        )

    @cached_property
    def open_limits(self) -> Array:
        """(2, p) which of the estimates' limits, in the form of ``estimate_limits``, depend on a parameter."""
        every = (estimate_limits(ClosedLoop.of(*case)) for case in self.cases)
        given = np.array([limits for limits in every if limits is not None])  # either all have some, or none
        return np.asarray((given != given[0]).any(axis=0)) if len(given) else np.zeros((2, 0), dtype=bool)

    @property
    def values(self) -> Array:
        """(p,) the values of the lists' third argument in this case."""
        return np.asarray(self.members.parameters[:, 0])

    def whole_samples(self, samples: int) -> int:
        """The number of samples, up to ``samples``, before a signal breaks inside a solver step: exports use whole steps."""
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
    """The numbers that occur unchanged in the loop, each with another value of it and the case with that value.

    The baseline's gains stay compiled in, since a part of the code (its fallback, the model) follows from them; so do the bounds
    of a known set beside a baseline, which the loop has only shifted by its gains.
    """
    compiled = () if case.problem.fixed is None else (("plant", "baseline"), ("uncertainty",))
    offered = [
        (path, value)
        for path, value in in_case(case)
        if path.keys[0] in OFFERED
        and path.keys[:2] not in compiled
        and path.keys[:1] not in compiled
        and isinstance(value, float)
    ]
    for path, value in sorted(offered, key=lambda one: OFFERED.index(str(one[0].keys[0]))):
        if (found := _other(case, path, value)) is not None:
            yield (path, value), *found


def _other(case: Case, path: FieldPath, value: float) -> tuple[float, Case] | None:
    """Another value of the number and the case with it; None if it does not occur unchanged in the loop."""
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


def _bound(case: Case, path: FieldPath, value: float) -> str:
    """Its bound at 0, independent of other numbers: values near 0 on one side are accepted, and those on the other side are
    not."""
    if path.vector[-1] == START:
        return ""
    varied, size = VariedObjects(case, (path,)), abs(value) or 1.0
    for side, relation in ((1.0, ">"), (-1.0, "<")):
        beyond = all(_is_refused(varied, -side * share * size) for share in (NEAR_ZERO, 1.0))
        if side * value >= 0.0 and beyond and not _is_refused(varied, side * NEAR_ZERO * size):
            return f"{relation} 0" if _is_refused(varied, 0.0) else f"{relation}= 0"
    return "!= 0" if value != 0.0 and _is_refused(varied, 0.0) and not _is_refused(varied, -value) else ""


NEAR_ZERO = 1e-3
"""Relative step of a number: small enough to respect its other bounds, large enough to change the results computed from it."""


def _ordered(case: Case, numbers: Sequence[tuple[FieldPath, float]]) -> Iterator[tuple[int, int, bool]]:
    """Pairs of numbers, by index, of which the case refuses the first above the second, and whether it also refuses equal
    values."""
    for i, j in itertools.permutations(range(len(numbers)), 2):
        (low, a), (high, b) = numbers[i], numbers[j]
        if a > b or not _side_by_side(low, high):
            continue
        varied, step = VariedObjects(case, (low, high)), PROBED_SHARE * (b - a) or 1.0
        crossed, near = ((b + step, b), (a, a - step)), ((b - step, b), (a, a + step))
        if all(_is_refused(varied, *one) for one in crossed) and not any(_is_refused(varied, *one) for one in near):
            yield i, j, _is_refused(varied, b, b)


PROBED_SHARE = 0.1
"""Share of the distance of two numbers by which one is moved towards the other, and past it."""


def _side_by_side(a: FieldPath, b: FieldPath) -> bool:
    """Whether they are the two ends of one pair, or differ only in one key: lower[1] and upper[1]."""
    apart = [(one, other) for one, other in zip(a.keys, b.keys, strict=False) if one != other]
    if len(a.keys) != len(b.keys) or len(apart) != 1:
        return False
    ((one, other),) = apart
    return {one, other} == {0, 1} if isinstance(one, int) else isinstance(other, str)


def _is_refused(varied: VariedObjects, *values: float) -> bool:
    try:
        other = varied.at(values)
        ClosedLoop.of(other.problem, other.controllers[0])
    except InputError:
        return True
    return False


def _bears_symbols(family: Family) -> bool:
    """Whether equations from outside the package compute with a symbol as they do with a number: none branches on it."""
    if not comes_from_outside(family.reader.loop.equations):
        return True
    try:
        Template.of(family.reader.columns)
    except InputError:
        return False
    return True


def _explicit_estimates(problem: TrackingProblem, controller: Controller) -> Controller:
    """The controller with explicit initial estimates, if the settings have none."""
    loop = ClosedLoop.of(problem, controller)
    explicit = _with_estimates(controller, loop.initial()[loop.theta_hat_rows])
    same = Columns(loop)
    try:
        same.add(ClosedLoop.of(problem, explicit))
    except (StructureError, InputError):
        return controller
    return controller if same.differing()[0].any() else explicit


def _with_estimates(part: Any, initial: Array | None) -> Any:
    """A controller with these initial estimates if its settings have none, or with None if they have some."""
    if not is_dataclass(part) or isinstance(part, type):
        return part
    given = {one.name: getattr(part, one.name) for one in fields(part) if one.init}
    changed = {name: inner for name, value in given.items() if (inner := _with_estimates(value, initial)) is not value}
    if START in given and (given[START] is None) != (initial is None) and (initial is None or initial.size):
        changed[START] = initial
    return replace(part, **changed) if changed else part


def estimate_limits(loop: ClosedLoop) -> tuple[Array, Array] | None:
    """The least and the largest value of each estimate in the set onto which it is projected; infinite without a set."""
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
