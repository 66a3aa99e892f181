"""The numbers of each member: on a grid, drawn, or every draw at every point of a grid. They depend only on the number of the
member."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import lru_cache

import numpy as np

from barbalat import validate
from barbalat.open_numbers.path import FieldPath
from barbalat.sweeps.spread import LARGEST_SHARE, SMALLEST_SHARE, Axis, Distribution, InBall
from barbalat.validate import Array, InputError

BLOCK_DRAWS = 2**16
"""Draws that are made together: each block is a separate Latin hypercube, so a single member needs only its block."""
MOST_SOBOL = 2**30
"""Largest number of points of SciPy's Sobol sequence, which has 30 bits."""


class Design(Enum):
    """The ways in which draws cover their space."""

    LATIN = "latin"
    SOBOL = "sobol"
    RANDOM = "random"
    SALTELLI = "saltelli"


DEFAULT_MEMBERS = dict.fromkeys(Design, 1000) | {Design.SALTELLI: 1024}
"""Default number of draws, with which a fraction of a few percent has an interval of about one percent. Saltelli's design needs
powers of two."""
MOST_MEMBERS = 10**10
"""Largest number of members of a sweep: each of 4096 chunks then has some 2.5 million, half a gigabyte of columns."""


def members_of(given: int | None, design: Design, *, drawn: bool) -> int:
    """The number of draws at each point of a grid: the given number, or the default of the design if anything is drawn."""
    if given is not None:
        return given
    return DEFAULT_MEMBERS[design] if drawn else 1


def design_of(name: str | Design) -> Design:
    """The design with this name; raises InputError for an unknown name."""
    try:
        return Design(name)
    except ValueError:
        known = ", ".join(one.value for one in Design)
        meant = validate.hint(name, [one.value for one in Design])
        raise InputError(f"design must be one of {known}, got {validate.show(name)}{meant}") from None


@dataclass(frozen=True)
class Plan:
    """axes and draws by the paths of the varied numbers. With both, every draw occurs at every point of the grid.

    members  number of draws. For Saltelli's design, the number in its first matrix, a power of two; d numbers need d + 2 times as
             many members
    seed     seed of the draws
    """

    axes: Mapping[FieldPath, Axis] = field(default_factory=dict)
    draws: Mapping[FieldPath, Distribution] = field(default_factory=dict)
    members: int = 1
    design: Design = Design.LATIN
    seed: int = 0

    def __post_init__(self) -> None:
        validate.whole("members", self.members, least=1, most=MOST_MEMBERS)
        validate.whole("seed", self.seed, least=0)
        if not self.axes and not self.draws:
            raise InputError("a sweep needs a number to vary: give --vary PATH=START:STOP:COUNT or --sample PATH=uniform:A:B")
        if twice := [str(path) for path in self.axes if path in self.draws]:
            raise InputError(f"{twice[0]} is both varied and sampled; choose one of them")
        if not self.draws and self.members != 1:
            raise InputError(f"members = {self.members} needs a number to draw: give --sample PATH=uniform:A:B, or omit it")
        if self.design is Design.SALTELLI and self.axes:
            raise InputError("Saltelli's design cannot be combined with a grid: omit --vary")
        if self.design is Design.SALTELLI and (not self.draws or self.members & (self.members - 1)):
            raise InputError(
                f"Saltelli's design needs a number to draw, and the number of members must be a power of two, got {self.members}"
            )
        if self.design is Design.SALTELLI and any(isinstance(one, InBall) for one in self.draws.values()):
            raise InputError("Saltelli's design needs independent numbers, but those of a ball are not independent")
        if self.design in (Design.SOBOL, Design.SALTELLI) and self.members > MOST_SOBOL:
            raise InputError(f"a Sobol sequence has at most {MOST_SOBOL} points, got members = {self.members}")
        if self.count > MOST_MEMBERS:
            raise InputError(
                f"a sweep has at most {MOST_MEMBERS:.0e} members, got {self.count:.3g}: run several sweeps, each with a "
                f"different --seed"
            )

    @property
    def paths(self) -> tuple[FieldPath, ...]:
        """The paths of the columns of ``values``."""
        return (*self.axes, *self.draws)

    @property
    def points(self) -> int:
        """The number of points of the grid."""
        count = 1
        for axis in self.axes.values():
            count *= axis.count
        return count

    @property
    def draws_each(self) -> int:
        """The number of draws at each point of the grid."""
        return self.members * (len(self.draws) + 2) if self.design is Design.SALTELLI else self.members

    @property
    def count(self) -> int:
        """The total number of members."""
        return self.points * self.draws_each

    def __len__(self) -> int:
        return self.count

    @property
    def keeps_its_first(self) -> bool:
        """Whether the first members stay the same if more members are requested."""
        return self.design in (Design.RANDOM, Design.SOBOL) and not self.axes

    def values(self, first: int, count: int) -> Array:
        """(count, paths) the values for the members from number ``first`` on."""
        return self.values_for(np.arange(first, first + count))

    def values_for(self, numbers: Array) -> Array:
        """(K, paths) the values for the members with these numbers."""
        point, draw = np.divmod(numbers, self.draws_each)
        columns = []
        for axis in reversed(list(self.axes.values())):
            point, place = np.divmod(point, axis.count)
            columns.append(axis.values[place])
        columns.reverse()
        if self.draws:
            shares = np.clip(self._shares(draw), SMALLEST_SHARE, LARGEST_SHARE)
            drawn: list[Array] = []
            for i, one in enumerate(self.draws.values()):
                drawn.append(one.at(shares[:, i], drawn))
            columns += drawn
        return np.column_stack(columns)

    def streams(self, first: int, count: int) -> Array:
        """(count,) the noise streams of the members, which are those of their draws, so a draw has the same noise at every point
        of the grid."""
        return self.streams_for(np.arange(first, first + count))

    def streams_for(self, numbers: Array) -> Array:
        """The noise streams of the members with these numbers."""
        return np.asarray(numbers % self.draws_each)

    def _shares(self, draw: Array) -> Array:
        """(K, draws) the fractions for these draw numbers, which may begin again at the next point of the grid."""
        found, dimensions = np.empty((len(draw), len(self.draws))), len(self.draws)
        if self.design is Design.SALTELLI:
            return self._saltelli(draw, dimensions)
        for block in np.unique(draw // BLOCK_DRAWS):
            within = draw // BLOCK_DRAWS == block
            found[within] = self._block(int(block), dimensions)[draw[within] - block * BLOCK_DRAWS]
        return found

    def _block(self, block: int, dimensions: int) -> Array:
        count = min(BLOCK_DRAWS, self.members - block * BLOCK_DRAWS)
        if self.design is Design.SOBOL:
            return self._sobol(block * BLOCK_DRAWS, count, dimensions)
        if self.design is Design.RANDOM:
            return np.random.default_rng([self.seed, block]).random((count, dimensions))
        return _hypercube(self.seed, block, count, dimensions)

    def _sobol(self, first: int, count: int, dimensions: int) -> Array:
        from scipy.stats import qmc

        sequence = qmc.Sobol(dimensions, rng=np.random.default_rng(self.seed))
        if first:
            sequence.fast_forward(first)
        with warnings.catch_warnings():
            # SciPy warns that the balance needs a power of two, which the documentation states
            warnings.simplefilter("ignore", UserWarning)
            return np.asarray(sequence.random(count))

    def _saltelli(self, draw: Array, dimensions: int) -> Array:
        """Rows of A, of B, then of A with one column from B, for each of the drawn numbers."""
        matrix, row = np.divmod(draw, self.members)
        both = np.empty((len(draw), 2 * dimensions))
        for block in np.unique(row // BLOCK_DRAWS):
            within = row // BLOCK_DRAWS == block
            first = int(block) * BLOCK_DRAWS
            made = self._sobol(first, min(BLOCK_DRAWS, self.members - first), 2 * dimensions)
            both[within] = made[row[within] - first]
        from_b = (matrix == 1)[:, None] | (matrix[:, None] - 2 == np.arange(dimensions))
        return np.where(from_b, both[:, dimensions:], both[:, :dimensions])

    def as_json(self) -> dict[str, object]:
        """Everything that determines the members."""
        return {
            "vary": {str(path): str(axis) for path, axis in self.axes.items()},
            "sample": {str(path): str(one) for path, one in self.draws.items()},
            "members": self.members,
            "design": self.design.value,
            "seed": self.seed,
        }


@lru_cache(maxsize=2)
def _hypercube(seed: int, block: int, count: int, dimensions: int) -> Array:
    """The draws of a block. They are cached for its next chunk, because with chunks of a thousand members they would otherwise
    dominate the time."""
    from scipy.stats import qmc

    return np.asarray(qmc.LatinHypercube(dimensions, rng=np.random.default_rng([seed, block])).random(count))
