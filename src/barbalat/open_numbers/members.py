"""Members of one structure and one set of signals: from rows of numbers to the arguments of kernels."""

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
"""Largest number of cases that are built to verify that a box of numbers is admissible; building them takes two seconds. With
more than eight numbers, a case is built for every member."""
MOST_KEPT = 20_000
"""Largest number of cases whose numbers are cached for later members; each takes a few kilobytes."""


@dataclass(eq=False)
class Setting:
    """All members that agree in the numbers whose change requires a different kernel.

    A number that occurs unchanged in every kernel, or is the delay of the plant, is inserted directly (see ``probe.direct``), and
    no case is built for a member. Values that constructors would reject are still rejected, because a case is built for each
    corner of the box that contains the members. This is valid for the whole box, because the admissible set of such numbers is
    convex: limits, orders, known sets. Each corner's numbers must also equal the inserted ones, bit for bit. If a corner is
    rejected, a case is built for every member.

    base      (d,) numbers of an example
    families  families of each controller
    copied    how the numbers of each controller follow directly, by column
    """

    varied: Varied
    base: Array
    example: Case
    families: tuple[Family, ...]
    copied: dict[int, tuple[Effect | DelayEffect, ...]]
    numeric: tuple[int, ...] = ()
    admitted: Array | None = None  # (2, copied) the box at whose corners cases were built
    made: dict[bytes, tuple[Numbers, ...]] = field(default_factory=dict)

    @classmethod
    def of(
        cls, varied: Varied, kinds: Sequence[Kind], tried: Tried, base: Array, *, windows: int = 0, judged: bool = False
    ) -> Setting:
        """``base`` contains, in their columns, the numbers that are the same for all members; for ``windows``, see ``Members``.

        judged  whether all runs are judged, by the settings of the case
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
        """The data for judging the members."""
        return Terms.of(self.example.problem, self.simulation, self.example.judge)

    @property
    def signals(self) -> tuple[Signal, ...]:
        return self.example.problem.signals

    def driven_by(self, base: Array, example: Case) -> Setting:
        """This setting with the signals of a different example: the case with these numbers."""
        if (base == self.base).all():
            return self
        made = {base.tobytes(): self._made(self.base)} if self.numeric == () else {}
        return replace(self, base=base, example=example, made=made)

    def members(self, rows: Array, streams: Array) -> tuple[Members, ...]:
        """The arguments of each kernel, for rows (M, d) and noise streams (M,). Raises RefusedError for a member that gives no
        valid case."""
        numbers = self.numbers(rows)
        found = (family.given(one, streams) for family, one in zip(self.families, numbers, strict=True))
        return tuple(one.driven_by(self.signals) for one in found)

    def numbers(self, rows: Array) -> tuple[Numbers, ...]:
        """The arguments of the kernels, for each controller."""
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
        """The numbers of one row, from a case that is built."""
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
        """Whether the box around the copied numbers is known to be admissible for each combination of the other numbers."""
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
        """The rows with all copied numbers at their minima and at their maxima."""
        assert self.admitted is not None
        for values in self.admitted:
            changed = row.copy()
            changed[list(self.copied)] = values
            yield changed

    def _as_copied(self, row: Array) -> bool:
        """Whether a member is admissible and its numbers equal the copied ones."""
        try:
            exact = _numbers(self.families, [self.varied.at(row)])
        except InputError:
            return False
        others = [column for column in range(len(row)) if column not in self.copied]
        copies = tuple(one.of(np.array([0])) for one in self._made(self._row(row[others], others)))
        self._put(copies, row[None])
        return all(one.identical(other) for one, other in zip(copies, exact, strict=True))


class RefusedError(InputError):
    """A member that gives no valid case; ``place`` is its index among the requested members."""

    def __init__(self, place: int, error: InputError) -> None:
        super().__init__(*error.sentences)
        self.place = place


def _numbers(families: Sequence[Family], cases: Sequence[Case]) -> tuple[Numbers, ...]:
    return tuple(family.read([case.member(i) for case in cases]) for i, family in enumerate(families))
