"""Which numbers of a case get a slider: those whose effects a page can follow, one by one and all at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from barbalat.cases.build import Case
from barbalat.explorer.in_signals import InSignals, SignalSearch
from barbalat.explorer.source import Source
from barbalat.explorer.together import Outcome, Together
from barbalat.explorer.tried_values import TRIED_TURNS, Place, places_tried
from barbalat.open_numbers.numbers import Number, ranged
from barbalat.open_numbers.path import FieldPath
from barbalat.open_numbers.probe import Effect, Rows, Target, composed, effects_of
from barbalat.validate import Array, InputError

MOST_SHARED_BYTES = 150_000
"""Of the tables of sliders that exclude others; in a page they take a third more."""
MOST_NUMBERS = 80
"""Sliders of a page."""
GRID_KEYS = ("t_end", "dt")
"""Keys of the simulation; their sliders are the page's own."""
DELAY_PATH = FieldPath(("plant", "input", "delay"))
"""A slider of the page's own too: it moves how far a module looks back, in whole steps."""
PRECEDENCE = ("controller", "reference", "simulation", "plant", "reference_model", "uncertainty", "")
"""The order in which numbers get sliders: by their part, and of a part's a number by itself before entries of vectors.
Of two that move one row of a module the later one has fewer values."""


@dataclass(frozen=True, eq=False)
class Variant:
    """A controller of the case and its kernel, with the projection that the case asks for or ``switched``."""

    index: int
    switched: bool
    target: Target


@dataclass(frozen=True, eq=False)
class Slider:
    """A number, its effect on each variant and on the signals.

    apart  numbers that were found not to move together with this one: a row follows from both where each alone leaves it, as
           products do with a zero
    """

    number: Number
    effects: list[Effect]
    signals: InSignals
    apart: frozenset[FieldPath] = frozenset()

    def excludes(self, other: Slider) -> bool:
        """Whether both move a row of some variant: with both away from the case's values it would need a table of all pairs."""
        if other.number.path in self.apart:
            return True
        rows = any(mine.rows & theirs.rows for mine, theirs in zip(self.effects, other.effects, strict=True))
        both = self.signals.grids is not None and other.signals.grids is not None
        return rows or both or self._bends(other) or other._bends(self)

    def _bends(self, other: Slider) -> bool:
        """Whether with this number elsewhere signals are no more what they are with the other one: its multiples."""
        scales, value = other.signals.scales, other.number.value
        if not scales or self.signals.grids is None:
            return False
        parts = [part.reshape(-1, len(grid.last)) for grid in self.signals.grids for part in (grid.values, grid.last)]
        return not np.isin(np.vstack(parts)[:, scales], (-value, 0.0, value)).all()

    @property
    def bytes(self) -> int:
        """The size of the slider's tables in the page."""
        tables = sum(effect.table.nbytes for effect in self.effects if effect.table is not None)
        return int(tables + sum(grid.bytes for grid in self.signals.grids or ()))

    @property
    def handed(self) -> bool:
        """Whether modules are handed what follows from it, beside the signals."""
        return not all(effect.nothing for effect in self.effects)

    @property
    def copied(self) -> bool:
        """Whether the number stands everywhere as it is: any value can be taken, not only those that are tabulated."""
        return self.signals.grids is None and all(effect.table is None for effect in self.effects)


@dataclass(frozen=True, eq=False)
class Sliders:
    """The search for them.

    toggles  the controllers whose projection can be switched
    """

    source: Source
    case: Case
    toggles: tuple[int, ...]
    variants: list[Variant]

    def found(self) -> list[Slider]:
        """Those that get one, in the order of ``PRECEDENCE``."""
        taken: list[Rows] = [set() for _ in self.variants]
        kept: list[Slider] = []
        room = MOST_SHARED_BYTES
        for path, value in sorted(self.source.numbers(), key=_precedence):
            if path.keys[-1] in GRID_KEYS or len(kept) == MOST_NUMBERS or (path == DELAY_PATH and self.case.problem.delay > 0):
                continue
            number = ranged(path, value, partial(self.at, False))
            slider = None if number is None else self._followed(number, taken, room)
            if slider is None:
                continue
            if slider.signals.grids is not None or any(map(slider.excludes, kept)):
                room -= slider.bytes
            kept.append(slider)
            taken = [rows | effect.rows for effect, rows in zip(slider.effects, taken, strict=True)]
        return self._apart(kept)

    def _apart(self, kept: Sequence[Slider]) -> list[Slider]:
        """Those that are with the others what they are alone, each with those that it must not be moved with."""
        apart = np.array([[one is not other and one.excludes(other) for other in kept] for one in kept], dtype=bool)
        tried: list[list[Place]] = []
        search = Together(
            [slider.number.path.vector for slider in kept],
            apart.reshape(len(kept), len(kept)),
            lambda moves: self._outcome([(kept[k], tried[k][i]) for k, i in moves]),
        )
        for turn in range(TRIED_TURNS):
            tried = [
                places_tried(slider.number, k, turn, copied=slider.copied, handed=slider.handed) for k, slider in enumerate(kept)
            ]
            moves = [(k, i) for k in range(len(kept)) for i in range(len(tried[k]))]
            search.search(moves, everywhere=turn == 0)
        return [
            replace(slider, apart=frozenset(kept[j].number.path for j in np.flatnonzero(search.apart[k]).tolist()))
            for k, slider in enumerate(kept)
            if k not in search.dropped
        ]

    def _outcome(self, moved: Sequence[tuple[Slider, Place]]) -> Outcome:
        """Whether sliders at these values make of the case what a page makes of it."""
        numbers = {slider.number.path: value for slider, (value, _) in moved}
        for switched in (False, True) if self.toggles else (False,):
            try:
                case = self.source.at(numbers, self.toggles if switched else ())
            except InputError:  # together they make no case: the copied one says why
                return Outcome.NO_CASE
            for k, variant in enumerate(self.variants):
                effects = [(slider.effects[k], value, place) for slider, (value, place) in moved]
                if variant.switched == switched and not _agrees(variant.target, case, composed(variant.target, effects)):
                    return Outcome.DIFFERS
        return Outcome.FITS

    def _followed(self, number: Number, taken: Sequence[Rows], room: int) -> Slider | None:
        of_controller = number.path.keys[0] == "controller"
        followed = (number, InSignals([], [])) if of_controller else self._signals.of(number, room)
        if followed is None:
            return None
        number, signals = followed
        effects = [Effect.none() for _ in self.variants]
        for switched in (False, True) if self.toggles else (False,):
            which = [k for k, one in enumerate(self.variants) if one.switched == switched]
            if not which:
                continue
            targets, rows = [self.variants[k].target for k in which], [taken[k] for k in which]
            known = [effects[self.variants[k].index] for k in which] if switched else None
            found = effects_of(number, targets, rows, partial(self.at, switched), room, known)
            if found is None or (switched and len(found[0].values) != len(number.values)):
                return None
            if signals.grids is not None and len(found[0].values) != len(number.values):
                return None
            number = found[0]
            for k, effect in zip(which, found[1], strict=True):
                effects[k] = effect
        moves = signals.places or signals.scales or signals.grids or not all(effect.nothing for effect in effects)
        return Slider(number, effects, signals) if moves else None

    @cached_property
    def _signals(self) -> SignalSearch:
        return SignalSearch(self.case, partial(self.at, False))

    def at(self, switched: bool, path: FieldPath, value: float) -> Case:
        """The case with another number, and with all projections switched that can be."""
        key = switched, path, value
        if key not in self._cases:
            self._cases[key] = self.source.at({path: value}, self.toggles if switched else ())
        return self._cases[key]

    @cached_property
    def _cases(self) -> dict[tuple[bool, FieldPath, float], Case]:
        """Those that were made: the same ones are read for several purposes."""
        return {}


def _agrees(target: Target, case: Case, found: tuple[Array, Array]) -> bool:
    try:
        made = target.read([case])
    except InputError:  # another structure
        return False
    return all((part == rows[:, 0]).all() for part, rows in zip(found, (made.parameters, made.states), strict=True))


def _precedence(given: tuple[FieldPath, float]) -> tuple[int, bool]:
    path, first = given[0], str(given[0].keys[0])
    return PRECEDENCE.index(first if first in PRECEDENCE else ""), isinstance(path.keys[-1], int)
