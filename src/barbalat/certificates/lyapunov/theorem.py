"""Proves or rejects V' <= -W for an author's Lyapunov function, and derives bounds; docs/own-laws.md has the theorem.

Every step uses rational arithmetic: the form of V, quantities that stay zero, matrices that stay positive semidefinite,
projections, the decay as a sum of squares (if necessary over cells of the known set), and the proof that no solution escapes in
finite time.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from math import comb
from typing import Any, NamedTuple

import numpy as np
from flint import arb, fmpq, fmpq_mat

from barbalat.certificates.lyapunov.rational import Rational, Ring, as_float, exact_number
from barbalat.certificates.lyapunov.reading import Reading
from barbalat.certificates.lyapunov.squares import Squares, is_positive_definite, is_positive_semidefinite, sum_of_squares
from barbalat.linear.enclosure import float_above
from barbalat.problem.known_set import KnownSet
from barbalat.validate import Array

NEARLY = fmpq(1) - fmpq(1, 2**20)
"""The fraction of W that is proven. The P of a case is rounded, so V' = -|e|^2 holds only up to rounding."""
LEAST_SHARES = (fmpq(1, 2), fmpq(1, 2**10))
"""Multiples of |e|^2 that are tried as decay rates of V."""
MOST_CELLS = 64
MOST_VERTICES = 4096
TRIALS = 4000


class Refused(ValueError):
    """Raised if nothing follows from the supplied functions; the reason is part of a sentence."""


class Cell(NamedTuple):
    """A cell of the known set with a sum of squares for each Bernstein coefficient, or with the halves of the cell.

    side  the component of theta at whose value ``at`` the cell is cut
    """

    squares: list[Squares]
    side: int = -1
    at: fmpq = fmpq(0)
    halves: tuple[Cell, ...] = ()

    @property
    def leaves(self) -> int:
        """The number of cells that are not cut."""
        return sum(one.leaves for one in self.halves) if self.halves else 1


class Nonnegative(NamedTuple):
    """The proof that the numerator of a function is nonnegative: a sum of squares for every theta, or sums of squares over cells
    of the known set."""

    found: Squares | Cell

    @property
    def how(self) -> str:
        """The proof, as part of a sentence."""
        if isinstance(self.found, Squares):
            return "a sum of squares"
        count = self.found.leaves
        return (
            f"a sum of squares on each of {count} cells of the known set" if count > 1 else "a sum of squares over the known set"
        )


class Recorded(NamedTuple):
    """The proof that R stays nonnegative: v'Sv >= 0. R, v and F are indices of variables, and R = F F'."""

    R: list[list[int]]
    v: list[int]
    F: list[list[int]]
    squares: Squares


class Share(NamedTuple):
    """The proof that V falls at least as fast as a share of W or of |e|^2."""

    share: fmpq
    proof: Nonnegative


class Steps(NamedTuple):
    """The parts of the proof.

    recorded  the proof of each matrix that stays nonnegative
    decay     None if V' = -W identically
    limit     the share of |e|^2; None if it is not shown that e converges to zero
    """

    W: Nonnegative
    recorded: list[Recorded]
    decay: Share | None
    limit: Share | None


@dataclass(frozen=True, eq=False)
class Shown:
    """V' <= -W was proven, with V = z'M z and z = (e, s - L theta).

    places     indices of s among the variables
    inverse    M^-1, exact
    how        the proof, as part of a sentence
    over_the_set  whether part of the proof holds only for theta in the known set
    """

    reading: Reading
    places: tuple[int, ...]
    M: fmpq_mat
    inverse: fmpq_mat
    M_ss: fmpq_mat
    L: fmpq_mat
    how: str
    steps: Steps
    over_the_set: bool

    @property
    def converges(self) -> bool:
        """Whether V decreases by a fraction of |e|^2 and u is bounded, so that e converges to zero."""
        return self.steps.limit is not None

    def error_bound(self, level: arb) -> float:
        """A bound on every component of e, from V(0)."""
        return self._bound(range(len(self.reading.e)), level)

    def estimates_bound(self, level: arb) -> float | None:
        """A bound on every component of the estimates of theta; None if V contains no such estimates."""
        first = self.reading.state.start
        rows = [
            row
            for part in self.reading.parts
            if part.role.kind == "estimates"
            for row in range(part.start, part.start + part.size)
        ]
        found = [len(self.reading.e) + i for i, place in enumerate(self.places) if place - first in rows and self._is_of_theta(i)]
        return self._bound(found, level) if found else None

    def _is_of_theta(self, i: int) -> bool:
        row = [self.L[i, j] for j in range(self.L.ncols())]
        return sorted(row) == [*[fmpq(0)] * (len(row) - 1), fmpq(1)]

    def _bound(self, rows: Sequence[int], level: arb) -> float:
        return max(float_above((arb(self.inverse[i, i]) * level).sqrt()) for i in rows)

    def initial_level(self, theta: Array) -> arb:
        """V(0) for these parameters; e(0) = 0."""
        start = fmpq_mat([[self.reading.start[place - self.reading.state.start]] for place in self.places])
        off = start - self.L * fmpq_mat([[exact_number(value)] for value in theta.tolist()])
        return arb((off.transpose() * self.M_ss * off)[0, 0])

    def worst_level(self, known_set: KnownSet) -> arb | None:
        """The largest V(0) over the box around the known set: V is convex in theta. None for a set of too many vertices."""
        lower, upper = known_set.extent
        vertices = 2 ** int(np.count_nonzero(lower < upper))
        if vertices > MOST_VERTICES or not (np.isfinite(lower).all() and np.isfinite(upper).all()):
            return None
        corners = product(*(sorted({a, b}) for a, b in zip(lower.tolist(), upper.tolist(), strict=True)))
        found = arb(0)
        for corner in corners:
            found = found.max(self.initial_level(np.array(corner)))
        return found


def shown(reading: Reading, known_set: KnownSet | None) -> Shown:
    """The proof; raises Refused, with the reason, if a step fails."""
    ring, declared = reading.ring, reading.declared
    V = _one(ring, declared.V, "V")
    form = _QuadraticForm(reading, V)
    solved = _what_stays_zero(reading)
    factors, recorded = _what_stays_nonnegative(reading, solved)
    substituted = _Substitution(ring, solved, factors, form.shifted)
    W = substituted.of(_one(ring, declared.W, "W"))
    _require_projections(reading, known_set, form.places)
    falls = _without_normals(reading, substituted.of(-reading.along(V)))
    _require_positive_denominators(reading, falls, W)
    cells = _Cells(reading, known_set)
    of_W = cells.show(W)
    if of_W is None:
        raise Refused("W is not shown to be nonnegative everywhere")
    how, decay = _decay(cells, falls, W)
    _require_motion(reading, form.places)
    bounded = {*reading.e, *reading.x, *reading.r, *form.places}
    u_bounded = all(_variables(reading, one) <= bounded for one in reading.control)
    steps = Steps(of_W, recorded, decay, _limit(cells, falls) if u_bounded else None)
    return Shown(reading, form.places, form.M, form.M.inv(), form.M_ss, form.L, how, steps, cells.used)


def _decay(cells: _Cells, falls: Rational, W: Rational) -> tuple[str, Share | None]:
    if (falls - W).is_zero:
        return "V' = -W identically", None
    for share, said in ((fmpq(1), "W"), (NEARLY, "(1 - 2^-20) W")):
        found = None if W.is_zero else cells.show(falls - share * W)
        if found is not None:
            return f"-V' - {said} is {found.how}", Share(share, found)
    found = cells.show(falls) if W.is_zero else None
    if found is None:
        raise Refused(f"V' <= -W is {_counterexample(cells, falls - NEARLY * W)}")
    return f"-V' is {found.how}", Share(fmpq(0), found)


def _limit(cells: _Cells, falls: Rational) -> Share | None:
    ring, e = cells.reading.ring, cells.reading.e
    square = sum((ring.variables[i] ** 2 for i in e), ring.constant(fmpq(0)))
    for share in LEAST_SHARES:
        found = cells.show(falls - share * square)
        if found is not None:
            return Share(share, found)
    return None


def _variables(reading: Reading, one: Rational) -> set[int]:
    """The variables in a function, including those inside its functions."""
    found: set[int] = set()
    for place in one.used:
        if place in reading.ring.functions:
            found |= _variables(reading, reading.ring.functions[place][1])
        elif place in reading.phi:
            found |= set(reading.x)
        else:
            found.add(place)
    return found


def _one(ring: Ring, value: Any, name: str) -> Rational:
    found = ring.exact(value)
    if not isinstance(found, Rational):
        raise Refused(f"{name} must be a number, but is an array")
    return found


class _QuadraticForm:
    """V as z'M z with z = (e, s - L theta); raises Refused if V does not have this form or is not positive definite."""

    def __init__(self, reading: Reading, V: Rational) -> None:
        if not V.den.is_constant() or any(sum(powers) != 2 for powers in V.num.to_dict()):
            raise Refused("V is not a quadratic form in e, the state and theta with constant coefficients")
        if not V.used <= {*reading.e, *reading.state, *reading.theta}:
            raise Refused("V must depend only on e = x - x_m, the state and theta")
        self.reading = reading
        self.places = tuple(place for place in reading.state if place in V.used)
        terms = V.num.to_dict()
        count = reading.ring.context.nvars()

        def block(rows: Sequence[int], columns: Sequence[int]) -> fmpq_mat:
            def entry(i: int, j: int) -> fmpq:
                powers = [0] * count
                powers[i] += 1
                powers[j] += 1
                return terms.get(tuple(powers), fmpq(0)) * (1 if i == j else fmpq(1, 2))

            return fmpq_mat(len(rows), len(columns), [entry(i, j) for i in rows for j in columns])

        e, s, theta = list(reading.e), list(self.places), list(reading.theta)
        self.M, self.M_ss = block(e + s, e + s), block(s, s)
        if not is_positive_definite(self.M):
            raise Refused("V is not positive definite in e and in the parts of the state that it contains")
        across = block(s, theta)
        self.L = -(self.M_ss.solve(across) if s else across)
        if block(theta, theta) + across.transpose() * self.L != fmpq_mat(len(theta), len(theta)) or block(e, theta) + block(
            e, s
        ) * self.L != fmpq_mat(len(e), len(theta)):
            raise Refused("V is not zero at e = 0 with the estimates equal to theta")

    @property
    def shifted(self) -> dict[int, Rational]:
        """s written as its deviation plus L theta; in these variables the decay has the fewest terms."""
        variables, theta = self.reading.ring.variables, self.reading.theta
        return {
            place: variables[place] + sum((variables[one] * self.L[i, j] for j, one in enumerate(theta)), variables[place] * 0)
            for i, place in enumerate(self.places)
        }


def _arrays(declared: Any) -> list[Any]:
    """Arrays that are given singly or in a tuple, without empty ones."""
    return [one for one in (declared if isinstance(declared, tuple) else (declared,)) if np.size(one)]


def declared_zero(reading: Reading) -> list[Rational]:
    """The quantities that the author declares to stay zero."""
    arrays = _arrays(reading.declared.zero)
    return [reading.ring.exact(one) for array in arrays for one in np.ravel(np.asarray(array, dtype=object))]


def _what_stays_zero(reading: Reading) -> dict[int, Rational]:
    """Quantities that are zero at the start and whose rates vanish with them, solved for equally many parts of the state."""
    ring = reading.ring
    relations = declared_zero(reading)
    start = dict(zip(reading.state, map(ring.constant, reading.start), strict=True))
    x0 = dict(zip(reading.x, reading.x0, strict=True))
    rest = {place: ring.constant(fmpq(0)) for place in reading.e}
    solved: dict[int, Rational] = {}
    for number, relation in enumerate(relations, start=1):
        name = f"quantity {number} of those declared to stay zero"
        if not relation.replaced(start | x0 | rest).is_zero:
            raise Refused(f"{name} is not zero at t = 0 for every theta")
        left = relation.replaced(solved)
        if left.is_zero:
            continue
        place = next((i for i in reading.state if left.derivative(i).is_constant and not left.derivative(i).is_zero), None)
        if place is None:
            raise Refused(f"{name} does not determine a part of the state: one part must occur in it with a constant factor")
        value = ring.variables[place] - left / left.derivative(place)
        solved = {i: one.replaced({place: value}) for i, one in solved.items()} | {place: value}
    for number, relation in enumerate(relations, start=1):
        if not reading.along(relation).replaced(solved).is_zero:
            raise Refused(
                f"quantity {number} is declared to stay zero but does not: its rate is not zero where all these quantities are "
                f"zero"
            )
    return solved


def _what_stays_nonnegative(reading: Reading, solved: dict[int, Rational]) -> tuple[dict[int, Rational], list[Recorded]]:
    """R = F F' with free F, for each R with R(0) >= 0 and R' = c R + S, where S >= 0 at all states of the loop."""
    found: dict[int, Rational] = {}
    recorded = []
    for array in _arrays(reading.declared.nonnegative):
        factors, grows = _factors(reading, np.atleast_2d(np.asarray(array, dtype=object)), solved)
        found |= factors
        recorded.append(grows)
    return found, recorded


def _factors(reading: Reading, R: Any, solved: dict[int, Rational]) -> tuple[dict[int, Rational], Recorded]:
    ring, p = reading.ring, len(R)
    places = [[next(iter(one.used), -1) for one in row] for row in R]
    own = {place for row in places for place in row}
    plain = all((R[i, j] - ring.variables[places[i][j]]).is_zero for i in range(p) for j in range(p))
    if R.shape != (p, p) or not plain or not own <= set(reading.state) or len(own) != p * p:
        raise Refused("a part of the state that is declared nonnegative must be a square matrix")
    start = [[reading.start[place - reading.state.start] for place in row] for row in places]
    rates = [[reading.rates[place] for place in row] for row in places]
    shared = rates[0][0].derivative(places[0][0])
    S = [[(rates[i][j] - shared * R[i, j]).replaced(solved) for j in range(p)] for i in range(p)]
    symmetric = all(start[i][j] == start[j][i] and (S[i][j] - S[j][i]).is_zero for i in range(p) for j in range(i))
    if not symmetric or not is_positive_semidefinite(start):
        raise Refused("the matrix that is declared nonnegative is not symmetric, or is not nonnegative at t = 0")
    of_v = ring.free(p, "v")
    v = [ring.variables[i] for i in of_v]
    grows = sum((v[i] * S[i][j] * v[j] for i in range(p) for j in range(p)), ring.constant(fmpq(0)))
    plain = not grows.used & own and is_positive(grows.den)
    squares = sum_of_squares((grows.num * grows.den).to_dict()) if plain else None
    if squares is None:
        raise Refused("the matrix that is declared nonnegative is not shown to remain so: R' must be c R + S with S nonnegative")
    of_F = [ring.free(p, "F") for _ in range(p)]
    F, zero = [[ring.variables[i] for i in row] for row in of_F], ring.constant(fmpq(0))
    factors = {places[i][j]: sum((F[i][k] * F[j][k] for k in range(p)), zero) for i in range(p) for j in range(p)}
    return factors, Recorded(places, of_v, of_F, squares)


class _Substitution:
    """The substitution of quantities that stay zero and of quantities that stay nonnegative, and the shift to deviations."""

    def __init__(
        self, ring: Ring, solved: dict[int, Rational], factors: dict[int, Rational], shifted: dict[int, Rational]
    ) -> None:
        after = factors | {place: one for place, one in shifted.items() if place not in solved}
        self.by = after | {place: value.replaced(after) for place, value in solved.items()}
        self.shift = shifted
        if solved.keys() & shifted.keys() or factors.keys() & shifted.keys():
            raise Refused("V must not contain quantities that stay zero or nonnegative")

    def of(self, function: Rational) -> Rational:
        return function.replaced(self.by)


def _require_projections(reading: Reading, known_set: KnownSet | None, in_V: tuple[int, ...]) -> None:
    """Require that each projection keeps its estimates in the known set: they start there, and their rate is what the projection
    returns. A rate that is changed afterwards may leave the set, and bringing the estimates back may increase V."""
    for normals in reading.normals:
        returned = zip(normals.of, normals.returned(reading.ring), strict=True)
        if not all((reading.rates[place] - rate).is_zero for place, rate in returned):
            raise Refused(
                "the rate of the estimates is not exactly what `project` returns: a gain must be handed to `project`, and "
                "nothing may be added to the result"
            )
        others = [reading.rates[place] for place in (*reading.e, *reading.x, *in_V) if place not in normals.of]
        if any(one.used & set(normals.places) for one in (*others, *reading.control)):
            raise Refused("a projected rate acts on something other than the projected estimates")
        start = np.array([as_float(reading.start[place - reading.state.start]) for place in normals.of])
        if known_set is None or not known_set.contains(start):
            raise Refused("the estimates do not start in the known set")


def _without_normals(reading: Reading, falls: Rational) -> Rational:
    """-V' without the contribution of projections, which is shown to be k (theta_hat - theta)'n with k >= 0."""
    ring, lowers = reading.ring, set()
    slopes = reading.along(_one(ring, reading.declared.V, "V")) if reading.normals else falls
    for normals in reading.normals:
        if len(normals.of) != len(reading.theta):
            raise Refused("the projected part of the state must have the size of theta")
        shares = []
        for own, place, true in zip(normals.of, normals.places, reading.theta, strict=True):
            slope = slopes.derivative(place)
            k = slope.derivative(true)
            if not k.is_constant or k.number < 0 or not (slope + k * (ring.variables[own] - ring.variables[true])).is_zero:
                raise Refused("the projection is not shown to lower V: V must have the metric of the projection's gain")
            shares.append(k.number)
            lowers |= {own} if k.number > 0 else set()
        if not normals.alone and len(set(shares)) > 1:
            raise Refused(
                "the projection is not shown to lower V: V must weight all parameters in the same way as the gain of "
                "the projection"
            )
    if not reading.limited <= lowers:
        raise Refused("`limit` keeps estimates in the known set without a projection of their rates, which may increase V")
    zero = {place: ring.constant(fmpq(0)) for normals in reading.normals for place in normals.places}
    return falls.replaced(zero)


def is_positive(den: Any) -> bool:
    """Whether the denominator is a positive constant plus terms of even powers with positive coefficients, and is therefore at
    least that constant everywhere."""
    terms = den.to_dict()
    constant = terms.get((0,) * den.context().nvars(), fmpq(0))
    return constant > 0 and all(factor > 0 and all(power % 2 == 0 for power in powers) for powers, factor in terms.items())


def _require_positive_denominators(reading: Reading, *more: Rational) -> None:
    if not all(is_positive(one.den) for one in (*reading.rates.values(), *reading.control, *reading.regressor, *more)):
        raise Refused(
            "a denominator could not be shown to be positive: it must be a positive number plus even powers, such as 1 + phi'phi"
        )


class _Cells:
    """Proves functions nonnegative: as sums of squares, for every theta or on cells of the known set."""

    def __init__(self, reading: Reading, known_set: KnownSet | None) -> None:
        self.reading = reading
        self.extent = None if known_set is None else known_set.extent
        self.used, self._done = False, 0

    def show(self, function: Rational) -> Nonnegative | None:
        """The proof that a function with a positive denominator is nonnegative; None if there is none."""
        squares = sum_of_squares(function.num.to_dict())
        if squares is not None:
            return Nonnegative(squares)
        moving = [i for i in self.reading.theta if i in function.used]
        if self.extent is None or not moving or not all(np.isfinite(end).all() for end in self.extent):
            return None
        first = self.reading.theta.start
        ends = [{i: exact_number(float(end[i - first])) for i in moving} for end in self.extent]
        self._done = 0
        found = self._on_cells(function, ends[0], ends[1])
        self.used |= found is not None
        return None if found is None else Nonnegative(found)

    def _on_cells(self, function: Rational, lower: dict[int, fmpq], upper: dict[int, fmpq]) -> Cell | None:
        """Halve cells until all Bernstein coefficients, which are functions of all variables except theta, are sums of squares.
        The coefficient at a vertex equals the function there, so halving does not change it."""
        self._done += 1
        if self._done > MOST_CELLS:
            return None
        proofs = []
        for one in _bernstein(function, lower, upper):
            squares = sum_of_squares(one.of.num.to_dict())
            if squares is None:
                return None if one.at_vertex else self._on_halves(function, lower, upper)
            proofs.append(squares)
        return Cell(proofs)

    def _on_halves(self, function: Rational, lower: dict[int, fmpq], upper: dict[int, fmpq]) -> Cell | None:
        widest = max(lower, key=lambda i: as_float(upper[i] - lower[i]))
        if lower[widest] == upper[widest]:
            return None
        middle = (lower[widest] + upper[widest]) / 2
        low = self._on_cells(function, lower, upper | {widest: middle})
        high = None if low is None else self._on_cells(function, lower | {widest: middle}, upper)
        return None if low is None or high is None else Cell([], widest - self.reading.theta.start, middle, (low, high))


class _Coefficient(NamedTuple):
    of: Rational
    at_vertex: bool


def _bernstein(function: Rational, lower: dict[int, fmpq], upper: dict[int, fmpq]) -> Iterator[_Coefficient]:
    """The Bernstein coefficients of the numerator on a box of some variables, as functions of the other variables."""
    ring, zero = function.ring, function.ring.constant(fmpq(0))
    unit = {i: zero + lower[i] + (upper[i] - lower[i]) * ring.variables[i] for i in lower}
    moved = Rational(ring, function.num, ring.context.constant(1)).replaced(unit)
    degrees = {i: int(moved.num.degrees()[i]) for i in lower}
    for index in product(*(range(degrees[i] + 1) for i in lower)):
        at = dict(zip(lower, index, strict=True))
        total: dict[tuple[int, ...], fmpq] = {}
        for powers, factor in moved.num.to_dict().items():
            if any(powers[i] > at[i] for i in at):
                continue
            share = fmpq(1)
            for i, k in at.items():
                share *= fmpq(comb(k, powers[i]), comb(degrees[i], powers[i]))
            rest = tuple(0 if i in at else power for i, power in enumerate(powers))
            total[rest] = total.get(rest, fmpq(0)) + factor * share
        found = Rational(ring, ring.context.from_dict(total), ring.context.constant(1))
        yield _Coefficient(found, all(k in (0, degrees[i]) for i, k in at.items()))


def _counterexample(cells: _Cells, rest: Rational) -> str:
    """The finding if the proof fails: a point, computed exactly, where the claim is false, or nothing."""
    reading, random = cells.reading, np.random.default_rng(1)
    functions = sorted({reading.ring.functions[i][0] for i in rest.used & reading.ring.functions.keys()})
    if functions:
        names = ", ".join(functions)
        return f"not shown: its functions ({names}) count as free variables, and no sum of squares was found for all their values"
    used, worst = sorted(rest.used), None
    values = [fmpq(0)] * len(reading.ring.variables)  # nothing depends on these variables
    for _ in range(TRIALS):
        drawn = random.normal(size=len(reading.ring.variables)) * 10.0 ** random.uniform(-1, 2, len(reading.ring.variables))
        if cells.extent is not None:
            lower, upper = (np.clip(end, -1e3, 1e3) for end in cells.extent)
            drawn[list(reading.theta)] = random.uniform(lower, upper)
        for i in used:
            values[i] = exact_number(float(f"{drawn[i]:.3g}"))
        found = rest.at(values)
        if found < 0 and (worst is None or len(str(found)) < len(str(worst[0]))):
            worst = found, values.copy()
    if worst is None:
        return "not shown: no sum of squares was found for it, and no state where it fails"
    value, values = worst
    shown_at = ", ".join(f"{reading.ring.names[i]} = {as_float(values[i]):g}" for i in used)
    return f"false: V' + W = {as_float(-value):.3g} where {shown_at}, and all else is zero"


def _require_motion(reading: Reading, in_V: tuple[int, ...]) -> None:
    """Require that no part of the state outside V escapes in finite time: one group after another must be linear in its own
    states, given the parts already known to be bounded and without what projections subtract."""
    left = set(reading.state) - set(in_V)
    while left:
        group = set(left)
        while bad := {i for i in group if not _is_linear(reading, reading.rates[i], group, left)}:
            group -= bad
        if not group:
            raise Refused("a part of the state that does not appear in V may escape in finite time: its rate is not linear in it")
        left -= group


def _is_linear(reading: Reading, rate: Rational, group: set[int], left: set[int]) -> bool:
    through = {i for i in rate.used if i in reading.ring.functions and _variables(reading, reading.ring.variables[i]) & left}
    down = [i for i, degree in enumerate(rate.den.degrees()) if degree > 0]
    normals = {i for one in reading.normals for i in one.places}  # which may grow with the projected rate
    if rate.used & normals or through or set(down) & left or (rate.used & left) - group:
        return False
    return all(sum(powers[i] for i in group) <= 1 for powers in rate.num.to_dict())
