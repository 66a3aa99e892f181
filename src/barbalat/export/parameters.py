"""Run-time parameters of an export: gains, limits and initial estimates of the case that the operations use unchanged.

A number that occurs unchanged in the loop and in its initial state becomes a parameter. A number from which others follow is
compiled in, such as A_m, which determines P, or the pole of a filter. The lists are those of an ensemble whose members differ in
these numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from barbalat.export.acceptance import Acceptance, Condition, Entry, Norm, NotFoundError
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.structure import comes_from_outside
from barbalat.loop.true_values import estimate_set
from barbalat.open_numbers.kernel_numbers import Family, Member
from barbalat.open_numbers.numbers import in_case, neighbours
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
"""First keys of the possible parameter paths: controller, known set, plant, in this order."""


@dataclass(frozen=True)
class Parameter:
    """One run-time parameter.

    path      path in the case, with the index of the controller in the case
    value     value in this case
    """

    path: FieldPath
    value: float

    @property
    def name(self) -> str:
        """The path in FMI's notation."""
        return self.path.structured

    @property
    def meaning(self) -> str:
        """A phrase for the descriptions of variables."""
        first, last = self.path.keys[0], self.path.vector[-1]
        if first == "controller":
            return "initial estimate" if last == START else "setting of the controller"
        if first == "uncertainty":
            return "bound of the known set"
        return "setting of the plant" if self.limit is None else "control limit"

    @property
    def limit(self) -> tuple[int, int] | None:
        """(input, side) of a limit on u, with side 0 for the lower limit; None for any other number."""
        keys = self.path.keys
        if keys[:2] != ("plant", "input") or "saturation" not in keys:
            return None
        return (int(keys[2]) if isinstance(keys[2], int) else 0), int(keys[-1])


@dataclass(frozen=True, eq=False)
class Opened:
    """The loop's lists with parameters.

    cases   this case, then for each parameter the case with a different value of it, ``tried``: an ensemble with these lists
    feeds   by entry of the lists' third argument, the index of its parameter; None for a fixed number
    starts  by entry of the loop's flat state, the index of the parameter that is its initial value
    conditions  conditions of the case on its parameters, by parameter index
    """

    parameters: tuple[Parameter, ...]
    tried: tuple[float, ...]
    cases: tuple[Member, ...]
    members: Members
    template: Template
    feeds: tuple[int | None, ...]
    starts: dict[int, int]
    conditions: tuple[Condition, ...]

    @classmethod
    def of(
        cls, problem: TrackingProblem, controller: Controller, simulation: Simulation, *, tunable: bool, place: int = 0
    ) -> Opened:
        """Raise InputError if the controller does not fit the problem; without ``tunable`` every number is compiled in.

        place  index of the controller in its case, used in paths
        """
        case = VariedObjects.around(problem, _explicit_estimates(problem, controller), simulation).case
        found, conditions = _settable(case) if tunable else ([], ())
        members = _members(case, found)
        family = Family.of(members, simulation)
        read = family.members
        return cls(
            tuple(Parameter(_placed(path, place), value) for (path, value), _, _ in found),
            tuple(tried for _, tried, _ in found),
            tuple(members),
            read,
            Template.of(family.reader.columns, opened=not simulation.fused),
            tuple(_followed(row) for row in read.parameters),
            {row: k for row, values in enumerate(read.states) if (k := _followed(values)) is not None},
            conditions,
        )

    @cached_property
    def open_limits(self) -> Array:
        """(2, p) whether the limits of the estimates, in the form of ``estimate_limits``, depend on a parameter."""
        every = (estimate_limits(ClosedLoop.of(*case)) for case in self.cases)
        given = np.array([limits for limits in every if limits is not None])  # either all inputs have limits, or none has
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
    """Member k + 1 is the case with a different value of parameter k."""
    moved = np.flatnonzero(row != row[0])
    return int(moved[0]) - 1 if len(moved) else None


def _placed(path: FieldPath, place: int) -> FieldPath:
    """The path in a case that has this controller, the only one here, at the given position."""
    return FieldPath(("controller", place, *path.keys[2:])) if path.keys[0] == "controller" else path


Offered = tuple[tuple[FieldPath, float], float, "Case"]
"""A number with its path, a different value of it, and the case with that value."""


def _copied(case: Case) -> Iterator[Offered]:
    """The numbers that occur unchanged in the loop, each with a different value of it and the case with that value.

    The baseline's gains stay compiled in, because a part of the code (its fallback, the model) follows from them. So do the
    bounds of a known set with a baseline, which the loop contains shifted by these gains.
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
    """A different value of the number, and the case with that value; None if the number does not occur unchanged in the loop."""
    base, varied = (case.problem, case.controllers[0]), VariedObjects(case, (path,))
    for tried in neighbours(value):
        try:
            other = varied.at([tried])
            effect, family = examined([base, (other.problem, other.controllers[0])], np.array([value, tried]), case.simulation)
        except (InputError, StructureError):
            continue
        copied = effect is not None and effect.copied and not effect.nothing
        return (tried, other) if copied and _tolerates_symbols(family) else None
    return None


def _settable(case: Case) -> tuple[list[Offered], tuple[Condition, ...]]:
    """The numbers whose admissible values are known, with the conditions on them; any other number is compiled in."""
    found = list(_copied(case))
    while True:
        try:
            return found, _acceptance(case, found).conditions()
        except NotFoundError as error:
            depths = {i: len(found[i][0][0].keys) for i in error.numbers}
            deepest = max(depths.values())  # a matrix's entries come first, so that a bound on the whole matrix is a constant
            found = [one for i, one in enumerate(found) if depths.get(i) != deepest]


def _acceptance(case: Case, found: Sequence[Offered]) -> Acceptance:
    paths = tuple(path for (path, _), _, _ in found)
    values = np.array([value for (_, value), _, _ in found])

    def accepts(given: Array) -> bool:
        moved = np.flatnonzero(given != values)
        return not _is_refused(VariedObjects(case, tuple(paths[i] for i in moved)), *given[moved])

    return Acceptance(paths, values, accepts, tuple(_balls(_members(case, found), [tried for _, tried, _ in found])))


def _balls(members: Sequence[Member], tried: Sequence[float]) -> Iterator[Norm]:
    """The ball in which the estimates start; the (k + 1)-th member is the case with a different value of the k-th number."""
    loops = [ClosedLoop.of(*member) for member in members]
    spheres = [None if (known := estimate_set(loop)) is None else known.sphere for loop in loops]
    size = 0 if spheres[0] is None else spheres[0].size
    rows = [
        [*loop.initial()[loop.theta_hat_rows][:size], *sphere.center, sphere.radius]
        for loop, sphere in zip(loops, spheres, strict=True)
        if sphere is not None
    ]
    if not size or len(rows) < len(members):
        return
    entries: list[Entry] = []
    for values in np.array(rows).T:
        moved = np.flatnonzero(values != values[0]).tolist()
        if len(moved) > 1 or any(values[k] != tried[k - 1] for k in moved):
            return
        entries.append(moved[0] - 1 if len(moved) else float(values[0]))
    yield Norm(tuple(entries[:size]), tuple(entries[size:-1]), entries[-1])


def _members(case: Case, found: Sequence[Offered]) -> list[Member]:
    return [(one.problem, one.controllers[0]) for one in (case, *(other for _, _, other in found))]


def _is_refused(varied: VariedObjects, *values: float) -> bool:
    try:
        other = varied.at(values)
        ClosedLoop.of(other.problem, other.controllers[0]).initial()
    except InputError:
        return True
    return False


def _tolerates_symbols(family: Family) -> bool:
    """Whether equations from outside the package also accept a symbol in place of the number; they do not if they branch on
    it."""
    if not comes_from_outside(family.reader.loop.equations):
        return True
    try:
        Template.of(family.reader.columns)
    except InputError:
        return False
    return True


def _explicit_estimates(problem: TrackingProblem, controller: Controller) -> Controller:
    """The controller with explicit initial estimates, if its settings contain none."""
    loop = ClosedLoop.of(problem, controller)
    explicit = _with_estimates(controller, loop.initial()[loop.theta_hat_rows])
    same = Columns(loop)
    try:
        same.add(ClosedLoop.of(problem, explicit))
    except (StructureError, InputError):
        return controller
    return controller if same.differing()[0].any() else explicit


def _with_estimates(part: Any, initial: Array | None) -> Any:
    """A controller with these initial estimates if its settings contain none, or with None if they contain some."""
    if not is_dataclass(part) or isinstance(part, type):
        return part
    given = {one.name: getattr(part, one.name) for one in fields(part) if one.init}
    changed = {name: inner for name, value in given.items() if (inner := _with_estimates(value, initial)) is not value}
    if START in given and (given[START] is None) != (initial is None) and (initial is None or initial.size):
        changed[START] = initial
    return replace(part, **changed) if changed else part


def estimate_limits(loop: ClosedLoop) -> tuple[Array, Array] | None:
    """The smallest and the largest value of each estimate in the set onto which it is projected; infinite without a set."""
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
