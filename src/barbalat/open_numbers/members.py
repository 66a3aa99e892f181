"""Members of one structure and one set of signals: from rows of numbers to what the kernels are handed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product

import numpy as np

from barbalat.cases.build import Case
from barbalat.open_numbers.kernel_numbers import Family, Numbers
from barbalat.open_numbers.probe import DelayEffect, Effect, Kind, Tried, direct
from barbalat.open_numbers.varied import Varied
from barbalat.protocols import Signal
from barbalat.run.engine.judging import Terms, watched_in_sweeps
from barbalat.run.kernel.members import Members
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

MOST_CORNERS = 2**8
"""Cases that are made to see that a box of numbers is admitted: two seconds. Beyond eight numbers all are made into cases."""
MOST_KEPT = 20_000
"""Cases of which the numbers are kept for later members: some kilobytes each."""


@dataclass(eq=False)
class Setting:
    """All members with the same numbers where one kernel does not serve all values.

    A number that stands in every kernel as it is, or is the plant's delay, is put there directly, see ``probe.direct``: then no
    case is made for a member. What its constructors would have refused is still refused: the corners of the box in which the
    members lie are made into cases. That holds for the whole box, since what a constructor admits of such numbers is convex:
    limits, orders, known sets. And each corner's numbers must be those that are put there, bit by bit. Where a corner is refused
    every member is made into a case.

    base      (d,) numbers of an example
    families  of each controller
    copied    by column, how each controller's numbers follow directly
    """

    varied: Varied
    base: Array
    example: Case
    families: tuple[Family, ...]
    copied: dict[int, tuple[Effect | DelayEffect, ...]]
    numeric: tuple[int, ...] = ()
    admitted: Array | None = None  # (2, copied) the box whose corners were made
    made: dict[bytes, tuple[Numbers, ...]] = field(default_factory=dict)

    @classmethod
    def of(
        cls, varied: Varied, kinds: Sequence[Kind], tried: Tried, base: Array, *, windows: int = 0, judged: bool = False
    ) -> Setting:
        """``base`` has the numbers that are the same for all, in their columns; ``windows`` as of ``Members``.

        judged  whether the judge is beside all runs, by the case's own settings
        """
        numeric = [column for column, kind in enumerate(kinds) if kind.is_number]
        rows = {column: tried.rows(column, base) for column in numeric}
        cases = [varied.at(row) for row in (base, *(row for column in numeric for row in rows[column]))]
        example = cases[0]
        copied: dict[int, tuple[Effect | DelayEffect, ...]] = {}
        watched = watched_in_sweeps(example.judge) if judged else None
        families = tuple(
            Family.of(
                [(case.problem, case.controllers[i]) for case in cases], example.simulation, windows=windows, watched=watched
            )
            for i in range(len(example.controllers))
        )
        numbers = [family.numbers for family in families]
        begin = 1
        for column in numeric:
            which = np.array([0, *range(begin, begin + len(rows[column]))])
            begin += len(rows[column])
            values = np.array([base[column], *rows[column][:, column]])
            found = [direct(values, one.of(which), family) for one, family in zip(numbers, families, strict=True)]
            effects = tuple(one for one in found if one is not None)
            if len(effects) == len(numbers) and 2 ** (len(copied) + 1) <= MOST_CORNERS:
                copied[column] = effects
        return cls(varied, base, example, families, copied, tuple(numeric))

    @property
    def simulation(self) -> Simulation:
        return self.example.simulation

    @cached_property
    def terms(self) -> Terms:
        """What the members are judged by."""
        return Terms.of(self.example.problem, self.simulation, self.example.judge)

    @property
    def signals(self) -> tuple[Signal, ...]:
        return self.example.problem.signals

    def driven_by(self, base: Array, example: Case) -> Setting:
        """The setting with the signals of another example, which is the case with these numbers."""
        if (base == self.base).all():
            return self
        made = {base.tobytes(): self._made(self.base)} if self.numeric == () else {}
        return replace(self, base=base, example=example, made=made)

    def members(self, rows: Array, streams: Array) -> tuple[Members, ...]:
        """What each kernel is given; rows (M, d), streams of noise (M,). RefusedError for a member that makes no case."""
        numbers = self.numbers(rows)
        return tuple(family.given(one, streams) for family, one in zip(self.families, numbers, strict=True))

    def numbers(self, rows: Array) -> tuple[Numbers, ...]:
        """What the kernels are handed, of each controller."""
        if not self.numeric and (rows == self.base).all():
            return tuple(one.of(np.zeros(len(rows), dtype=int)) for one in self._made(self.base))
        columns = list(self.copied)
        others = [column for column in range(rows.shape[1]) if column not in self.copied]
        unique, which = np.unique(rows[:, others], axis=0, return_inverse=True)
        if not columns or 2 * len(unique) > len(rows) or not self._admits(rows[:, columns], unique, others):
            return self._all_made(rows)
        parts = [self._made(self._row(values, others)) for values in unique]
        found = tuple(Numbers.together(one).of(which.reshape(-1)) for one in zip(*parts, strict=True))
        self._put(found, rows)
        return found

    def _put(self, numbers: Sequence[Numbers], rows: Array) -> None:
        for column, places in self.copied.items():
            for place, one in zip(places, numbers, strict=True):
                place.put(one, rows[:, column])

    def _row(self, values: Array, columns: Sequence[int]) -> Array:
        row = self.base.copy()
        row[list(columns)] = values
        return row

    def _made(self, row: Array) -> tuple[Numbers, ...]:
        """The numbers of one row, by way of a case."""
        key = row.tobytes()
        if key not in self.made:
            if len(self.made) >= MOST_KEPT:
                self.made.clear()
            self.made[key] = _numbers(self.families, [self.varied.at(row)])
        return self.made[key]

    def _all_made(self, rows: Array) -> tuple[Numbers, ...]:
        cases = []
        for i, row in enumerate(rows):
            try:
                cases.append(self.varied.at(row))
            except InputError as error:
                raise RefusedError(i, error) from None
        return _numbers(self.families, cases)

    def _admits(self, values: Array, unique: Array, others: Sequence[int]) -> bool:
        """Whether the box around what is copied is known to be admitted, with each of the other numbers."""
        low, high = values.min(axis=0), values.max(axis=0)
        if self.admitted is None or (low < self.admitted[0]).any() or (high > self.admitted[1]).any():
            box = np.array([low, high])
            if self.admitted is not None:
                box = np.array([np.minimum(low, self.admitted[0]), np.maximum(high, self.admitted[1])])
            start = self._row(unique[0], others)
            if not all(self._as_copied(corner) for corner in self._corners(start, box)):
                return False
            self.admitted = box
        for one in unique:
            row = self._row(one, others)
            if row.tobytes() not in self.made and not all(self._as_copied(end) for end in self._ends(row)):
                return False
        return True

    def _corners(self, row: Array, box: Array) -> Iterator[Array]:
        for corner in product(*box.T):
            changed = row.copy()
            changed[list(self.copied)] = corner
            yield changed

    def _ends(self, row: Array) -> Iterator[Array]:
        """The row where all that is copied is the smallest, and where it is the largest."""
        assert self.admitted is not None
        for values in self.admitted:
            changed = row.copy()
            changed[list(self.copied)] = values
            yield changed

    def _as_copied(self, row: Array) -> bool:
        """Whether a member is admitted and its numbers are what copying makes of them."""
        try:
            exact = _numbers(self.families, [self.varied.at(row)])
        except InputError:
            return False
        others = [column for column in range(len(row)) if column not in self.copied]
        copies = tuple(one.of(np.array([0])) for one in self._made(self._row(row[others], others)))
        self._put(copies, row[None])
        return all(one.identical(other) for one, other in zip(copies, exact, strict=True))


class RefusedError(InputError):
    """A member that makes no case; ``place`` among those that were asked for."""

    def __init__(self, place: int, error: InputError) -> None:
        super().__init__(*error.sentences)
        self.place = place


def _numbers(families: Sequence[Family], cases: Sequence[Case]) -> tuple[Numbers, ...]:
    return tuple(family.read([case.member(i) for case in cases]) for i, family in enumerate(families))
