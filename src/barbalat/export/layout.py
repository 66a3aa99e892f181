"""What of a sampled controller's state an exported one keeps: the arrays that its control or its estimates depend on.

The last good measurement and command are among them, whatever the law: they stand in for those that are lost.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from barbalat.export.names import distinct
from barbalat.loop.blame import leaves
from barbalat.loop.sampling import Acting
from barbalat.lowering.operations import Program, sliced, sources
from barbalat.run.sampled_part import STATE


@dataclass(frozen=True)
class StatePart:
    """One array of the state.

    name   of the member in C
    path   in the state: "controller.x_hat", "held.x_m"
    shape  row by row in C
    start  of its entries in the flat state
    """

    name: str
    path: str
    shape: tuple[int, ...]
    start: int

    @property
    def size(self) -> int:
        return int(np.prod(self.shape, dtype=int))

    @property
    def rows(self) -> range:
        """Its entries in the flat state."""
        return range(self.start, self.start + self.size)

    def entry(self, row: int) -> str:
        """C text of the entry that stands at ``row`` of the flat state."""
        return f"c->{self.name}[{row - self.start}]"


@dataclass(frozen=True, eq=False)
class Layout:
    """The arrays that are kept, and among them those that the surroundings of the arithmetic name.

    u          the control
    theta_hat  the estimates
    started    tells the first sample from the others
    measured   the last good measurement
    r          the last good command
    """

    parts: tuple[StatePart, ...]
    u: StatePart
    theta_hat: StatePart
    started: StatePart
    measured: StatePart
    r: StatePart

    @classmethod
    def of(cls, program: Program, initial: Acting) -> Layout:
        """``program`` is the controller's whole list; what nothing depends on is left out."""
        every = tuple(_parts(initial))
        paths = ("held.u", "controller.theta_hat", "held.started", "held.measured", "held.r")
        named = [next(part for part in every if part.path == path) for path in paths]
        needed = {part.path: part for part in named}
        while True:
            rows = [row for part in needed.values() for row in part.rows]
            read = {row for argument, row in sources(sliced(program, rows)) if argument == STATE}
            found = {part.path: part for part in every if not read.isdisjoint(part.rows)}
            if found.keys() <= needed.keys():
                kept = tuple(part for part in every if part.path in needed and part.size)
                return cls(kept, *named)
            needed |= found

    @property
    def rows(self) -> list[int]:
        """All that is kept, in the flat state."""
        return [row for part in self.parts for row in part.rows]

    def part(self, path: str) -> StatePart | None:
        """One array by its place in the state; None where it is not kept."""
        return next((part for part in self.parts if part.path == path), None)

    def entries(self) -> dict[int, str]:
        """C text of what is kept by rows of the flat state."""
        return {row: part.entry(row) for part in self.parts for row in part.rows}


def _parts(initial: Acting) -> Iterator[StatePart]:
    """All arrays, in the order of the flat state; the scheme's own by their names, what is held with a prefix."""
    found = [(path, np.shape(array)) for path, array in leaves(initial)]
    names = distinct(path.removeprefix("controller.") for path, _ in found)
    start = 0
    for name, (path, shape) in zip(names, found, strict=True):
        part = StatePart(name, path, shape, start)
        yield part
        start += part.size
