"""Which of many numbers can be moved together: every pair is tried, at each value of one with each value of the other.

A setting tries all pairs among its numbers at once, so that some dozens of settings do for hundreds of pairs; nothing is
drawn at random. Where a setting is not what it should be, the few numbers are looked for that are enough for that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto
from itertools import combinations

import numpy as np

from barbalat.validate import Array

Move = tuple[int, int]
"""A number, counted from 0, and which of the values that are tried it takes."""


class Outcome(Enum):
    """Of a setting in which some numbers are moved and the others are the case's."""

    FITS = auto()
    DIFFERS = auto()
    NO_CASE = auto()


@dataclass(eq=False)
class Together:
    """What is known of the numbers: any two that one search found apart stay so in the next, at other values.

    kinds    (N,) numbers of one kind stand in one vector or matrix: constructors take it as a whole, and where an entry of it
             must not be moved with an entry of another one no two of theirs may: it may show at few values, in a last bit
    apart    (N, N) which numbers must not be moved together
    outcome  of the setting with these moves, each of another number
    dropped  numbers that don't fit by themselves
    """

    kinds: Sequence[object]
    apart: Array
    outcome: Callable[[Sequence[Move]], Outcome]
    dropped: set[int] = field(default_factory=set)

    def __post_init__(self) -> None:
        for one, two in np.argwhere(self.apart):
            self._part(int(one), int(two))

    def search(self, moves: Sequence[Move], *, everywhere: bool) -> None:
        """Try every pair of these moves; two that make no case are apart where one is expected ``everywhere``."""
        seen = Search(self, moves).seen()
        if everywhere:
            self.apart |= ~seen & ~np.eye(len(self.apart), dtype=bool)

    def part(self, numbers: Sequence[int]) -> None:
        """Any two of these are apart from now on."""
        for one, two in combinations(numbers, 2):
            self._part(one, two)

    def _part(self, one: int, two: int) -> None:
        of_one, of_two = ([i for i, kind in enumerate(self.kinds) if kind == self.kinds[k]] for k in (one, two))
        for i in of_one:
            for j in of_two:
                self.apart[i, j] = self.apart[j, i] = i != j


@dataclass(eq=False)
class Search:
    """One of them: each number has some moves."""

    known: Together
    moves: Sequence[Move]

    def __post_init__(self) -> None:
        self._numbers = np.array([number for number, _ in self.moves], dtype=int)
        self._refused = self._numbers[:, None] == self._numbers  # which moves can't stand in one setting
        self._wanted = np.ones_like(self._refused)
        self._refused_sets: list[frozenset[int]] = []
        self._refuse_known()

    def seen(self) -> Array:
        """Try all; (N, N) which numbers fit together, or must not be moved together."""
        seen = np.zeros_like(self.known.apart)
        while self._wanted.any():
            setting = self._next_setting()
            if self._of(setting) is Outcome.FITS:
                self._wanted[np.ix_(setting, setting)] = False
                numbers = self._numbers[setting]
                seen[np.ix_(numbers, numbers)] = True
            else:
                few = self._smallest(setting)
                self._refuse(few, self._of(few))
        return np.asarray(seen | self.known.apart)

    def _refuse_known(self) -> None:
        gone = np.isin(self._numbers, list(self.known.dropped))
        self._refused |= self.known.apart[np.ix_(self._numbers, self._numbers)] | gone | gone[:, None]
        self._wanted &= ~self._refused | (np.eye(len(self.moves), dtype=bool) & ~gone)

    def _of(self, setting: Sequence[int]) -> Outcome:
        return self.known.outcome([self.moves[i] for i in setting])

    def _next_setting(self) -> list[int]:
        """A pair that is wanted, and beside it, one after another, what brings most of the other pairs."""
        setting: list[int] = np.unique(np.argwhere(self._wanted)[0]).tolist()
        gain = self._wanted[:, setting].sum(axis=1)
        free = ~self._refused[:, setting].any(axis=1)
        while (gain * free).any():
            best = int(np.argmax(gain * free))
            if any(refused <= {*setting, best} for refused in self._refused_sets):
                free[best] = False
                continue
            setting.append(best)
            gain = gain + self._wanted[:, best]
            free &= ~self._refused[:, best]
        return setting

    def _smallest(self, setting: Sequence[int]) -> list[int]:
        """Moves of a setting that doesn't fit that don't fit by themselves, and each of which that needs."""
        needed: list[int] = []
        others = list(setting)
        while not needed or self._of(needed) is Outcome.FITS:
            fits, too_many = 0, len(others)  # of the others, beside those that are needed
            while too_many - fits > 1:
                middle = (fits + too_many) // 2
                fits, too_many = (middle, too_many) if self._of(needed + others[:middle]) is Outcome.FITS else (fits, middle)
            needed.append(others[fits])
            others = others[:fits]
        return needed

    def _refuse(self, moves: Sequence[int], outcome: Outcome) -> None:
        """Never again in one setting: these moves, or, where the numbers are not what they should be, any two of theirs."""
        numbers = self._numbers[list(moves)].tolist()
        if outcome is Outcome.DIFFERS:
            self.known.part(numbers)
            self.known.dropped |= set(numbers) if len(numbers) == 1 else set()
            self._refuse_known()
        elif len(moves) > 2:
            self._refused_sets.append(frozenset(moves))
        else:
            one, two = moves[0], moves[-1]
            here = np.ix_([one], range(len(self.moves))) if one == two else np.ix_([one], [two])
            for which in (self._refused, self._refused.T):
                which[here] = True
            for which in (self._wanted, self._wanted.T):
                which[here] = False
