"""The delay at a plant's input in variable-step runs. Each step leaves a record that later steps read.

A record contains the delay's input during its step as a polynomial, so the delay is as exact as the dense output of the motion.
Every event recurs one delay later. It is then smoother by one derivative, if the control depends continuously on the plant's
state. Steps end at these instants, up to the derivatives that the order of the method resolves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barbalat import budget
from barbalat.budget import Estimate
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.lowering.shape import Recalled
from barbalat.run.kernel.breaks import ON_GRID_ROUNDINGS
from barbalat.run.kernel.delay import brings_bends
from barbalat.validate import Array

if TYPE_CHECKING:
    import casadi as ca

RECORDS = 4
"""Number of successive records that a step reads: no step is longer than this many of the steps made one delay earlier."""
PLACES = (1 - np.cos(np.pi * np.arange(8) / 7)) / 2
"""Fractions of a step at which the polynomial equals the delay's input; its order is that of the dense output."""
COEFFICIENTS = np.linalg.inv(np.vander(2 * PLACES - 1, increasing=True))
"""(8, 8) matrix from these values to coefficients of powers of the position in the step, which runs from -1 to 1."""
SMOOTH_LEVEL = 8.0
"""A jump in this derivative of the delay's input, or in a higher one, does not disturb the method; 0 is the control
itself."""
SAME_INSTANT = ON_GRID_ROUNDINGS * float(np.finfo(float).eps)
"""Relative distance of two times below which they count as the same instant."""
HEAD = 4
"""The numbers of a record before its coefficients: see ``Record``."""


class Record(NamedTuple):
    """A step's record.

    begins, ends  the step [s]
    level         the lowest derivative that jumps at its end
    rate          1 / (ends - begins); 0 for the record of the history, which is constant
    coefficients  (k m,) coefficients of the polynomials, k for each input in turn
    """

    begins: ca.SX
    ends: ca.SX
    level: ca.SX
    rate: ca.SX
    coefficients: ca.SX


class Ahead(NamedTuple):
    """The limits that the records set for a step.

    meets  the next instant [s] at which the delay's output is not smooth, and its level
    most   latest admissible end of the step [s]
    """

    meets: ca.SX
    level: ca.SX
    most: ca.SX


@dataclass(frozen=True)
class DelayedInput:
    """The records of a loop with ``inputs`` inputs behind a delay.

    held  whether the control changes only at samples; it is then constant within a step and known until the next sample
    """

    inputs: int
    held: bool

    @classmethod
    def of(cls, loop: ClosedLoop) -> DelayedInput | None:
        """The records of a loop; None without a delay."""
        return cls(loop.inputs, not brings_bends(loop)) if loop.delayed else None

    @property
    def each(self) -> int:
        """Number of coefficients of an input."""
        return 1 if self.held else len(PLACES)

    @property
    def width(self) -> int:
        """Numbers of a record."""
        return HEAD + self.each * self.inputs

    def recalled(self, first: int, last: int) -> Recalled:
        """The recalled records for a kernel that has their numbers in these rows of its state."""
        return Recalled(self.width, RECORDS, first, last)

    def beginning(self, history: Array) -> Array:
        """(1, width) the record of the time before t = 0, for a history (m,)."""
        coefficients = np.zeros((self.inputs, self.each))
        coefficients[:, 0] = history
        return np.concatenate([[-1.0, 0.0, 0.0, 0.0], coefficients.reshape(-1)])[None]

    def record(self, begins: ca.SX, ends: ca.SX, level: ca.SX, values: list[ca.SX]) -> ca.SX:
        """A step's record, (width,), from the delay's input at ``places``."""
        import casadi as ca

        found = []
        for i in range(self.inputs):
            first = values[0][i]
            moved = ca.vertcat(0.0, *(value[i] - first for value in values[1:]))  # a constant control leaves exact zeros
            coefficients = moved if self.held else ca.mtimes(ca.DM(COEFFICIENTS), moved)
            found += [coefficients[0] + first, *ca.vertsplit(coefficients)[1:]]
        return ca.vertcat(begins, ends, level, 1 / (ends - begins), *found)

    @property
    def places(self) -> tuple[float, ...]:
        """The fractions of a step at which its record is taken."""
        return (0.0,) if self.held else tuple(PLACES)

    def records(self, flat: ca.SX) -> list[Record]:
        """The records that a step reads."""
        rows = [flat[k * self.width : (k + 1) * self.width] for k in range(RECORDS)]
        return [Record(row[0], row[1], row[2], row[3], row[HEAD:]) for row in rows]

    def leaving(self, t: ca.SX, delay: ca.SX, known: ca.SX, flat: ca.SX) -> ca.SX:
        """The output of the delay at t, (m,), from the first ``known`` records; at a jump, the value before it."""
        import casadi as ca

        first, *others = [ca.vertcat(one.begins, one.rate, one.coefficients) for one in self.records(flat)]
        found = first
        for k, (one, before) in enumerate(zip(others, self.records(flat), strict=False), start=1):
            later = t > (before.ends + delay) * (1 + SAME_INSTANT)
            found = ca.if_else(ca.logic_and(known > k, later), one, found)
        place = 2 * (((t - delay) - found[0]) * found[1]) - 1
        values = []
        for i in range(self.inputs):
            coefficients = ca.vertsplit(found[2 + i * self.each : 2 + (i + 1) * self.each])
            value = coefficients[-1]
            for coefficient in reversed(coefficients[:-1]):
                value = value * place + coefficient
            values.append(value)
        return ca.vertcat(*values)

    def ahead(self, delay: ca.SX, known: ca.SX, flat: ca.SX) -> Ahead:
        """The ``Ahead`` of a step that begins when the first record begins to leave the delay."""
        import casadi as ca

        meets, level, most = ca.SX(np.inf), ca.SX(SMOOTH_LEVEL), ca.SX(-np.inf)
        for k, one in reversed(list(enumerate(self.records(flat)))):
            leaves, is_known = one.ends + delay, known > k
            rough = ca.logic_and(is_known, one.level < SMOOTH_LEVEL)
            near = meets <= leaves * (1 + SAME_INSTANT)
            level = ca.if_else(rough, ca.fmin(one.level, ca.if_else(near, level, SMOOTH_LEVEL)), level)
            meets = ca.if_else(rough, ca.if_else(near, meets, leaves), meets)
            most = ca.if_else(is_known, ca.fmax(most, leaves), most)
        if self.held:
            most = ca.if_else(known <= RECORDS, np.inf, most)
        return Ahead(meets, level, most)

    def left(self, t: ca.SX, delay: ca.SX, known: ca.SX, flat: ca.SX) -> ca.SX:
        """The number of records that have left the delay at t."""
        import casadi as ca

        found = ca.SX(0.0)
        for k, one in enumerate(self.records(flat)):
            gone = ca.logic_and(known > k, (one.ends + delay) <= t * (1 + SAME_INSTANT))
            found = found + ca.if_else(gone, 1.0, 0.0)
        return found


def with_room(records: Array, first: Array, last: Array, steps: int) -> tuple[Array, Array]:
    """The records (W, R, width) of each member from number ``first`` (W,) up to ``last`` (W,), with space for further records,
    and the number of omitted earlier records (W,).

    Raises InputError if they don't fit into the budget.
    """
    if int(last.max()) + steps + RECORDS <= records.shape[1]:
        return records, np.zeros_like(first)
    members, _, width = records.shape
    rows = 2 * (int((last - first).max()) + steps + RECORDS)
    row = Estimate(memory=8.0 * members * width)
    budget.require("plant.input.delay", rows, row.times, what="what a delay remembers")
    found = np.zeros((members, rows, width))
    for i, (begin, end) in enumerate(zip(first, last, strict=True)):
        found[i, : end - begin] = records[i, begin:end]
    return found, first
