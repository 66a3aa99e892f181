"""The arguments of a kernel for many members of one structure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from barbalat.judge.appended import Watched
from barbalat.run.kernel.members import Members, Reader
from barbalat.run.kernel.template import StructureError
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

Member = tuple[Any, ...]
"""A problem, a controller and, if known, the controller's equations for the problem (see ``Case.member``)."""


OTHER_STRUCTURE = (
    "members must have the structure of the first one, and may differ only in the numbers that varied in a few trials. Narrow "
    "the range, or sweep its parts one by one. A delay must be 0 in all members, or at least one solver step in all"
)
ROUNDING = 1e-9
"""Fraction of the largest number of an array. A number may differ by at most this in some member although no tried value changed
it. It is then the same number computed by different operations, such as an A_m that follows from a varied A, and every member
uses the number of the first."""


@dataclass(frozen=True, eq=False)
class Numbers:
    """The arguments of kernels of one structure for M members; all arrays have the members' axis last.

    parameters (p, M), states (size, M); lags (M,), history (m, M) and delays (M,) [s] with a delay; seeds (M,) with noise
    """

    parameters: Array
    states: Array
    lags: Array | None
    history: Array | None
    delays: Array
    seeds: Array | None

    def of(self, which: Array) -> Numbers:
        """The numbers of selected members, which may be repeated."""
        return Numbers(*(None if part is None else part[..., which] for part in vars(self).values()))

    def identical(self, other: Numbers) -> bool:
        """Whether all bits agree."""
        return all(
            one is two or (one is not None and two is not None and one.tobytes() == two.tobytes())
            for one, two in zip(vars(self).values(), vars(other).values(), strict=True)
        )

    def rounded_alike(self, other: Numbers) -> bool:
        """Whether all numbers are the same up to the rounding of their computation."""
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return all(one is two or (one is not None and two is not None and bool(alike(one, two).all())) for one, two in pairs)

    @classmethod
    def together(cls, parts: Sequence[Numbers]) -> Numbers:
        """The numbers of the members of all parts."""
        columns = zip(*(vars(part).values() for part in parts), strict=True)
        return cls(*(None if found[0] is None else np.concatenate(found, axis=-1) for found in columns))


def alike(one: Array, two: Array) -> Array:
    """Which numbers are equal up to ROUNDING of their own size, or up to a few roundings of the array's largest number.

    A known set that follows from ranges is rounded outward, to 10 digits, so that equal sets may differ by 1e-10 of their size.
    """
    size = np.maximum(np.abs(one), np.abs(two))
    return np.asarray(np.abs(one - two) <= ROUNDING * size + 64 * np.finfo(float).eps * size.max(initial=0.0))


@dataclass(frozen=True, eq=False)
class Family:
    """Members of one structure that vary in the same numbers as a few examples: one kernel for all members.

    differs   (N,) which numbers of a member are arguments of the kernel
    windows   windows of the kernel (see ``Members``)
    rounding  admissible difference between examples in other numbers, relative to the largest number of the array
    """

    reader: Reader
    differs: Array
    windows: int = 0
    rounding: float = 0.0

    @classmethod
    def of(
        cls, examples: Sequence[Member], simulation: Simulation, *, windows: int = 0, watched: Watched | None = None
    ) -> Family:
        """Create the family; raises InputError if an example can't be used. For ``watched``, see ``Members``."""
        reader = Reader.of(examples[0][:2], simulation, adjustable=False, watched=watched)
        for problem, controller, *_ in examples[1:]:
            reader.add(problem, controller)
        return cls(reader, reader.arguments(), windows)

    @cached_property
    def members(self) -> Members:
        """The examples with their kernel."""
        windows = 0 if self.windows == 1 and self.reader.loop.sampled else self.windows  # see ``judging.finer_by``
        return self.reader.members(windows, many_delays=len(self.reader.known_delays) > 1)

    @property
    def numbers(self) -> Numbers:
        """The kernel's arguments for the examples."""
        return _numbers(self.reader, self.reader.chosen(self.differs, self.rounding), 0)

    def read(self, members: Sequence[Member]) -> Numbers:
        """The numbers of members that differ from the examples only in the same numbers; raises InputError for others."""
        first = self.reader.problem, self.reader.controller
        if all(one is other for member in members for one, other in zip(member[:2], first, strict=True)):
            return self._first.of(np.zeros(len(members), dtype=int))
        reader = self.reader.again()
        try:
            for member in members:
                reader.take(*member)
            parameters = reader.chosen(self.differs, ROUNDING)[:, 1:]
        except StructureError:
            raise InputError(OTHER_STRUCTURE) from None
        return _numbers(reader, parameters, 1)

    @cached_property
    def _first(self) -> Numbers:
        """The kernel's arguments for the first example."""
        return self.numbers.of(np.array([0]))

    @property
    def weights(self) -> tuple[Array, Array]:
        """(k,) the rows of the parameters that are weights of a delay, and the indices of these weights among all weights."""
        reader = self.reader
        if reader.weights is not None and reader.adjustable:  # all weights, at the end
            size = reader.weights.first.size
            return int(self.differs.sum()) + 1 + np.arange(size), np.arange(size)
        first = reader.columns.first.delay_weights
        size = 0 if first is None else first.size
        arguments = np.flatnonzero(self.differs) - (len(self.differs) - size)  # a member's weights are its last numbers
        return np.flatnonzero(arguments >= 0), arguments[arguments >= 0]

    def given(self, numbers: Numbers, streams: Array) -> Members:
        """The arguments for members with these numbers and noise streams, (M,)."""
        return replace(
            self.members,
            states=numbers.states,
            parameters=numbers.parameters,
            numbers=streams,
            lags=numbers.lags,
            delays=None if self.members.delays is None else numbers.delays,
            history=numbers.history,
            seeds=numbers.seeds,
            longest_delay=float(numbers.delays.max(initial=0.0)),
        )


def _numbers(reader: Reader, parameters: Array, first: int) -> Numbers:
    """The numbers of all members that were read, from number ``first`` on; ``parameters`` contains only their parameters."""
    return Numbers(
        parameters,
        reader.initial.everything()[:, first:],
        np.array(reader.lags[first:]) if reader.lags else None,
        np.column_stack(reader.history[first:]) if reader.history else None,
        np.array(reader.delays[first:]),
        np.array(reader.seeds[first:]) if reader.loop.signals.noise else None,
    )
