"""The admissible values of the parameters of a case, as conditions that C code can check.

The conditions are found by trying the ends of the interval that the case accepts for each number, at several points. All numbers
differ between these points, which distinguishes a constant bound from another number that happens to have the same value in this
case.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from barbalat.lowering import c99
from barbalat.lowering.c99 import Real
from barbalat.open_numbers.path import FieldPath
from barbalat.validate import Array

Entry = int | float
"""A number of the case, given by its index, or a constant."""
Accepts = Callable[[Array], bool]
"""Whether the case accepts these values of all numbers, (p,)."""


Text = Callable[[Entry], str]
"""A function that returns the printed text of an entry."""


@dataclass(frozen=True)
class Order:
    """low <= high, or low < high if ``strict``."""

    low: Entry
    high: Entry
    strict: bool

    @property
    def entries(self) -> tuple[Entry, ...]:
        """All numbers and constants of the condition."""
        return self.low, self.high

    def placed(self, at: Callable[[Entry], Entry]) -> Order:
        """The condition with different entries."""
        return Order(at(self.low), at(self.high), self.strict)

    def holds(self, values: Array) -> Array:
        """(K,) whether columns of numbers, (P, K), satisfy the condition."""
        low, high = (of(one, values) for one in self.entries)
        return np.asarray(low < high if self.strict else low <= high)

    def around(self, i: int, values: Array) -> tuple[float, float]:
        """The interval that this condition leaves for the i-th number if the others are constant."""
        return (-math.inf, of(self.high, values)) if is_number(i, self.low) else (of(self.low, values), math.inf)

    def as_c(self, text: Text, _real: Real) -> str:
        """A test in C."""
        equal = "" if self.strict else "="
        if isinstance(self.low, int):
            return f"{text(self.low)} <{equal} {text(self.high)}"
        return f"{text(self.high)} >{equal} {text(self.low)}"

    def of_number(self, i: int, name: Text) -> str:
        """The bound on the i-th number in words: "<= upper"."""
        equal = "" if self.strict else "="
        return f"<{equal} {name(self.high)}" if is_number(i, self.low) else f">{equal} {name(self.low)}"

    def in_words(self, name: Text) -> str:
        """The requirement in words: "gain must be > 0"."""
        first = self.low if isinstance(self.low, int) else self.high
        assert isinstance(first, int)
        return f"{name(first)} must be {self.of_number(first, name)}"


@dataclass(frozen=True)
class Apart:
    """Numbers of which at least one must differ from this constant."""

    numbers: tuple[Entry, ...]
    value: float

    @property
    def entries(self) -> tuple[Entry, ...]:
        """All numbers and constants of the condition."""
        return *self.numbers, self.value

    @property
    def always(self) -> bool:
        """Whether one of its constants differs, so that the condition holds for all values of the other entries."""
        return any(not isinstance(one, int) and one != self.value for one in self.numbers)

    def placed(self, at: Callable[[Entry], Entry]) -> Apart:
        """The condition with different entries."""
        return Apart(tuple(map(at, self.numbers)), self.value)

    def holds(self, values: Array) -> Array:
        """(K,) whether columns of numbers, (P, K), satisfy the condition."""
        return np.any([np.asarray(of(one, values) != self.value) for one in self.numbers], axis=0)

    def around(self, _i: int, _values: Array) -> tuple[float, float]:
        """The smallest interval that contains all admitted values."""
        return -math.inf, math.inf

    def as_c(self, text: Text, _real: Real) -> str:
        """A test in C."""
        return " || ".join(f"{text(one)} != {text(self.value)}" for one in self.numbers)

    def of_number(self, i: int, name: Text) -> str:
        """The bound on the number in words, such as "!= 0 where num[1] = 0"."""
        others = " and ".join(f"{name(one)} = {name(self.value)}" for one in self.numbers if not is_number(i, one))
        return f"!= {name(self.value)}" + (f" where {others}" if others else "")

    def in_words(self, name: Text) -> str:
        """The requirement in words."""
        if len(self.numbers) == 1:
            return f"{name(self.numbers[0])} must be != {name(self.value)}"
        return f"{', '.join(map(name, self.numbers))} must not all be {name(self.value)}"


@dataclass(frozen=True)
class Norm:
    """sqrt(weight) |values - centre|_2 <= radius, up to rounding: a ball of estimates, or the Frobenius norm of a covariance."""

    values: tuple[Entry, ...]
    centre: tuple[Entry, ...]
    radius: Entry
    weight: float = 1.0

    @property
    def entries(self) -> tuple[Entry, ...]:
        """All numbers and constants of the condition."""
        return (*self.values, *self.centre, self.radius)

    def placed(self, at: Callable[[Entry], Entry]) -> Norm:
        """The condition with different entries."""
        return Norm(tuple(map(at, self.values)), tuple(map(at, self.centre)), at(self.radius), self.weight)

    def holds(self, values: Array) -> Array:
        """(K,) whether columns of numbers, (P, K), satisfy the condition."""
        squares = sum((of(a, values) - of(b, values)) ** 2 for a, b in self._pairs)
        return np.asarray(np.sqrt(self.weight * squares) <= of(self.radius, values))

    def around(self, i: int, values: Array) -> tuple[float, float]:
        """The interval that this condition leaves for the i-th number if the others are constant."""
        if is_number(i, self.radius):
            return math.sqrt(self.weight) * math.hypot(*(of(a, values) - of(b, values) for a, b in self._pairs)), math.inf
        rest = [of(a, values) - of(b, values) for a, b in self._pairs if not (is_number(i, a) or is_number(i, b))]
        other = next(b if is_number(i, a) else a for a, b in self._pairs if is_number(i, a) or is_number(i, b))
        room = math.sqrt(max(of(self.radius, values) ** 2 / self.weight - sum(one * one for one in rest), 0.0))
        return of(other, values) - room, of(other, values) + room

    def as_c(self, text: Text, real: Real) -> str:
        """A test in C, which allows for the rounding of the sum and of its numbers."""
        apart = [text(a) if b == 0.0 and not isinstance(b, int) else f"({text(a)} - {text(b)})" for a, b in self._pairs]
        squares = " + ".join(f"{one} * {one}" for one in apart)
        weighted = squares if self.weight == 1.0 else f"{c99.constant(self.weight, real)} * ({squares})"
        allowed = c99.constant(1.0 + ROUNDINGS * float(np.finfo(real.numbers).eps), real)
        return f"{weighted} <= {text(self.radius)} * {text(self.radius)} * {allowed}"

    def of_number(self, i: int, name: Text) -> str:
        """The bound on the i-th number in words."""
        return f">= {self._norm(name)}" if is_number(i, self.radius) else f"{self._norm(name)} <= {name(self.radius)}"

    def in_words(self, name: Text) -> str:
        """The requirement in words."""
        return f"{self._norm(name)} must be <= {name(self.radius)}"

    def _norm(self, name: Text) -> str:
        apart = [name(a) if b == 0.0 and not isinstance(b, int) else f"{name(a)} - {name(b)}" for a, b in self._pairs]
        factor = "" if self.weight == 1.0 else f"sqrt({self.weight:g}) "
        return f"{factor}|{', '.join(apart)}|"

    @property
    def _pairs(self) -> Iterator[tuple[Entry, Entry]]:
        return zip(self.values, self.centre, strict=True)


ROUNDINGS = 64
"""Number of rounding errors that the test of a norm tolerates."""
Condition = Order | Apart | Norm


def of(entry: Entry, values: Array) -> Any:
    """The value of an entry, or its row of values."""
    return values[entry] if isinstance(entry, int) else entry


def is_number(i: int, entry: Entry) -> bool:
    """Whether an entry is the i-th number, rather than a constant of that value."""
    return isinstance(entry, int) and entry == i


def numbers(condition: Condition) -> set[int]:
    """The numbers on which a condition depends."""
    return {one for one in condition.entries if isinstance(one, int)}


def placed(conditions: Sequence[Condition], at: Callable[[int], Entry]) -> tuple[Condition, ...]:
    """The conditions with different indices, or with constants, for their numbers.

    Conditions without a number, and conditions that the constants always satisfy, are omitted.
    """
    found = (one.placed(lambda entry: at(entry) if isinstance(entry, int) else entry) for one in conditions)
    return tuple(one for one in found if numbers(one) and not (isinstance(one, Apart) and one.always))


class NotFoundError(Exception):
    """No condition describes the admissible values of these numbers, given by index."""

    def __init__(self, numbers: set[int]) -> None:
        super().__init__(f"no condition describes the accepted values of the numbers {sorted(numbers)}")
        self.numbers = numbers


CLOSE = 1e-9
"""Relative distance from a bound at which a value counts as just inside or just outside."""
MOST_SQUARE = 1e4
"""Largest weight of a norm that is sought: large numbers are all close to integers."""
NEAREST = 1e-20
"""Size of a value that counts as just inside a bound of zero."""
FAR = 1e3
"""Smallest ratio of the farthest tried value to the value in the case."""
FARTHEST = 1e6
"""Smallest size of the tried value that is farthest from the value in the case."""
MOVED = (0.3, -0.3, 0.05, -0.05, 1e-3, -1e-3)
"""Relative changes of a number that are tried for a different point, the largest ones first."""
POINTS = 2
"""Number of points at which bounds are compared, apart from the case itself."""
ROUNDS = 2
"""Number of times that each number is moved: an estimate between two equal bounds can move only after the bounds have moved."""


@dataclass(frozen=True, eq=False)
class Acceptance:
    """A search for the conditions of these numbers.

    paths    paths of the numbers, with their values in the case, (p,)
    accepts  whether the case accepts given values of these numbers
    norms    balls that the case is known to contain, which are tried if no other condition fits
    """

    paths: tuple[FieldPath, ...]
    values: Array
    accepts: Accepts
    norms: tuple[Norm, ...] = ()

    def conditions(self) -> tuple[Condition, ...]:
        """All conditions; raises NotFoundError if a number has a bound of an unknown kind."""
        found: dict[Condition, None] = {}
        lost: set[int] = set()
        for i in range(len(self.paths)):
            for side in (-1, 1):
                condition = self._end(i, side)
                if condition is not None:
                    found[condition] = None
                elif self._is_bounded(self.points[0], i, side):
                    lost.add(i)
        if lost:
            raise NotFoundError(lost)
        norms = [one for one in found if isinstance(one, Norm)]
        orders = [*(one for one in found if isinstance(one, Order)), *filter(None, map(self._above_zero, norms))]
        orders = [*orders, *self._not_both(orders)]
        apart = [Apart((i,), 0.0) for i in range(len(self.paths)) if self._is_apart(i, orders)]
        return (*orders, *apart, *self._lists_apart([*orders, *apart, *norms]), *norms)

    @cached_property
    def points(self) -> list[Array]:
        """Accepted values at which all numbers differ as far as the case allows; the values of the case come last."""
        random = np.random.default_rng(0)
        return [*(self._moved(random) for _ in range(POINTS)), self.values]

    def _moved(self, random: np.random.Generator) -> Array:
        found = self.values.copy()
        for _ in range(ROUNDS):
            for i, value in enumerate(self.values.tolist()):
                sign, size = random.choice([-1.0, 1.0]), (abs(value) or 1.0) * random.uniform(0.7, 1.0)
                tried = (found[i] + sign * share * size for share in MOVED)
                found[i] = next((one for one in tried if self._takes(found, i, one)), found[i])
        return found

    def _takes(self, point: Array, i: int, value: float) -> bool:
        there = point.copy()
        there[i] = value
        return self.accepts(there)

    def _far(self, i: int, side: int) -> float:
        return side * max(FARTHEST, FAR * abs(float(self.values[i])))

    def _is_bounded(self, point: Array, i: int, side: int) -> bool:
        return not self._takes(point, i, self._far(i, side))

    def _end(self, i: int, side: int) -> Condition | None:
        """The condition that ends the interval that the case accepts for a number; None if there is no end or its condition is
        unknown."""
        first = self.points[0]
        if not self._is_bounded(first, i, side):
            return None
        for entry in self._candidates(i):
            if self._ends_at(first, i, side, float(of(entry, first))) and (found := self._order(i, side, entry)) is not None:
                return found
        known = (norm for norm in self.norms if i in numbers(norm))
        if (norm := next((one for one in known if self._fits(one, i, side)), None)) is not None:
            return norm
        end = self._searched(first, i, side)
        norm = next((one for one in self._norms(i, end) if self._fits(one, i, side)), None)
        return self._order(i, side, end) if norm is None else norm

    def _candidates(self, i: int) -> list[Entry]:
        """Candidates for a bound: zero, the other numbers (the most similar ones first), and one."""
        keys = self.paths[i].keys
        others = [j for j in range(len(self.paths)) if j != i]
        others.sort(key=lambda j: (self.paths[j].keys[:1] == ("plant",), self.paths[j].keys[-1] != keys[-1], abs(j - i)))
        return [0.0, *others, 1.0, -1.0]

    def _ends_at(self, point: Array, i: int, side: int, end: float) -> bool:
        """Whether values just beyond this one are rejected, and values just before it are accepted."""
        own = float(point[i])
        if side * (end - own) < 0:
            return False
        step = CLOSE * (max(abs(end), abs(own)) or 1.0)
        inside = end if side * (end - own) <= step else end - side * (step if end else NEAREST)
        return not self._takes(point, i, end + side * step) and self._takes(point, i, inside)

    def _order(self, i: int, side: int, entry: Entry) -> Order | None:
        """The bound, if it holds at all points."""
        if not all(self._ends_at(point, i, side, float(of(entry, point))) for point in self.points):
            return None
        strict = not all(
            self._takes(point, i, float(of(entry, point))) for point in self.points if not self._empties(point, i, entry)
        )
        return Order(i, entry, strict) if side > 0 else Order(entry, i, strict)

    def _empties(self, point: Array, i: int, entry: Entry) -> bool:
        """Whether this value makes the whole list of the i-th number zero, which has a separate condition."""
        others = [j for j in self._list(i) if j != i]
        return len(others) > 0 and float(of(entry, point)) == 0.0 and not point[others].any()

    def _fits(self, norm: Norm, i: int, side: int) -> bool:
        return all(self._ends_at(point, i, side, norm.around(i, point)[side > 0]) for point in self.points)

    def _searched(self, point: Array, i: int, side: int) -> float:
        """The last accepted value, or the first rejected value if that is the shorter number."""
        inside, beyond = float(point[i]), self._far(i, side)
        while (middle := inside / 2 + beyond / 2) not in (inside, beyond):
            inside, beyond = (middle, beyond) if self._takes(point, i, middle) else (inside, middle)
        return beyond if len(repr(beyond)) < len(repr(inside)) / 2 else inside  # 1.0, not 0.9999999999999999

    def _norms(self, i: int, end: float) -> Iterator[Norm]:
        """Norms of numbers or of whole lists that may have this bound, with other numbers as their limits."""
        first = self.points[0].copy()
        first[i] = end
        for j in range(len(self.paths)):
            for radius, group in ((j, self._list(i)), (i, self._list(j))):
                if radius in group or self.paths[j].keys[0] != self.paths[i].keys[0]:
                    continue
                square = float(first[radius] ** 2 / max(np.sum(first[group] ** 2), np.finfo(float).tiny))
                if 1 <= round(square) <= MOST_SQUARE and abs(square - round(square)) <= CLOSE * square:
                    yield Norm(tuple(group), (0.0,) * len(group), radius, float(round(square)))

    def _list(self, i: int) -> list[int]:
        """The numbers of the list that contains the i-th number, or that number alone."""
        parent = self.paths[i].keys[:-1]
        whole = [j for j, path in enumerate(self.paths) if isinstance(path.keys[-1], int) and path.keys[:-1] == parent]
        return whole if i in whole else [i]

    def _above_zero(self, norm: Norm) -> Order | None:
        """The condition on the sign of a radius, which a test of squares does not determine; 0 is tried with the values at the
        centre."""
        there = self.values.copy()
        for value, centre in zip(norm.values, norm.centre, strict=True):
            if isinstance(value, int):
                there[value] = of(centre, there)
        if not isinstance(norm.radius, int):
            return None
        return Order(0.0, norm.radius, strict=not self._takes(there, norm.radius, 0.0))

    def _not_both(self, orders: Sequence[Order]) -> Iterator[Order]:
        """Pairs of numbers on either side of a constant, such as control limits; only one number of a pair may equal the
        constant."""
        below = [one for one in orders if isinstance(one.low, int) and not isinstance(one.high, int) and not one.strict]
        above = [one for one in orders if isinstance(one.high, int) and not isinstance(one.low, int) and not one.strict]
        for a in below:
            for b in above:
                assert isinstance(a.low, int) and isinstance(b.high, int)
                if a.high == b.low and self.paths[a.low].keys[:-1] == self.paths[b.high].keys[:-1]:
                    there = self.values.copy()
                    there[[a.low, b.high]] = a.high
                    if not self.accepts(there):
                        yield Order(a.low, b.high, strict=True)

    def _is_apart(self, i: int, orders: Sequence[Order]) -> bool:
        """Whether 0 is rejected within the accepted interval."""
        if any(0.0 in one.entries and i in numbers(one) and len(numbers(one)) == 1 for one in orders):
            return False
        near = CLOSE * (abs(float(self.values[i])) or 1.0)
        point = self.points[0]
        return not self._takes(point, i, 0.0) and self._takes(point, i, near) and self._takes(point, i, -near)

    def _lists_apart(self, known: Sequence[Condition]) -> Iterator[Apart]:
        """Lists that must not be all zero, such as a numerator, if no other condition implies this."""
        for whole in dict.fromkeys(tuple(self._list(i)) for i in range(len(self.paths))):
            if len(whole) == 1:
                continue
            zero, near = self.values.copy(), self.values.copy()
            zero[list(whole)] = 0.0
            near[list(whole)] *= CLOSE
            if all(one.holds(zero) for one in known) and not self.accepts(zero) and self.accepts(near):
                yield Apart(whole, 0.0)
