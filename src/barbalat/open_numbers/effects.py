"""What a number of the case does to what a module is handed: found by trying it, so that no list of fields has to be kept.

Either it stands there as it is, to the last bit, or the numbers that follow from it are computed here by the case's own
constructors, for every value that its slider has: a page computes nothing of the kind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Protocol

import numpy as np

from barbalat.cases.build import Case
from barbalat.open_numbers.kernel_numbers import Family, Numbers
from barbalat.open_numbers.slider_values import At, Number
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

Rows = set[tuple[str, int]]
"""Of a module's parameters, "p", and of its initial state, "s"."""


@dataclass(frozen=True, eq=False)
class Effect:
    """Of one number on one controller's module, or on its signals.

    parameters, states  rows (k,) that it moves
    table               (K, rows) what they are at each of its values, parameters first; None where they are the number itself
    """

    parameters: Array
    states: Array
    table: Array | None

    @classmethod
    def none(cls) -> Effect:
        return cls(np.zeros(0, dtype=int), np.zeros(0, dtype=int), None)

    @property
    def rows(self) -> Rows:
        return {("p", int(i)) for i in self.parameters} | {("s", int(i)) for i in self.states}

    @property
    def nothing(self) -> bool:
        return not len(self.parameters) and not len(self.states)


SPECIAL_VALUES = (-1.0, 0.0, 1.0)
"""Values that a structure may depend on."""
FEWER_VALUES = 20
"""Of a slider that excludes others: there may be many of them, and each has a table."""


class Readable(Protocol):
    """What takes numbers that follow from a case."""

    def read(self, cases: Sequence[Case]) -> Numbers:
        """For each of these cases; InputError where one has another structure."""
        ...


@dataclass(frozen=True, eq=False)
class Target:
    """One controller of the case with the kernel that its module is."""

    index: int
    family: Family
    base: Numbers

    @classmethod
    def of(cls, case: Case, index: int, simulation: Simulation) -> Target:
        member = (case.problem, case.controllers[index])
        family = Family.of([member], simulation)
        return cls(index, family, family.read([member]))

    def read(self, cases: Sequence[Case]) -> Numbers:
        """What it is handed for each of these cases; InputError where one has another structure."""
        return self.family.read([(case.problem, case.controllers[self.index]) for case in cases])


def effects_of(
    number: Number, targets: Sequence[Readable], taken: Sequence[Rows], at: At, room: float = inf
) -> tuple[Number, list[Effect]] | None:
    """On every target, of the values at which all have their structure; None where a page can't follow it.

    Of a number that moves a row that is taken fewer values are tabulated, in no more than ``room`` bytes.

    What is handed on as it is needs no case for each value: what constructors take of such numbers is convex, and its ends and
    some values between were taken. Only SPECIAL ones may change a structure: a matrix's zero says what a state acts on at all,
    and where an input's gain is 1 no kernel multiplies by it.

    taken  rows of each target that other numbers move
    """
    few = _tried(number)
    found = _made(number, few, targets, at)
    if found is None:
        return None
    left_out = set(few.tolist()) - set(found[0].tolist())
    if all(effect.table is None for effect in found[1]) and left_out <= set(SPECIAL_VALUES):
        values = number.values[~np.isin(number.values, list(left_out))]
        return replace(number, values=values, without=(*number.without, *sorted(left_out))), found[1]
    shared = any(effect.rows & rows for effect, rows in zip(found[1], taken, strict=True))
    if shared and number.values.itemsize * FEWER_VALUES * sum(len(effect.rows) for effect in found[1]) > room:
        return None
    found = _made(number, thinned(number).values if shared else number.values, targets, at)
    return None if found is None else (replace(number, values=found[0]), found[1])


def thinned(number: Number) -> Number:
    """With some of its values, its own among them."""
    own = int(np.searchsorted(number.values, number.value))
    every = max(1, len(number.values) // FEWER_VALUES)
    return replace(number, values=number.values[own % every :: every])


def _tried(number: Number) -> Array:
    values, last = number.values, len(number.values) - 1
    special = [value for value in SPECIAL_VALUES if values[0] <= value <= values[last] and value not in number.without]
    return np.unique([number.value, *values[[0, last // 5, last // 2, last]], *special])


def _made(number: Number, values: Array, targets: Sequence[Readable], at: At) -> tuple[Array, list[Effect]] | None:
    """The values at which all targets have their structure, and the effects; None where the case's own is not among them."""
    kept, cases = _admitted(number, values, at)
    if number.value not in kept or len(kept) < 2:
        return None
    try:
        made = [target.read(cases) for target in targets]
    except InputError:
        fitting = [i for i, case in enumerate(cases) if _fits(targets, case)]
        kept, cases = [kept[i] for i in fitting], [cases[i] for i in fitting]
        if number.value not in kept or len(kept) < 2:
            return None
        made = [target.read(cases) for target in targets]
    if not all(map(_same_apart, made)):
        return None
    return np.array(kept), [_effect(np.array(kept), one) for one in made]


def _admitted(number: Number, values: Array, at: At) -> tuple[list[float], list[Case]]:
    """The values of which a case can be made, and the cases."""
    kept, cases = [], []
    for value in values.tolist():
        try:
            cases.append(at(number.path, value))
        except InputError:
            continue
        kept.append(value)
    return kept, cases


def _fits(targets: Sequence[Readable], case: Case) -> bool:
    try:
        for target in targets:
            target.read([case])
    except InputError:
        return False
    return True


def _same_apart(made: Numbers) -> bool:
    """Whether nothing moves that is no row: delays, streams of noise."""
    apart = (made.lags, made.history, made.delays, made.seeds)
    return all(part is None or bool((part == part[..., :1]).all()) for part in apart)


def _effect(values: Array, made: Numbers) -> Effect:
    moved = [np.flatnonzero((part != part[:, :1]).any(axis=1)) for part in (made.parameters, made.states)]
    rows = np.concatenate([made.parameters[moved[0]], made.states[moved[1]]])
    return Effect(moved[0], moved[1], None if (rows == values).all() else rows.T)


def composed(target: Target, moved: Sequence[tuple[Effect, float, int]]) -> tuple[Array, Array]:
    """Parameters and states as a page puts them together, of each moved number's value and its place among all of them."""
    parameters, states = target.base.parameters[:, 0].copy(), target.base.states[:, 0].copy()
    for effect, value, place in moved:
        rows = np.full(len(effect.rows), value) if effect.table is None else effect.table[place]
        parameters[effect.parameters] = rows[: len(effect.parameters)]
        states[effect.states] = rows[len(effect.parameters) :]
    return parameters, states
