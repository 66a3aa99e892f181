"""Finds the effect of a number of a case on a run by trying different values; all commands use this routine.

A number may occur unchanged, bit for bit. Other numbers may follow from it: P from A_m, a filter's matrices from kappa, the
weights of a delay. It may affect only the signals, or a different value may require a different kernel or different steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import lru_cache
from math import inf
from typing import Protocol

import numpy as np

from barbalat.cases.build import Case
from barbalat.open_numbers.kernel_numbers import OTHER_STRUCTURE, ROUNDING, Family, Member, Numbers
from barbalat.open_numbers.numbers import SPECIAL_VALUES, At, Number
from barbalat.open_numbers.varied import Varied
from barbalat.run.kernel import delay
from barbalat.run.kernel.breaks import can_be_split
from barbalat.run.kernel.members import OtherRhythmError, Reader
from barbalat.run.kernel.template import Columns, StructureError, argument_numbers
from barbalat.solvers import Tableau
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError


class Kind(Enum):
    """The kind of effect that different values of a number have on a case."""

    STRUCTURE = "structure"
    """The effect of a number whose values need different kernels or different steps."""
    SIGNAL = "signal"
    """The effect of a number of the command or of a disturbance."""
    FOLLOWED = "followed"
    """The effect of a number from which other numbers of the same kernel follow."""
    COPIED = "copied"
    """The effect of a number that occurs unchanged, bit for bit, in the same kernel."""

    @property
    def is_number(self) -> bool:
        """Whether one kernel serves all values."""
        return self in (Kind.FOLLOWED, Kind.COPIED)


Rows = set[tuple[str, int]]
"""Arguments of a kernel: parameters, "p", and the initial state, "s"."""


@dataclass(frozen=True, eq=False)
class Effect:
    """The effect of one number on the arguments of one controller's kernel.

    parameters, states  rows (k,) that the number changes
    table               (K, rows) values of these rows for each value of the number, parameters first; None if they equal the
                        number
    """

    parameters: Array
    states: Array
    table: Array | None

    @classmethod
    def none(cls) -> Effect:
        return cls(np.zeros(0, dtype=int), np.zeros(0, dtype=int), None)

    @classmethod
    def of(cls, values: Array, numbers: Numbers) -> Effect | None:
        """The effect in members that differ only in this number, ``values`` (K,); None if delays or noise streams change."""
        apart = (numbers.lags, numbers.history, numbers.delays, numbers.seeds)
        if any(part is not None and (part != part[..., :1]).any() for part in apart):
            return None
        moved = [np.flatnonzero((part != part[:, :1]).any(axis=1)) for part in (numbers.parameters, numbers.states)]
        rows = np.concatenate([numbers.parameters[moved[0]], numbers.states[moved[1]]])
        return cls(moved[0], moved[1], None if (rows == values).all() else rows.T)

    @property
    def rows(self) -> Rows:
        return {("p", int(i)) for i in self.parameters} | {("s", int(i)) for i in self.states}

    @property
    def nothing(self) -> bool:
        return not len(self.parameters) and not len(self.states)

    @property
    def copied(self) -> bool:
        """Whether every changed row equals the number."""
        return self.table is None

    def put(self, numbers: Numbers, values: Array) -> None:
        """Insert values (M,) of a copied number; the arrays are modified."""
        numbers.parameters[self.parameters] = values
        numbers.states[self.states] = values


@dataclass(frozen=True, eq=False)
class DelayEffect:
    """The effect of a number that is only the plant's delay. The kernel's arguments follow from it without building an object.

    copied         rows of the kernel's parameters that equal the delay
    rows, entries  rows that are weights, and their indices among all weights; ``first`` contains all weights (w,)
    """

    simulation: Simulation
    copied: Array
    rows: Array
    entries: Array
    first: Array

    @classmethod
    def of(cls, values: Array, numbers: Numbers, family: Family) -> DelayEffect | None:
        """The effect in members that differ only in this number, ``values`` (K,); None if anything else follows from it."""
        if numbers.lags is None or (numbers.delays != values).any():
            return None
        rows, entries = family.weights
        moved = np.flatnonzero((numbers.parameters != numbers.parameters[:, :1]).any(axis=1))
        copied = np.setdiff1d(moved, rows)
        apart = (numbers.states, numbers.history, numbers.seeds)
        if (numbers.parameters[copied] != values).any() or any(
            part is not None and (part != part[..., :1]).any() for part in apart
        ):
            return None
        simulation = family.reader.simulation
        first = delay.weights(float(values[0]), simulation.dt, simulation.solver, fused=simulation.fused).reshape(-1)
        return cls(simulation, copied, rows, entries, first)

    def put(self, numbers: Numbers, values: Array) -> None:
        """Insert the effects of delays ``values`` (M,); the arrays are modified. Raises InputError for a different structure."""
        assert numbers.lags is not None
        lags, weights = _delayed(values.tobytes(), self.simulation.dt, self.simulation.solver, self.simulation.fused)
        others = np.delete(np.arange(self.first.size), self.entries)
        if (np.abs(weights[others] - self.first[others, None]) > ROUNDING).any():  # the largest weight is about 1
            raise InputError(OTHER_STRUCTURE)
        numbers.parameters[self.rows] = weights[self.entries]
        numbers.parameters[self.copied] = numbers.delays[:] = values
        numbers.lags[:] = lags


@lru_cache(maxsize=1)  # cached, because successive controllers share them
def _delayed(values: bytes, dt: float, solver: Tableau, fused: bool) -> tuple[Array, Array]:
    """Lags (M,) and weights (w, M) of delays [s]."""
    delays = np.frombuffer(values).tolist()
    weights = [delay.weights(one, dt, solver, fused=fused).reshape(-1) for one in delays]
    return np.array([delay.lag(one, dt) for one in delays]), np.column_stack(weights)


def direct(values: Array, numbers: Numbers, family: Family) -> Effect | DelayEffect | None:
    """How the kernel's arguments follow from a number without building an object; None if objects must be built.

    ``numbers`` come from members that differ only in this number, which takes the ``values`` (K,).
    """
    effect = Effect.of(values, numbers)
    return effect if effect is not None and effect.copied else DelayEffect.of(values, numbers, family)


def examined(members: Sequence[Member], values: Array, simulation: Simulation) -> tuple[Effect | None, Family]:
    """The effect of the number in which these members differ, and the kernel that serves all of them.

    The effect is None if delays or noise change. Raises StructureError if no kernel serves all members, and InputError if a
    member can't be used.
    """
    family = Family.of(members, simulation)
    return Effect.of(values, family.numbers), family


@dataclass(frozen=True, eq=False)
class Tried:
    """Values of the varied numbers: the ``middle`` (d,) of all, and some other values of each in ``around``."""

    middle: Array
    around: tuple[Array, ...]

    def rows(self, column: int, base: Array) -> Array:
        """(K, d) the base with each of the other values of one column."""
        rows = np.repeat(base[None], len(self.around[column]), axis=0)
        rows[:, column] = self.around[column]
        return rows


def kinds_of(varied: Varied, tried: Tried) -> tuple[Kind, ...]:
    """The kind of the number at each path; raises InputError if a value that was tried gives no valid case."""
    base = varied.at(tried.middle)
    found = []
    for column in range(len(varied.paths)):
        rows = tried.rows(column, tried.middle)
        found.append(kind_of(base, [varied.at(row) for row in rows], np.array([tried.middle[column], *rows[:, column]])))
    return tuple(found)


def kind_of(base: Case, cases: Sequence[Case], values: Array) -> Kind:
    """The kind of the number in which the cases differ from the base; ``values`` (1 + K,) contains the value in the base,
    followed by the values in the cases."""
    if any(case.simulation != base.simulation for case in cases):
        return Kind.STRUCTURE
    if any(len(case.controllers) != len(base.controllers) for case in cases):
        raise InputError("a sweep cannot vary the controllers of a case")
    families = []
    for i, controller in enumerate(base.controllers):
        try:
            families.append(_read((base.problem, controller), [case.member(i) for case in cases], base.simulation))
        except (StructureError, OtherRhythmError):
            return Kind.STRUCTURE
    if all(case.problem.signals == base.problem.signals for case in cases):
        effects = [Effect.of(values, family.numbers) for family in families]
        return Kind.COPIED if all(effect is not None and effect.copied for effect in effects) else Kind.FOLLOWED
    split = {can_be_split(case.problem.signals, case.simulation) for case in (base, *cases)}
    return Kind.SIGNAL if len(split) == 1 and not any(map(_moves, families)) else Kind.STRUCTURE


def _read(base: Member, others: Sequence[Member], simulation: Simulation) -> Family:
    """One kernel for all of these members, which may have any signals."""
    reader = Reader.of(base, simulation, adjustable=False)
    for member in others:
        reader.take(*member)
    return Family(reader, reader.arguments())


def _moves(family: Family) -> bool:
    """Whether the kernel of the first member would have different arguments, beyond rounding, for one of the others."""
    reader = family.reader
    own = argument_numbers(Columns(reader.columns.first), opened=not reader.simulation.fused)
    try:
        numbers = replace(family, differs=own, rounding=ROUNDING).numbers
    except StructureError:
        return True
    first = numbers.of(np.array([0]))
    return not all(numbers.of(np.array([k])).rounded_alike(first) for k in range(1, reader.columns.count))


FEWER_VALUES = 20
"""Number of values for sliders that share rows with other sliders. There may be many such sliders, each with a table."""


class Readable(Protocol):
    """Anything that reads numbers from a case."""

    def read(self, cases: Sequence[Case]) -> Numbers:
        """The numbers for each of these cases; raises InputError if one has a different structure."""
        ...


@dataclass(frozen=True, eq=False)
class Target:
    """A controller of the case with the kernel of its module."""

    index: int
    family: Family
    base: Numbers

    @classmethod
    def of(cls, case: Case, index: int, simulation: Simulation) -> Target:
        member = (case.problem, case.controllers[index])
        family = Family.of([member], simulation)
        return cls(index, family, family.read([member]))

    def read(self, cases: Sequence[Case]) -> Numbers:
        """The arguments for each of these cases; raises InputError if one has a different structure."""
        return self.family.read([case.member(self.index) for case in cases])


def effects_of(
    number: Number,
    targets: Sequence[Readable],
    taken: Sequence[Rows],
    at: At,
    room: float = inf,
    like: Sequence[Effect] | None = None,
) -> tuple[Number, list[Effect]] | None:
    """The effects on every target, and the values for which all targets keep their structure; None if a page can't reproduce the
    number.

    For a number that changes a row which is already taken, fewer values are tabulated, in at most ``room`` bytes.

    A number that is passed on unchanged does not need a case for each value, because the admissible set of such numbers is
    convex, and its ends and some values in between were accepted. Only SPECIAL values may change a structure: zeros of matrices
    determine which states are coupled, and a kernel does not multiply by an input gain of 1.

    taken  rows of each target that other numbers change
    like   the effects on kernels that differ from the targets in their projection. If both have the same numbers at the tried
           values, they are equal in general, as for every number that the projection does not use
    """
    few = number.tried
    found = _made(number, few, targets, at)
    if found is None:
        return None
    left_out = set(few.tolist()) - set(found[0].tolist())
    if all(effect.table is None for effect in found[1]) and left_out <= set(SPECIAL_VALUES):
        values = number.values[~np.isin(number.values, list(left_out))]
        return replace(number, values=values, without=(*number.without, *sorted(left_out))), found[1]
    if like is not None and not left_out.intersection(number.values.tolist()):
        same = [_as(known, effect, found[0], number) for known, effect in zip(like, found[1], strict=True)]
        if all(effect is not None for effect in same):
            return number, [effect for effect in same if effect is not None]
    shared = any(effect.rows & rows for effect, rows in zip(found[1], taken, strict=True))
    if shared and number.values.itemsize * FEWER_VALUES * sum(len(effect.rows) for effect in found[1]) > room:
        return None
    found = _made(number, thinned(number).values if shared else number.values, targets, at)
    return None if found is None else (replace(number, values=found[0]), found[1])


def _as(known: Effect, effect: Effect, tried: Array, number: Number) -> Effect | None:
    """The effect with the whole table of a known effect, if both have the same numbers at the tried values."""
    if known.table is None or effect.table is None:
        return effect if known.table is None and effect.table is None else None
    among = np.isin(tried, number.values)
    places = np.searchsorted(number.values, tried[among])
    if known.table[places].tobytes() != effect.table[among].tobytes():
        return None
    return replace(effect, table=known.table)


def thinned(number: Number) -> Number:
    """The number with some of its values, including the present one."""
    own = int(np.searchsorted(number.values, number.value))
    every = max(1, len(number.values) // FEWER_VALUES)
    return replace(number, values=number.values[own % every :: every])


def _made(number: Number, values: Array, targets: Sequence[Readable], at: At) -> tuple[Array, list[Effect]] | None:
    """The values at which all targets keep their structure, and the effects; None if the value in the case is not among them."""
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
    effects = [Effect.of(np.array(kept), one) for one in made]
    return None if any(one is None for one in effects) else (np.array(kept), [one for one in effects if one is not None])


def _admitted(number: Number, values: Array, at: At) -> tuple[list[float], list[Case]]:
    """The values that give a valid case, and these cases."""
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


def composed(target: Target, moved: Sequence[tuple[Effect, float, int]]) -> tuple[Array, Array]:
    """Parameters and states as a page combines them, from the value of each changed number and its index among all values."""
    parameters, states = target.base.parameters[:, 0].copy(), target.base.states[:, 0].copy()
    for effect, value, place in moved:
        rows = np.full(len(effect.rows), value) if effect.table is None else effect.table[place]
        parameters[effect.parameters] = rows[: len(effect.parameters)]
        states[effect.states] = rows[len(effect.parameters) :]
    return parameters, states
