"""Finds the numbers of a case that get a slider: those whose effects a page can reproduce, singly and in combination."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from functools import cached_property, partial
from itertools import chain, combinations

import numpy as np

from barbalat.cases.build import Case
from barbalat.comparison.starts import estimates_in, initial_estimates
from barbalat.explorer.faults import seeds
from barbalat.explorer.in_signals import InSignals, SignalSearch
from barbalat.explorer.source import Source
from barbalat.open_numbers.numbers import Number, ranged
from barbalat.open_numbers.path import FieldPath
from barbalat.open_numbers.probe import Effect, Rows, Target, composed, effects_of
from barbalat.validate import Array, InputError

MOST_SHARED_BYTES = 150_000
"""Largest size of the tables of sliders that exclude others. Encoded as text in a page, they take a third more."""
MOST_NUMBERS = 80
"""Largest number of sliders of a page."""
GRID_KEYS = ("t_end", "dt")
"""Keys of the simulation. The page has separate sliders for them."""
DELAY_PATH = FieldPath(("plant", "input", "delay"))
"""The delay, for which the page also has a separate slider. It sets the delay of a module in whole steps."""
PRECEDENCE = ("controller", "reference", "simulation", "plant", "reference_model", "uncertainty", "")
"""The parts of a case in the order in which their numbers get sliders. Within a part, single numbers precede entries of vectors.
If two numbers change the same row of a module, the later one has fewer values."""


@dataclass(frozen=True, eq=False)
class Variant:
    """A controller of the case and its kernel, with the projection of the case or ``switched``."""

    index: int
    switched: bool
    target: Target


@dataclass(frozen=True, eq=False)
class Slider:
    """A number, its effect on each variant and on the signals.

    apart  numbers that must not be moved together with this one, because a row depends on both although each alone leaves the row
           unchanged, as in products with a zero
    """

    number: Number
    effects: list[Effect]
    signals: InSignals
    apart: frozenset[FieldPath] = frozenset()

    def excludes(self, other: Slider) -> bool:
        """Whether the two cannot be moved together. If both change a row of a variant, a table of all pairs would be needed."""
        if other.number.path in self.apart:
            return True
        rows = any(mine.rows & theirs.rows for mine, theirs in zip(self.effects, other.effects, strict=True))
        both = self.signals.grids is not None and other.signals.grids is not None
        return rows or both or self._bends(other) or other._bends(self)

    def _bends(self, other: Slider) -> bool:
        """Whether moving this number turns signals that are multiples of the other number into something else."""
        scales, value = other.signals.scales, other.number.value
        if not scales or self.signals.grids is None:
            return False
        parts = [part.reshape(-1, len(grid.last)) for grid in self.signals.grids for part in (grid.values, grid.last)]
        return not np.isin(np.vstack(parts)[:, scales], (-value, 0.0, value)).all()

    @property
    def bytes(self) -> int:
        """The size of the tables of the slider in the page."""
        tables = sum(effect.table.nbytes for effect in self.effects if effect.table is not None)
        return int(tables + sum(grid.bytes for grid in self.signals.grids or ()))

    @property
    def handed(self) -> bool:
        """Whether modules receive anything that follows from this number, other than the signals."""
        return not all(effect.nothing for effect in self.effects)

    @property
    def copied(self) -> bool:
        """Whether the number enters everywhere unchanged, so that any value can be used, not only the tabulated ones."""
        return self.signals.grids is None and all(effect.table is None for effect in self.effects)


@dataclass(frozen=True, eq=False)
class Sliders:
    """The search for the numbers that get a slider.

    toggles  the controllers whose projection can be switched
    """

    source: Source
    case: Case
    toggles: tuple[int, ...]
    variants: list[Variant]

    def found(self) -> list[Slider]:
        """The numbers that get a slider, in the order of ``PRECEDENCE``."""
        taken: list[Rows] = [set() for _ in self.variants]
        kept: list[Slider] = []
        room = MOST_SHARED_BYTES
        numbers = sorted(self.source.numbers(), key=_precedence)
        ranged_ones = (
            ranged(path, value, partial(self.at, False))
            for path, value in numbers
            if path.keys[-1] not in GRID_KEYS and not (path == DELAY_PATH and self.case.problem.delay > 0)
        )
        for number in chain(ranged_ones, seeds(self.case.problem.faults)):
            if len(kept) == MOST_NUMBERS:
                break
            slider = None if number is None else self._followed(number, taken, room)
            if slider is None:
                continue
            if slider.signals.grids is not None or any(map(slider.excludes, kept)):
                room -= slider.bytes
            kept.append(slider)
            taken = [rows | effect.rows for effect, rows in zip(slider.effects, taken, strict=True)]
        return self._apart(kept)

    def _apart(self, kept: Sequence[Slider]) -> list[Slider]:
        """Return the sliders whose effects can be combined, each with the numbers with which it must not be combined."""
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
        """Compare the case with these values of sliders to the page's reconstruction of it."""
        numbers = {slider.number.path: value for slider, (value, _) in moved}
        for switched in (False, True) if self.toggles else (False,):
            try:
                case = self._case(numbers, self.toggles if switched else ())
            except InputError:  # together these values give an invalid case; the error of the copied case explains why
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
        in_signals = signals.places or signals.scales or signals.grids or signals.drawn
        moves = in_signals or not all(effect.nothing for effect in effects)
        return Slider(number, effects, signals) if moves else None

    @cached_property
    def _signals(self) -> SignalSearch:
        return SignalSearch(self.case, partial(self.at, False))

    def at(self, switched: bool, path: FieldPath, value: float) -> Case:
        """Return the case with a different value of a number and, if ``switched``, with every switchable projection switched."""
        key = switched, path, value
        if key not in self._cases:
            self._cases[key] = self._case({path: value}, self.toggles if switched else ())
        return self._cases[key]

    def _case(self, numbers: Mapping[FieldPath, float], toggled: tuple[int, ...]) -> Case:
        """Return the case with different numbers.

        Raises InputError if the known set makes the estimates start at the centre of the set instead. Such a start depends on all
        bounds at once, so it cannot be tabulated for the slider of a single bound.
        """
        case = self.source.at(numbers, toggled)
        if any(path.keys[0] == "uncertainty" for path in numbers) and not _alike(_starts(case), self._starts[bool(toggled)]):
            raise InputError("if the known set does not contain 0, the estimates start at its centre")
        return case

    @cached_property
    def _starts(self) -> tuple[list[Array], list[Array]]:
        """The initial estimates of the case, and those with the projections switched."""
        return _starts(self.case), _starts(self.source.at({}, self.toggles))

    @cached_property
    def _cases(self) -> dict[tuple[bool, FieldPath, float], Case]:
        """The cases that have been built. They are kept because each is read for several purposes."""
        return {}


def _starts(case: Case) -> list[Array]:
    if len(case.equations) == len(case.controllers):
        return [estimates_in(equations) for equations in case.equations]
    return [initial_estimates(case.problem, one) for one in case.controllers]


def _alike(one: Sequence[Array], other: Sequence[Array]) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def _agrees(target: Target, case: Case, found: tuple[Array, Array]) -> bool:
    try:
        made = target.read([case])
    except InputError:  # another structure
        return False
    return all((part == rows[:, 0]).all() for part, rows in zip(found, (made.parameters, made.states), strict=True))


def _precedence(given: tuple[FieldPath, float]) -> tuple[int, bool]:
    path, first = given[0], str(given[0].keys[0])
    return PRECEDENCE.index(first if first in PRECEDENCE else ""), isinstance(path.keys[-1], int)


Place = tuple[float, int]
"""A value of a slider, and its index among the tabulated values, if any."""
NEAR_SHARES = (0.04, 0.12)
"""Smallest and largest distance, as a fraction of the slider's length, by which a slider is moved up or down together with
others. Each slider uses a different value in between, so that two numbers that enter as a difference do not move equally. So
close to the case, all pairs should be valid."""
FAR_SHARES = ((0.1, 0.4), (0.1, 0.4), (0.4, 1.0), (0.4, 1.0))
"""Limits of further distances to one side. They differ because some pairs change the last bit only at some values."""
GOLDEN_RATIO = 0.6180339887498949
"""The fractional parts of its multiples are spread evenly, however many are taken."""
TRIED_TURNS = 1 + len(FAR_SHARES)


def places_tried(number: Number, k: int, turn: int, *, copied: bool, handed: bool) -> list[Place]:
    """Return the places tried for the k-th slider.

    In the first turn, these are one value to either side of the value in the case, near it; in later turns, one value farther
    away, different from earlier values if possible. A number that is not ``handed`` affects only the signals. Many of these may
    exclude each other, and each is tried once.

    copied  whether any value can be used, not only the tabulated ones
    handed  whether modules receive anything that follows from the number
    """
    low, high = (NEAR_SHARES, *FAR_SHARES)[turn]
    last = len(number.values) - 1
    own = int(np.searchsorted(number.values, number.value))
    step = max(1, round(last * (low + (high - low) * ((k + 1 + turn) * GOLDEN_RATIO % 1))))
    ways = [way for way in (-1, 1) if 0 <= own + way <= last]
    if turn > 0 or not handed:
        ways = [ways[(k + turn) % len(ways)]] if turn == 0 or handed else []
    values = [number.values[int(np.clip(own + way * step, 0, last))] for way in ways]
    if turn > 0 and copied and not number.whole:
        values = [number.value + GOLDEN_RATIO * (value - number.value) for value in values]
    return [(float(value), int(np.searchsorted(number.values, value))) for value in values]


# A setting tries all pairs among its numbers at once, so a few dozen settings suffice for hundreds of pairs; nothing is random.
# If a setting fails, the smallest failing set of numbers is sought.

Move = tuple[int, int]
"""The index of a number, numbered from 0, and the index of its trial value."""


class Outcome(Enum):
    """The result of a setting in which some numbers are moved and the others are as in the case."""

    FITS = auto()
    DIFFERS = auto()
    NO_CASE = auto()


@dataclass(eq=False)
class Together:
    """What is known about combinations of the numbers. Two numbers that one search found incompatible remain incompatible in the
    next search, which uses different values.

    kinds    (N,) the kind of each number. Numbers of one kind belong to one vector or matrix, which constructors take as a whole.
             If an entry of one must not be moved with an entry of another, the same is assumed of all pairs of their entries. The
             difference may show only at few values, in a last bit
    apart    (N, N) whether two numbers must not be moved together
    outcome  a function that returns the outcome of a setting with these moves, each of a different number
    dropped  numbers that fail by themselves
    """

    kinds: Sequence[object]
    apart: Array
    outcome: Callable[[Sequence[Move]], Outcome]
    dropped: set[int] = field(default_factory=set)

    def __post_init__(self) -> None:
        for one, two in np.argwhere(self.apart):
            self._part(int(one), int(two))

    def search(self, moves: Sequence[Move], *, everywhere: bool) -> None:
        """Try every pair of these moves. If cases should be valid ``everywhere``, two moves that give an invalid case are
        incompatible."""
        seen = Search(self, moves).seen()
        if everywhere:
            self.apart |= ~seen & ~np.eye(len(self.apart), dtype=bool)

    def part(self, numbers: Sequence[int]) -> None:
        """Record that any two of these numbers are incompatible."""
        for one, two in combinations(numbers, 2):
            self._part(one, two)

    def _part(self, one: int, two: int) -> None:
        of_one, of_two = ([i for i, kind in enumerate(self.kinds) if kind == self.kinds[k]] for k in (one, two))
        for i in of_one:
            for j in of_two:
                self.apart[i, j] = self.apart[j, i] = i != j


@dataclass(eq=False)
class Search:
    """One search, in which each number has some moves."""

    known: Together
    moves: Sequence[Move]

    def __post_init__(self) -> None:
        self._numbers = np.array([number for number, _ in self.moves], dtype=int)
        self._refused = self._numbers[:, None] == self._numbers  # True for two moves of the same number
        self._wanted = np.ones_like(self._refused)
        self._refused_sets: list[frozenset[int]] = []
        self._refuse_known()

    def seen(self) -> Array:
        """Try all pairs. Return for each pair of numbers (N, N) whether it is decided: combinable or incompatible."""
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
        """Return a setting: a pair that has not been tried, and further moves, each chosen to cover as many other pairs as
        possible."""
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
        """Return a minimal set of moves of a failing setting that fail together: without any one of them, the set does not
        fail."""
        needed: list[int] = []
        others = list(setting)
        while not needed or self._of(needed) is Outcome.FITS:
            fits, too_many = 0, len(others)  # indices of the other moves, besides those that are needed
            while too_many - fits > 1:
                middle = (fits + too_many) // 2
                fits, too_many = (middle, too_many) if self._of(needed + others[:middle]) is Outcome.FITS else (fits, middle)
            needed.append(others[fits])
            others = others[:fits]
        return needed

    def _refuse(self, moves: Sequence[int], outcome: Outcome) -> None:
        """Exclude from all further settings these moves or, if the numbers are incompatible, any two of their moves."""
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
