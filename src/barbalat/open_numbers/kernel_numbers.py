"""The numbers that a kernel is handed for each member, made for many members at once where they are what varies itself.

What varies reaches a kernel in one of two ways. Either some of its arguments *are* that number, to the last bit, and nothing else
depends on it: theta, a gain, x_0. Or they follow from it by way of the objects: P from A_m, a filter's matrices from kappa, the
weights of a delay. Of the first kind no object is made for a member.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.columns import StructureError
from barbalat.run.members import Members, Reader
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

Member = tuple[TrackingProblem, Controller]


ROUNDING = 1e-9
"""Part of the largest number of an array. What did not change with any of the values tried and is off by no more in some member
is the same number computed in other steps, as an A_m that follows from a varied A; every member has the first's."""


@dataclass(frozen=True, eq=False)
class Numbers:
    """What kernels of one structure are handed for M members; all arrays have the members' axis last.

    parameters (p, M), states (size, M); lags (M,), history (m, M) and delays (M,) [s] with a delay; seeds (M,) with noise
    """

    parameters: Array
    states: Array
    lags: Array | None
    history: Array | None
    delays: Array
    seeds: Array | None

    def of(self, which: Array) -> Numbers:
        """Of chosen members, which may stand there more than once."""
        return Numbers(*(None if part is None else part[..., which] for part in vars(self).values()))

    def identical(self, other: Numbers) -> bool:
        """Whether all bits agree."""
        return all(
            one is two or (one is not None and two is not None and one.tobytes() == two.tobytes())
            for one, two in zip(vars(self).values(), vars(other).values(), strict=True)
        )

    @classmethod
    def together(cls, parts: Sequence[Numbers]) -> Numbers:
        """Of the members of all of these."""
        columns = zip(*(vars(part).values() for part in parts), strict=True)
        return cls(*(None if found[0] is None else np.concatenate(found, axis=-1) for found in columns))


@dataclass(frozen=True, eq=False)
class Family:
    """Members of one structure that vary in what a few examples vary in: one kernel, whatever members there are.

    differs  (N,) which of all numbers of a member are arguments of the kernel
    """

    members: Members
    reader: Reader
    differs: Array

    @classmethod
    def of(cls, examples: Sequence[Member], simulation: Simulation, *, windows: int = 0) -> Family:
        """InputError where an example can't be used."""
        reader = Reader.of(examples[0], simulation, adjustable=False)
        for problem, controller in examples[1:]:
            reader.add(problem, controller)
        return cls(reader.members(windows, many_delays=len(reader.known_delays) > 1), reader, reader.arguments())

    def read(self, members: Sequence[Member]) -> Numbers:
        """Of any members that differ from the examples in no more than these do; InputError for others."""
        reader = Reader.of((self.reader.problem, self.reader.controller), self.reader.simulation, adjustable=False)
        try:
            for problem, controller in members:
                reader.take(problem, controller)
            parameters = reader.chosen(self.differs, ROUNDING)[:, 1:]
        except StructureError:
            raise InputError(
                "members must have the structure of the first one, and vary in no more than the few that were tried before: "
                "narrow the range, or sweep its parts one by one"
            ) from None
        lags = np.array(reader.lags[1:]) if reader.loop.delayed else None
        return Numbers(
            parameters,
            reader.initial.everything()[:, 1:],
            lags,
            np.column_stack(reader.history[1:]) if reader.loop.delayed else None,
            np.array([problem.delay for problem, _ in members]),
            np.array(reader.seeds[1:]) if reader.loop.signals.noise else None,
        )

    def given(self, numbers: Numbers, streams: Array) -> Members:
        """Members with these numbers and these streams of noise, (M,)."""
        return replace(
            self.members,
            states=numbers.states,
            parameters=numbers.parameters,
            numbers=streams,
            lags=numbers.lags,
            history=numbers.history,
            seeds=numbers.seeds,
            longest_delay=float(numbers.delays.max(initial=0.0)),
        )


@dataclass(frozen=True, eq=False)
class Copied:
    """Where a number that varies stands as it is: rows of the kernel's parameters and of its states."""

    parameters: Array
    states: Array

    @classmethod
    def of(cls, numbers: Numbers, tried: Array) -> Copied | None:
        """By examples that differ in this number alone, which is ``tried`` (K,) in them; None where more follows from it."""
        rows = []
        for values in (numbers.parameters, numbers.states):
            moved = (values != values[:, :1]).any(axis=1)
            if (values[moved] != tried).any():
                return None
            rows.append(np.flatnonzero(moved))
        apart = (numbers.lags, numbers.history, numbers.delays, numbers.seeds)
        if any(part is not None and (part != part[..., :1]).any() for part in apart):
            return None
        return cls(*rows)

    def put(self, numbers: Numbers, values: Array) -> None:
        """The values (M,) where they belong; the arrays are changed."""
        numbers.parameters[self.parameters] = values
        numbers.states[self.states] = values
