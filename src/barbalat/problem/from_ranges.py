"""Computes bounds on theta, the input gain and the unmatched remainder from ranges of physical parameters, in ball arithmetic.

With b = b(nominal), the model's A_m and weights W = diag(1/scale^2) of the states,

    A(p) = A_m + b theta'(p) + rest_A(p),      theta' = g (A(p) - A_m),
    b(p) gain(p) = b omega(p) + rest_b(p),     omega = g b(p) gain(p),

with g = (b'W b)^-1 b'W. This choice of theta and omega leaves the smallest remainders in the weighted norm. Both equations hold
exactly for the computed g, despite its rounding errors. A wide enclosure is refined by writing the quantity as a fraction of
polynomials (``rational.py``). The ranges are subdivided, into 3000 cells at most, until the width of every enclosure is within
1.05 times the width observed at points. With several inputs omega is the diagonal, and the off-diagonal entries belong to the
remainder.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from flint import arb, fmpq

from barbalat.linear.balls import Ball, as_arb
from barbalat.linear.enclosure import float_above, float_below
from barbalat.problem.known_set import KnownSet, ParameterBox
from barbalat.problem.laurent import ALONE, Product, Sum, added, multiplied, names_of, products_of, scaled, value_of
from barbalat.problem.parameters import Symbolic, evaluated
from barbalat.problem.physical import MATCHED_TO, PhysicalPlant, projected, projection, rounding_of_rest
from barbalat.problem.rational import Rational
from barbalat.validate import Array, InputError, show

TIGHTNESS = 1.05
"""The width of an enclosure is at most this multiple of the observed width, unless that would need more than MOST_CELLS cells."""
MOST_CELLS = 3000
"""Largest number of cells of the ranges. The enclosure is valid for any number of cells."""
MOST_CORNERS = 256
"""Largest number of corners of the ranges, or of a cell, at which the quantities are evaluated. If there are more, only the
centre is used."""
DRAWN = 2000
"""Number of points of the ranges at which the quantities are evaluated before the first cut."""
SMALLEST_PART = 2.0**-20
"""Fraction of a parameter's range below which the range is not cut further."""
SAME_TO = 1e-9
"""Relative difference up to which a bound that the user gave counts as equal to the derived bound: it may have been copied by
hand or computed in a different way."""
BOX_NOTE = "a box bounds {} independently: it contains plants that do not correspond to parameters in these ranges"


Box = Mapping[str, float]
"""One end of each parameter's range, or a point."""


class Members(NamedTuple):
    """Plants for parameters in their ranges: at the nominal values, at corners, and at random points in between."""

    uncertain: list[str]
    parameters: list[dict[str, float]]  # all parameters of each plant
    theta: Array  # (K, p)
    omega: Array  # (K, m)


@dataclass(frozen=True, eq=False, kw_only=True)
class FromRanges:
    """The known set and the remainders that follow from ranges of physical parameters.

    theta           box that contains theta(p) for all parameters in the ranges
    input_gain      pairs (lower, upper) that contain omega_i(p); None if b and the gains do not depend on uncertain parameters
    rest_A, rest_b  (n, n) and (n, m): bounds on the magnitudes of the entries that theta and omega cannot match
    scale           (n,) scales of the states, whose inverse squares are their weights; ``scale_from`` states their origin
    shares          the unmatched fraction of the change of A and of b over the range of each uncertain parameter, in the weighted
                    norm, |rest|/sqrt(|rest|^2 + |matched|^2); None if they do not change
    width_ratio     the largest ratio of an enclosure's width to the observed width
    cells           the number of cells into which the ranges were cut
    quantities, ranges  theta and omega as functions of the parameters, and their ranges, for ``members``
    physical        the plant, without a baseline's states
    used            whether this is the known set of the problem; otherwise the user gave a different set
    outside         a text on the part of this set that the user's set does not contain; empty if that set contains all of it
    """

    theta: ParameterBox
    input_gain: tuple[tuple[float, float], ...] | None
    rest_A: Array
    rest_b: Array
    scale: Array
    scale_from: str
    shares: Mapping[str, Mapping[str, float | None]]
    width_ratio: float
    cells: int
    nominal: Mapping[str, Any] = field(default_factory=dict)
    used: bool = True
    outside: str = ""
    quantities: _Quantities | None = field(default=None, repr=False)
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict, repr=False)
    physical: PhysicalPlant | None = field(default=None, repr=False)

    @property
    def uncertain(self) -> list[str]:
        """The parameters that have a range."""
        return [name for name, (low, high) in self.ranges.items() if low < high]

    def members(self, drawn: int) -> Members:
        """Return the plants at the nominal parameters, at up to MOST_CORNERS corners of the ranges, and at ``drawn`` points."""
        assert self.quantities is not None
        names, nominal, rng = self.uncertain, self.nominal["parameters"], np.random.default_rng(0)
        points = np.array([[nominal[name] for name in names]])
        if names:
            lower, upper = np.array([self.ranges[name] for name in names]).T
            box = ParameterBox(lower=lower, upper=upper)
            corners = box.extreme_points(rng, MOST_CORNERS)
            points = np.vstack([points, corners, box.drawn(rng, drawn)])
        columns = {name: np.full(len(points), value) for name, value in nominal.items()}
        columns |= {name: points[:, i] for i, name in enumerate(names)}
        p, m = self.quantities.sizes[:2]
        values = self.quantities.at(columns or {"": np.zeros(1)})
        each = [{name: float(column[k]) for name, column in columns.items()} for k in range(len(points))]
        return Members(names, each, values[:, :p], values[:, p : p + m])

    @property
    def is_matched(self) -> bool:
        """Whether theta and omega leave no remainder."""
        return not self.rest_A.any() and not self.rest_b.any()

    @cached_property
    def around(self) -> dict[str, str]:
        """The other quantities that the parameters change within their ranges, by their paths in a case file, each with its
        values at the corners. The text is empty for anything but a number."""
        if self.physical is None or not self.uncertain:
            return {}
        every = [self.physical.around(values) for values in self.members(0).parameters]
        found = {}
        for name, nominal in every[0].items():
            values = [one[name] for one in every]
            if any(not _same(value, nominal) for value in values):
                scalar = isinstance(nominal, float)
                found[name] = f"{min(values):.6g} to {max(values):.6g}" if scalar else ""
        return found

    @property
    def sizes(self) -> tuple[float, float]:
        """Bounds on the spectral norms of both remainders, which are the norms of the matrices of bounds on the entries."""
        return tuple(float(np.linalg.norm(one, 2)) * (1 + 1e-12) for one in (self.rest_A, self.rest_b))  # type: ignore[return-value]

    @property
    def unmatched(self) -> str:
        """A short text on the unmatched part; empty if everything is matched."""
        if self.is_matched:
            return ""
        size_A, size_b = self.sizes
        parts = [f"{size:.3g} in {name}" for size, name in ((size_A, "A"), (size_b, "b")) if size > 0]
        moved = any(share is not None and share > MATCHED_TO for by in self.shares.values() for share in by.values())
        leaves = "the parameters' ranges leave" if moved else "the declared plant leaves"
        return f"{leaves} unmatched remainders of up to {' and '.join(parts)}"

    @property
    def too_wide(self) -> str | None:
        """A sentence that an enclosure is wider than TIGHTNESS allows; otherwise None."""
        if self.width_ratio <= TIGHTNESS:
            return None
        return (
            f"a bound from the parameters' ranges is {self.width_ratio:.3g} times as wide as the values found at points in them, "
            f"although the ranges were cut into {self.cells} cells; narrow ranges or simpler formulas make it tighter"
        )

    @property
    def sentences(self) -> list[str]:
        """Sentences about the set, its excess width, the remainders, the weights and the conservatism of a box."""
        ends = zip(self.theta.lower, self.theta.upper, strict=True)
        said = [f"theta_{i + 1} in [{low:.6g}, {high:.6g}]" for i, (low, high) in enumerate(ends)]
        gains = self.input_gain or ()
        said += [
            f"omega{f'_{i + 1}' if len(gains) > 1 else ''} in [{low:.6g}, {high:.6g}]" for i, (low, high) in enumerate(gains)
        ]
        taken = "" if self.used else "; [uncertainty] in the case replaces the values that it states"
        found = [f"from the parameters' ranges: {', '.join(said)}{taken}"]
        if self.unmatched:
            each = [
                f"{100 * share:.0f} % of the change that {name} causes in {matrix}"
                for name, by in self.shares.items()
                for matrix, share in by.items()
                if share is not None and share > MATCHED_TO
            ]
            found.append(f"{self.unmatched}: {', '.join(each)}" if each else self.unmatched)
        if self.around:
            each = [f"{name} ({ends} at their corners)" if ends else name for name, ends in self.around.items()]
            found.append(
                f"the parameters' ranges also change {', '.join(each)}: guarantees about the motion hold for the declared "
                "values; margins over the ranges include the other values"
            )
        scale = ", ".join(f"{one:.3g}" for one in self.scale)
        found.append(f"the states are weighted by their scales {scale}, which are {self.scale_from}")
        if self.input_gain is not None or (self.theta.lower < self.theta.upper).sum() > 1:
            found.append(BOX_NOTE.format("the entries of theta" if self.input_gain is None else "theta and omega"))
        if self.outside:
            found.append(
                f"the [uncertainty] of the case does not contain everything that the parameter ranges allow: {self.outside}; no "
                "guarantee covers the ranges"
            )
        return found if self.too_wide is None else [*found, self.too_wide]

    def beyond(self, own: KnownSet | None, gains: Sequence[Sequence[float]] | None) -> str:
        """Return a phrase on what a known set of theta and intervals of the input gains do not contain."""
        said = []
        low, high = self.theta.lower, self.theta.upper
        if own is not None:
            if isinstance(own, ParameterBox):
                room = SAME_TO * np.maximum(1.0, np.maximum(np.abs(low), np.abs(high)))
                for i in np.flatnonzero((low < own.lower - room) | (high > own.upper + room)):
                    there = f"[{own.lower[i]:.6g}, {own.upper[i]:.6g}]"
                    said.append(f"theta_{i + 1} in [{low[i]:.6g}, {high[i]:.6g}], not only in {there}")
            elif (away := float(np.linalg.norm(np.maximum(own.center - low, high - own.center)))) > own.radius * (1 + SAME_TO):
                said.append(f"theta up to {away:.6g} from the centre, but the radius is {own.radius:.6g}")
        for k, (least, most) in enumerate(self.input_gain or ()):
            name = f"omega_{k + 1}" if len(self.input_gain or ()) > 1 else "omega"
            found = f"{name} in [{least:.6g}, {most:.6g}]"
            if gains is None:
                said.append(f"{found}, but the input gain is assumed to be known")
            elif least < gains[k][0] * (1 - SAME_TO) or most > gains[k][1] * (1 + SAME_TO):
                said.append(f"{found}, not only in [{gains[k][0]:.6g}, {gains[k][1]:.6g}]")
        return ", ".join(said)

    def as_json(self) -> dict[str, Any]:
        """Return all derived quantities, with the tightness of the bounds."""
        size_A, size_b = self.sizes
        return {
            "nominal": dict(self.nominal),
            "theta": {"lower": self.theta.lower.tolist(), "upper": self.theta.upper.tolist()},
            "input_gain": None if self.input_gain is None else [list(pair) for pair in self.input_gain],
            "unmatched": {
                "A": {"entries": self.rest_A.tolist(), "norm": size_A},
                "b": {"entries": self.rest_b.tolist(), "norm": size_b},
                "shares": {name: dict(by) for name, by in self.shares.items()},
            },
            "scale": self.scale.tolist(),
            "scale_from": self.scale_from,
            "width_ratio": self.width_ratio,
            "cells": self.cells,
            "used": self.used,
            "sentences": self.sentences,
        }


@dataclass(frozen=True, eq=False)
class _Quantities:
    """theta, omega and the remainders as linear combinations of products of parameters. They can be evaluated on balls or on many
    points at once.

    sums       one for each quantity, in the order theta row by row, omega, remainder of A, remainder of b
    products   the products that occur in the sums
    rationals  fractions of polynomials by the index of their quantity, which are made when they are needed
    """

    sums: list[Sum]
    sizes: tuple[int, int, int, int]
    b_bar: Array  # (n, m)
    rationals: dict[int, Rational | None] = field(default_factory=dict)

    @classmethod
    def of(cls, plant: PhysicalPlant, A_m: Array, b: Array, scale: Array) -> _Quantities:
        n = len(A_m)
        b_bar, g = b.reshape(n, -1), projection(b, scale)
        m = b_bar.shape[1]
        D = [[added(_products(plant.A[i][j]), _products(-float(A_m[i, j]))) for j in range(n)] for i in range(n)]
        rows = [row if isinstance(row, (list, tuple)) else [row] for row in plant.b]
        through = [[multiplied(_products(row[k]), _products(gain)) for k, gain in enumerate(plant.gains(m))] for row in rows]
        theta = [[_combined(g[k], [D[i][j] for i in range(n)]) for k in range(m)] for j in range(n)]
        omega = [_combined(g[k], [through[i][k] for i in range(n)]) for k in range(m)]
        rest_A = [added(D[i][j], _combined(-b_bar[i], theta[j])) for i in range(n) for j in range(n)]
        rest_b = [added(through[i][k], scaled(omega[k], -float(b_bar[i, k]))) for i in range(n) for k in range(m)]
        return cls([*(one for row in theta for one in row), *omega, *rest_A, *rest_b], (n * m, m, n * n, n * m), b_bar)

    @cached_property
    def products(self) -> list[Product]:
        return list(dict.fromkeys(product for one in self.sums for product in one))

    @cached_property
    def names(self) -> list[frozenset[str]]:
        """The names of the parameters on which each quantity depends."""
        return [frozenset().union(*map(names_of, one)) for one in self.sums]

    @cached_property
    def factors(self) -> Array:
        """The coefficients (quantities, products), rounded."""
        return np.array([[_as_float(one.get(product, 0)) for product in self.products] for one in self.sums])

    def at(self, values: Mapping[str, Array]) -> Array:
        """Return the quantities (K, quantities) at K points."""
        count = len(next(iter(values.values())))
        with np.errstate(all="ignore"):
            each = [np.broadcast_to(value_of(product, values), (count,)) for product in self.products]
            return np.array(each).reshape(len(each), count).T @ self.factors.T

    @cached_property
    def _exact(self) -> list[list[tuple[int, arb]]]:
        """The products of each quantity with their coefficients, as balls that contain the exact numbers."""
        places = {product: i for i, product in enumerate(self.products)}
        return [[(places[p], arb(fmpq(f.numerator, f.denominator))) for p, f in one.items()] for one in self.sums]

    def enclosed(self, low: Box, high: Box, least: Array, most: Array) -> tuple[Array, Array, list[Box]]:
        """Return lower and upper bounds (quantities,) over a box of parameters, refined for quantities outside ``least`` and
        ``most``. Also return points of the box at which the refined quantities are large or small."""
        values = {name: Ball(arb(low[name]).union(arb(high[name]))) for name in low}
        each = [as_arb(value_of(product, values)) for product in self.products]
        found = [sum((factor * each[place] for place, factor in one), arb(0)) for one in self._exact]
        finite = [one.is_finite() for one in found]
        lows = np.array([float_below(one) if known else -np.inf for one, known in zip(found, finite, strict=True)])
        highs = np.array([float_above(one) if known else np.inf for one, known in zip(found, finite, strict=True)])
        points: list[Box] = []
        for i in np.flatnonzero((lows < least) | (highs > most)):
            rational = self._rational(int(i))
            if rational is not None:
                lower, upper, own = rational.bounds(low, high)
                lows[i], highs[i] = max(lows[i], lower), min(highs[i], upper)
                points += own
        return lows, highs, points

    def _rational(self, i: int) -> Rational | None:
        """Return a quantity as a fraction of polynomials; None if these are too large."""
        if i not in self.rationals:
            self.rationals[i] = Rational.of(self.sums[i])
        return self.rationals[i]


def _as_float(number: Fraction | int) -> float:
    try:
        return float(number)
    except OverflowError:
        return math.inf if number > 0 else -math.inf


def _products(entry: Any) -> Sum:
    if isinstance(entry, (str, Symbolic)):
        return products_of(entry.text if isinstance(entry, Symbolic) else entry)
    return scaled({ALONE: Fraction(1)}, float(entry))


def _combined(factors: Array, sums: Sequence[Sum]) -> dict[Product, Fraction]:
    """Return a linear combination in exact arithmetic, in which terms may cancel."""
    return added(*(scaled(one, float(factor)) for factor, one in zip(factors, sums, strict=True)))


@dataclass(frozen=True, eq=False)
class _Enclosure:
    low: Array
    high: Array
    seen_low: Array
    seen_high: Array
    floor: Array
    cells: int

    @property
    def ratio(self) -> float:
        """The largest ratio of an enclosure's width to the observed width, or to rounding error if a quantity varies by no more
        than that."""
        rounding = np.maximum(self.floor, MATCHED_TO * np.maximum(np.abs(self.seen_low), np.abs(self.seen_high)))
        widths, seen = self.high - self.low, np.maximum(self.seen_high - self.seen_low, rounding)
        known = seen > 0
        return float((widths[known] / seen[known]).max(initial=1.0))


_found: dict[Hashable, _Enclosure] = {}
"""Cached enclosures by their inputs. Most members of a study share them, and some take half a second to compute."""
MOST_KEPT = 64


def _enclosed_once(found: _Quantities, ranges: Mapping[str, tuple[float, float]], floor: Array) -> _Enclosure:
    key = tuple(tuple(one.items()) for one in found.sums), tuple(ranges.items()), floor.tobytes()
    if key not in _found:
        if len(_found) >= MOST_KEPT:
            _found.clear()
        _found[key] = _enclosed(found, ranges, floor)
    return _found[key]


def _enclosed(found: _Quantities, ranges: Mapping[str, tuple[float, float]], floor: Array) -> _Enclosure:
    """Return enclosures over the ranges, which are cut if one is too wide. Values up to ``floor`` (quantities,) count as zero."""
    names = [name for name, (low, high) in ranges.items() if low < high]
    low, high = ({name: ends[side] for name, ends in ranges.items()} for side in (0, 1))
    depends = found.names
    seen = _Seen(found, floor)
    seen.add(_columns(_points(names, low, high, DRAWN), names, ranges))
    if not np.isfinite([seen.low, seen.high]).all():
        unbounded = np.full(len(seen.low), np.inf)  # there is a pole at a corner of the ranges
        return _Enclosure(-unbounded, unbounded, seen.low, seen.high, floor, 1)
    boxes, first = [(low, high)], seen.enclosed(low, high)
    lows, highs = first[0][None], first[1][None]
    while len(boxes) < MOST_CELLS:
        above, below = (highs.max(axis=0) - seen.high) / seen.room, (seen.low - lows.min(axis=0)) / seen.room
        worst = int(np.argmax(np.maximum(above, below)))
        if max(above[worst], below[worst]) <= 1 or not names:
            break
        cell = int(np.argmax(highs[:, worst]) if above[worst] > below[worst] else np.argmin(lows[:, worst]))
        low, high = boxes[cell]
        side = _widest(found, names, low, high, ranges, depends[worst], worst)
        if high[side] - low[side] < SMALLEST_PART * (ranges[side][1] - ranges[side][0]):
            break  # no bound can be found: there is a pole within the ranges
        middle = (low[side] + high[side]) / 2
        halves = [(low, {**high, side: middle}), ({**low, side: middle}, high)]
        for half in halves:
            seen.add(_columns(_points(names, *half, 0), names, ranges))
        made = [seen.enclosed(*half) for half in halves]
        boxes[cell] = halves[0]
        boxes.append(halves[1])
        lows[cell], highs[cell] = made[0]
        lows, highs = np.vstack([lows, made[1][0]]), np.vstack([highs, made[1][1]])
    return _Enclosure(lows.min(axis=0), highs.max(axis=0), seen.low, seen.high, floor, len(boxes))


class _Seen:
    """The smallest and the largest value of each quantity at the tried points, ``low`` and ``high``."""

    def __init__(self, quantities: _Quantities, floor: Array) -> None:
        self.quantities, self.floor = quantities, floor
        self.low, self.high = (np.full(len(floor), sign * np.inf) for sign in (1, -1))

    def add(self, values: Mapping[str, Array]) -> None:
        """More points."""
        found = self.quantities.at(values)
        self.low, self.high = np.fmin(self.low, np.fmin.reduce(found)), np.fmax(self.high, np.fmax.reduce(found))

    @property
    def room(self) -> Array:
        """The amount by which a bound may exceed the observed values."""
        return np.maximum((TIGHTNESS - 1) / 2 * (self.high - self.low), self.floor)

    def enclosed(self, low: Box, high: Box) -> tuple[Array, Array]:
        """Return bounds over a cell, refined if they exceed the observed values by more than ``room``."""
        lows, highs, points = self.quantities.enclosed(low, high, self.low - self.room, self.high + self.room)
        if points:
            self.add({name: np.array([point[name] for point in points]) for name in low})
        return lows, highs


def _points(names: list[str], low: Box, high: Box, drawn: int) -> Array:
    """Return points (K, names): the centre, the corners if there are few, and uniformly distributed points."""
    a, b = (np.array([side[name] for name in names]) for side in (low, high))
    corners = np.array(list(product(*zip(a, b, strict=True)))) if 2 ** len(names) <= MOST_CORNERS else np.array([a, b])
    inside = np.random.default_rng(0).uniform(a, b, (drawn, len(names)))
    return np.vstack([(a + b)[None] / 2, corners, inside])


def _columns(points: Array, names: list[str], ranges: Mapping[str, tuple[float, float]]) -> dict[str, Array]:
    fixed = {name: np.full(len(points), low) for name, (low, _) in ranges.items()}
    return fixed | {name: points[:, i] for i, name in enumerate(names)}


def _widest(
    found: _Quantities,
    names: list[str],
    low: Box,
    high: Box,
    ranges: Mapping[str, tuple[float, float]],
    concerned: frozenset[str],
    quantity: int,
) -> str:
    """Return the parameter along which a quantity changes most in a cell, among those whose part of the range is still large
    enough to cut."""
    own = [name for name in names if name in concerned]
    centre = np.array([(low[name] + high[name]) / 2 for name in names])
    points = np.repeat(centre[None], 2 * len(own), axis=0)
    for k, name in enumerate(own):
        points[2 * k, names.index(name)], points[2 * k + 1, names.index(name)] = low[name], high[name]
    values = found.at(_columns(points, names, ranges))[:, quantity].reshape(-1, 2)
    change = np.abs(values[:, 1] - values[:, 0])
    share = np.array([(high[name] - low[name]) / (ranges[name][1] - ranges[name][0]) for name in own])
    # a quantity that changes little may still have a wide enclosure; in that case the widest part of a range is cut
    return own[
        int(np.argmax(np.where(np.isfinite(change), change, 0.0) / (change.max(initial=0.0) or 1.0) * share + 0.25 * share))
    ]


def _same(one: Any, other: Any) -> bool:
    """Return whether two values, nested lists or tables are equal."""
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return np.array_equal(one, other)
    return bool(one == other)


def from_ranges(plant: PhysicalPlant, A_m: Array, b: Array, scale: Array, scale_from: str) -> FromRanges:
    """Return the known set and the remainders. ``b`` is that of the nominal plant.

    Raises InputError if a formula has no bound over the ranges.
    """
    n, quantities = len(A_m), _Quantities.of(plant, A_m, b, scale)
    m = quantities.b_bar.shape[1]
    A, _ = plant.matrices(plant.nominal)
    b_bar, g = quantities.b_bar, projection(b, scale)
    found = _enclosed_once(quantities, plant.ranges, _roundings(np.abs(A) + np.abs(A_m), np.abs(b_bar), b_bar, g))
    _require_finite(plant, found)
    nominal = quantities.at({name: np.array([value]) for name, value in plant.nominal.items()} or {"": np.zeros(1)})[0]
    gains = evaluated("plant.input.gain", plant.gains(m), plant.nominal)
    nominal[: n * m + m] = np.concatenate([projected(A, A_m, b, scale), gains])  # rounded like the plant's numbers
    moves = np.array([any(low < high for low, high in (plant.ranges[name] for name in names)) for names in quantities.names])
    low, high = (np.where(moves, end(one, nominal), nominal) for end, one in ((np.minimum, found.low), (np.maximum, found.high)))
    ends = np.cumsum(quantities.sizes)
    largest_rest = np.maximum(np.abs(low), np.abs(high))
    thetas, omegas, rests_A, rests_b = np.split(largest_rest, ends[:-1])
    largest_A = 2 * np.abs(A_m) + np.abs(b_bar) @ thetas.reshape(n, m).T + rests_A.reshape(n, n)
    nothing = _roundings(largest_A, np.abs(b_bar) * omegas + rests_b.reshape(n, m), b_bar, g)
    largest_rest = np.where(largest_rest <= nothing, 0.0, largest_rest)
    uncertain_gain = moves[ends[0] : ends[1]].any()
    intervals = tuple(zip(low[ends[0] : ends[1]].tolist(), high[ends[0] : ends[1]].tolist(), strict=True))
    for lower, _ in intervals if uncertain_gain else ():
        if not lower > 0:
            raise InputError.of(
                "parameters",
                f"must keep the input gain positive, but over the ranges it is as low as {lower:g} times nominal",
            )
    return FromRanges(
        theta=ParameterBox(lower=low[: ends[0]], upper=high[: ends[0]]),
        input_gain=intervals if uncertain_gain else None,
        rest_A=largest_rest[ends[1] : ends[2]].reshape(n, n),
        rest_b=largest_rest[ends[2] :].reshape(n, m),
        scale=scale,
        scale_from=scale_from,
        shares=_shares(plant, quantities, scale),
        width_ratio=found.ratio,
        cells=found.cells,
        quantities=_Quantities(quantities.sums, quantities.sizes, quantities.b_bar),
        ranges=plant.ranges,
        physical=plant,
        nominal={"parameters": plant.nominal, "A": A.tolist(), "b": np.asarray(b).tolist(), "theta": nominal[: ends[0]].tolist()},
    )


def _roundings(of_A: Array, of_b: Array, b_bar: Array, g: Array) -> Array:
    """Return the size (quantities,) up to which each quantity is rounding error, for numbers of these sizes in A - A_m (n, n) and
    in b (n, m)."""
    theta = MATCHED_TO * (np.abs(g) @ of_A).T
    rests = rounding_of_rest(of_A, b_bar, g), rounding_of_rest(of_b, b_bar, g)
    found = np.concatenate([theta.reshape(-1), np.full(len(g), MATCHED_TO), *(one.reshape(-1) for one in rests)])
    return np.asarray(np.maximum(found, np.finfo(float).tiny))


def _require_finite(plant: PhysicalPlant, found: _Enclosure) -> None:
    if np.isfinite(found.low).all() and np.isfinite(found.high).all():
        return
    ranges = ", ".join(f"{name} in [{low:g}, {high:g}]" for name, (low, high) in plant.ranges.items() if low < high)
    raise InputError.of(
        "parameters", f"must have ranges over which plant.A, plant.b and the gain are bounded, got {show(ranges)}"
    )


def _shares(plant: PhysicalPlant, quantities: _Quantities, scale: Array) -> dict[str, dict[str, float | None]]:
    """Return for each uncertain parameter the unmatched fraction of the change of A and of b from one end of its range to the
    other."""
    n, m = quantities.b_bar.shape
    found: dict[str, dict[str, float | None]] = {}
    for name, ends in plant.ranges.items():
        if ends[0] == ends[1]:
            continue
        values = {other: np.full(2, value) for other, value in plant.nominal.items()} | {name: np.array(ends)}
        changes = np.diff(quantities.at(values), axis=0)[0]
        theta, omega, rest_A, rest_b = np.split(changes, np.cumsum(quantities.sizes)[:-1])
        rests = rest_A.reshape(n, n), rest_b.reshape(n, m)
        matched = quantities.b_bar @ theta.reshape(n, m).T, quantities.b_bar * omega
        beside = scale, np.ones(m)
        found[name] = {
            matrix: _share(rest / scale[:, None] * column, part / scale[:, None] * column)
            for matrix, rest, part, column in zip(("A", "b"), rests, matched, beside, strict=True)
        }
    return found


def _share(rest: Array, matched: Array) -> float | None:
    """Return the fraction of the remainder; None without a change.

    With one input the two parts are orthogonal, and the root is the size of the whole change. With several inputs the two parts
    of b are not orthogonal, and the remainder may be larger than the change.
    """
    size = math.hypot(float(np.linalg.norm(rest)), float(np.linalg.norm(matched)))
    return float(np.linalg.norm(rest)) / size if size > 0 else None
