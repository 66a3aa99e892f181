"""The neighbourhood of a case: the numbers that can be changed slightly, and how each changes the arguments of the kernel.

A number may be an argument. Others follow from it (P from Q, the matrices of a filter from kappa) through constructors that are
not traced. Their derivatives are central differences of the derived numbers alone, which need no simulation.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from barbalat import validate
from barbalat.cases.build import Case
from barbalat.cases.load import CaseText
from barbalat.open_numbers.kernel_numbers import Numbers, alike
from barbalat.open_numbers.members import Setting
from barbalat.open_numbers.numbers import in_case, in_tables
from barbalat.open_numbers.path import FieldPath
from barbalat.open_numbers.probe import Effect, Kind, Tried, kind_of
from barbalat.open_numbers.truth_paths import is_parameter
from barbalat.open_numbers.varied import Varied, VariedCase, VariedObjects, tables_with
from barbalat.protocols import BreakingSignal, Controller
from barbalat.run.engine.tangent_run import Direction, Signals, SignalSlope
from barbalat.run.kernel import delay
from barbalat.study.fixed_steps import fixed_steps
from barbalat.validate import Array, InputError

SHARES = (1e-3, 1e-4, 1e-5)
"""The steps of the differences to either side, as fractions of the scale of a number. The first two steps also differentiate
derived numbers; their second-order errors cancel between the two."""
SMOOTH_WITHIN = 1e-2
"""Largest relative difference between the slopes of derived numbers from the first two steps; beyond it, they have no slope."""
NOT_OF_A_RUN = ("simulation", "judge", "specification", "shell", "faults", "labels")
"""Tables without numbers of the loop."""


@dataclass(frozen=True, kw_only=True)
class Movable:
    """A number with a neighbourhood of admissible values that share one kernel.

    scale     the size to which steps are relative: the magnitude of the number or, for a zero, the largest magnitude in its
              vector, or else one
    relative  whether steps are relative to each value instead, as for a number that varies over decades
    """

    path: FieldPath
    value: float
    scale: float
    kind: Kind
    relative: bool = False


class NoSlope(InputError):
    """Raised where the numbers that follow from a number have no slope, as for a delay that is a multiple of the step."""

    def __init__(self, path: FieldPath) -> None:
        super().__init__(f"{path}: {NO_SLOPE}")
        self.path = path


NO_SLOPE = "the quantities that follow from it are not differentiable here"


@dataclass(frozen=True)
class Unmovable:
    """A number without derivatives, and the reason; ``invalid`` if constructors reject neighbouring values."""

    path: FieldPath
    why: str
    invalid: bool = False


def in_steps(source: CaseText | Case, controllers: Sequence[Controller]) -> tuple[CaseText | Case, str | None]:
    """The case with fixed steps, and a sentence on how they were found from its tolerance; None if they are its own.

    Derivatives are those of a discrete run. Variable steps are chosen in each run, and tangents do not see the choice; fixed
    steps are the same in all runs.
    """
    own = source if isinstance(source, Case) else source.case()
    found = fixed_steps(own.problem, controllers, own.simulation)
    if found.sentence is None:
        return source, None
    fixed = replace(source, simulation=found.simulation) if isinstance(source, Case) else replace(source, dt=found.simulation.dt)
    return fixed, found.sentence


def varied_of(source: CaseText | Case, paths: Sequence[FieldPath], *, redesign: bool) -> Varied:
    """The case in which these numbers may vary."""
    if isinstance(source, Case):
        return VariedObjects(source, tuple(paths), redesign)
    return VariedCase(source, tuple(paths), redesign=redesign)


def numbers_of(source: CaseText | Case, paths: Sequence[FieldPath] = ()) -> dict[FieldPath, float]:
    """The numbers of the case keyed by path. If ``paths`` contain entries of theta, these are included for a plant given by A."""
    if isinstance(source, Case):
        return {path: float(value) for path, value in in_case(source)}
    return {path: float(value) for path, value in in_tables(tables_with(source, paths))}


def own_numbers(source: CaseText | Case) -> list[FieldPath]:
    """The numbers of the loop that are not zero, because a zero cannot change by a percentage."""
    return [path for path, value in numbers_of(source).items() if value != 0 and path.keys[0] not in NOT_OF_A_RUN]


def examined(source: CaseText | Case, path: FieldPath, *, redesign: bool) -> Movable | Unmovable:
    """Whether a number can be moved, found by moving it."""
    try:
        known = numbers_of(source, [path])
        varied = varied_of(source, [path], redesign=redesign)
        value = _value(known, path)
        assert value is not None  # see ``require_given``
        scale = abs(value) or _scale(known, path)
        values = value + scale * np.array([0.0, *(sign * share for share in SHARES for sign in (1, -1))])
        base, *cases = [varied.at([one]) for one in values]
        if any(_breaks(case) != _breaks(base) for case in cases):
            return Unmovable(path, "it moves the instants at which a signal jumps or bends, and a jump has no tangent")
        kind = kind_of(base, cases, values)
    except InputError as error:
        return Unmovable(path, f"neighbouring values are rejected: {error}", invalid=True)
    if kind is Kind.STRUCTURE:
        return Unmovable(path, "a different value needs a different kernel, different steps or a different structure")
    if len({_lag(case) for case in (base, *cases)}) > 1:
        dt = base.simulation.dt
        return Unmovable(path, f"the delay crosses a multiple of simulation.dt = {dt:g} s, where its interpolation has a corner")
    return Movable(path=path, value=float(value), scale=float(scale), kind=kind)


def require_given(source: CaseText | Case, paths: Sequence[FieldPath]) -> None:
    """Raise InputError for a path that does not lead to a number of the case."""
    known = numbers_of(source, paths)
    for path in paths:
        if _value(known, path) is None:
            raise _not_given(path, known)


def _not_given(path: FieldPath, known: Mapping[FieldPath, float]) -> InputError:
    """The error for a path that leads to several numbers, which it names, or to none, with the closest path or the tables."""
    depth = len(path.keys)
    if within := [str(one) for one in known if one.keys[:depth] == path.keys]:
        listed = ", ".join(within[:MOST_NAMED]) + (", ..." if len(within) > MOST_NAMED else "")
        return InputError(f"{path} is not a single number; name one of {listed}")
    if near := validate.hint(str(path), map(str, known)):
        return InputError(f"the case does not give {path}{near}")
    tables = dict.fromkeys(str(FieldPath(one.keys[: 1 + isinstance(one.keys[1], int)])) for one in known if len(one.keys) > 1)
    if path.keys[0] in {one.keys[0] for one in known}:
        return InputError(f"the case does not give {path}: write it into the case first")
    return InputError(f"the case does not give {path}; its numbers are in {', '.join(tables)}")


MOST_NAMED = 8
"""The largest number of paths that an error lists."""


def _value(known: dict[FieldPath, float], path: FieldPath) -> float | None:
    """The number at a path; for a physical parameter, the value in the truth if that has one."""
    if path not in known and is_parameter(path):
        return known.get(FieldPath(("truth", *path.keys)))
    return known.get(path)


def _scale(known: dict[FieldPath, float], path: FieldPath) -> float:
    """The scale of a zero: the largest magnitude in its vector, or one."""
    return max((abs(value) for one, value in known.items() if one.vector == path.vector), default=0.0) or 1.0


def _lag(case: Case) -> int:
    delayed = case.problem.delay
    return delay.whole_steps(delayed, case.simulation.dt) if delayed else 0


def _breaks(case: Case) -> list[list[float]]:
    """The instants at which each signal breaks."""
    t_end = case.simulation.t_end
    return [one.breaks(0.0, t_end).tolist() if isinstance(one, BreakingSignal) else [] for one in case.problem.signals]


@dataclass(frozen=True, eq=False)
class Neighbourhood:
    """The numbers that vary, and the kernels that serve all their values near the case and within the given ends.

    base  (d,) the values in the case
    """

    varied: Varied
    moved: tuple[Movable, ...]
    setting: Setting
    base: Array

    @classmethod
    def of(
        cls,
        source: CaseText | Case,
        moved: Sequence[Movable],
        *,
        redesign: bool,
        ends: Sequence[tuple[float, float]] | None = None,
    ) -> Neighbourhood:
        """The ``ends`` of all numbers extend the range of values for which the kernels are made."""
        varied = varied_of(source, [one.path for one in moved], redesign=redesign)
        base = np.array([one.value for one in moved])
        around = []
        for i, one in enumerate(moved):
            near = [one.value + sign * share * one.scale for share in SHARES for sign in (1, -1)]
            if ends is not None:  # values next to the case may be outside the ends
                low, high = ends[i]
                near = [low, (low + high) / 2, high]
            around.append(np.array([value for value in near if value != one.value]))
        tried = Tried(base, tuple(around))
        return cls(varied, tuple(moved), Setting.of(varied, [one.kind for one in moved], tried, base), base)

    @property
    def case(self) -> Case:
        return self.setting.example

    @property
    def numeric(self) -> list[int]:
        """The columns whose numbers are arguments of the kernel; the others change signals."""
        return [i for i, one in enumerate(self.moved) if one.kind.is_number]

    def stepped(self, rows: Array, column: int, share: float) -> tuple[Array, Array]:
        """Rows (M, d) with one number increased, or decreased, by this fraction of its scale."""
        above, below, step = rows.copy(), rows.copy(), self._step(rows, column, share)
        above[:, column] += step
        below[:, column] -= step
        return above, below

    def _step(self, rows: Array, column: int, share: float) -> Array:
        """(M,) the step of a number at each row."""
        one = self.moved[column]
        return share * np.abs(rows[:, column]) if one.relative else np.full(len(rows), share * one.scale)

    def directions(self, rows: Array, bounds: Array | None = None) -> list[list[Direction]]:
        """The direction of each number, for each controller and for members with the numbers ``rows`` (M, d).

        bounds  (2, d) the ends between which derived numbers are computed; near an end, the slope is taken one step inside

        Raises InputError for a number from which others do not follow smoothly.
        """
        count, own = len(rows), self.setting.numbers(rows)
        zeros = [Direction(np.zeros_like(one.parameters), np.zeros_like(one.states), _no_history(one)) for one in own]
        found: list[list[Direction]] = [[] for _ in own]
        for column, one in enumerate(self.moved):
            effects = self.setting.copied.get(column, ())
            if one.kind is Kind.SIGNAL:
                slope = self._signal_slope(column)
                directions = [Direction(zero.parameters, zero.states, zero.history, slope) for zero in zeros]
            elif len(copies := [effect for effect in effects if isinstance(effect, Effect)]) == len(own):
                directions = [_along(effect, zero, count) for effect, zero in zip(copies, zeros, strict=True)]
            else:
                directions = list(self._followed(rows, column, bounds))
            for places, direction in zip(found, directions, strict=True):
                places.append(direction)
        return found

    def _followed(self, rows: Array, column: int, bounds: Array | None) -> Iterator[Direction]:
        """The slopes of the kernel's arguments that follow from a number."""
        center = rows.copy()
        if bounds is not None:
            room = self._step(rows, column, max(SHARES))
            low, high = bounds[0, column] + room, bounds[1, column] - room
            center[:, column] = np.where(low < high, np.clip(rows[:, column], low, np.maximum(low, high)), (low + high) / 2)
        coarse, fine = (self.stepped(center, column, share) for share in SHARES[:2])
        many, count = np.vstack([*coarse, *fine]), len(rows)
        for numbers in self.setting.numbers(many):
            each = [numbers.of(np.arange(i * count, (i + 1) * count)) for i in range(4)]
            widths = [(above - below)[:, column] for above, below in (coarse, fine)]
            yield Direction(
                self._slope([one.parameters for one in each], widths, column),
                self._slope([one.states for one in each], widths, column),
                None if numbers.history is None else self._slope([_history(one) for one in each], widths, column),
            )

    def _slope(self, values: Sequence[Array], widths: Sequence[Array], column: int) -> Array:
        """The slope from values at two steps above and below, whose leading errors cancel."""
        coarse, fine = (values[0] - values[1]) / widths[0], (values[2] - values[3]) / widths[1]
        still = np.all([alike(values[0], one) for one in values[1:]], axis=0)  # they do not depend on this number
        coarse, fine = np.where(still, 0.0, coarse), np.where(still, 0.0, fine)
        size = np.abs(fine).max(axis=0, initial=0.0)
        if not (np.abs(coarse - fine).max(axis=0, initial=0.0) <= SMOOTH_WITHIN * size + np.finfo(float).tiny).all():
            raise NoSlope(self.moved[column].path)
        ratio = (SHARES[0] / SHARES[1]) ** 2
        return np.asarray((ratio * fine - coarse) / (ratio - 1))

    def _signal_slope(self, column: int) -> SignalSlope:
        ratio = (SHARES[0] / SHARES[1]) ** 2
        pairs: list[tuple[Signals, Signals, float]] = []
        for share, weight in ((SHARES[1], ratio / (ratio - 1)), (SHARES[0], -1 / (ratio - 1))):
            (above,), (below,) = self.stepped(self.base[None], column, share)
            one, other = (self.varied.at(row).problem.signals for row in (above, below))
            pairs.append((one, other, weight / float(above[column] - below[column])))
        return SignalSlope(tuple(pairs))


def _along(effect: Effect, zero: Direction, count: int) -> Direction:
    """The direction of a number that is an argument of the kernel."""
    parameters, states = zero.parameters.copy(), zero.states.copy()
    effect_of = Numbers(parameters, states, None, None, np.zeros(count), None)
    effect.put(effect_of, np.ones(count))
    return Direction(parameters, states, zero.history)


def _no_history(numbers: Numbers) -> Array | None:
    return None if numbers.history is None else np.zeros_like(numbers.history, dtype=float)


def _history(numbers: Numbers) -> Array:
    assert numbers.history is not None
    return numbers.history


def traced(source: CaseText | Case, one: Movable, which: Sequence[int], *, redesign: bool) -> Movable | Unmovable:
    """Whether the code of controllers from outside the package accepts a symbol in place of this number."""
    try:
        near = Neighbourhood.of(source, [one], redesign=redesign)
        for i in which:
            _ = near.setting.families[i].members
    except InputError as error:
        return Unmovable(one.path, f"{error}")
    return one
