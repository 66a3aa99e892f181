"""The code of a law together with the plant (1) and the model (2), read as exact rational functions."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from flint import fmpq, fmpq_mat

from barbalat.certificates.lyapunov.rational import NotRational, Rational, Ring, as_float, exact_number
from barbalat.certificates.lyapunov.squares import is_positive_definite
from barbalat.problem.known_set import EstimateSet, Gain, ParameterProduct
from barbalat.problem.known_set.gain import UNIT_GAIN
from barbalat.problem.state_feedback import Known, Problem
from barbalat.protocols import Controller, Lyapunov
from barbalat.roles import StatePart, leaves, state_parts
from barbalat.validate import Array

AGREES = 1e-9
"""Largest relative difference between the code on numbers and its reading: far above rounding, far below the effect of a wrong
reading."""


class Normals(NamedTuple):
    """A projection: it returns ``rate`` - K n with (theta_hat - theta)'n >= 0; with ``alone``, every theta_tilde_i n_i >= 0.

    of, places  the indices of theta_hat and of n
    gain        K, constant and positive definite
    """

    of: tuple[int, ...]
    places: tuple[int, ...]
    rate: tuple[Rational, ...]
    gain: fmpq_mat
    alone: bool

    def returned(self, ring: Ring) -> list[Rational]:
        """What the projection returns."""
        K, n = self.gain.tolist(), [ring.variables[i] for i in self.places]
        return [one - sum((a * b for a, b in zip(n, row, strict=True)), one * 0) for one, row in zip(self.rate, K, strict=True)]


class ReadSet:
    """The known set with its projection replaced by normals of unknown length; everything else is inherited from the set.

    fields   the indices of each array of the state
    limited  the arrays that were limited to the set
    """

    def __init__(self, known_set: EstimateSet, ring: Ring, fields: frozenset[tuple[int, ...]]) -> None:
        self._set, self._ring, self._fields = known_set, ring, fields
        self.normals: list[Normals] = []
        self.limited: list[tuple[int, ...]] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._set, name)

    def project(self, rate: Any, theta_hat: Any, gain: Gain = UNIT_GAIN) -> Any:
        """Rate - K n, n in the set's normal cone."""
        of = self._field(theta_hat, "project")
        if gain.couples and self._set.cuts_corners:
            raise NotRational("with a gain matrix its projection cuts the corners of the set")
        places = self._ring.free(len(of), "n")
        alone = not gain.couples and getattr(self._set, "fills_its_extent", False)
        rates = tuple(self._ring.exact(np.broadcast_to(np.asarray(rate, dtype=object), (len(of),))))
        found = Normals(of, tuple(places), rates, self._matrix(gain, len(of)), alone)
        self.normals.append(found)
        return np.array(found.returned(self._ring), dtype=object)

    def limit(self, theta_hat: Any) -> Any:
        """Limit numbers as the set does; variables stay unchanged, because a projected law keeps them inside."""
        flat = np.asarray(theta_hat, dtype=object)
        if all(not isinstance(one, Rational) or one.is_constant for one in flat.reshape(-1)):
            return self._set.limit(np.array([float(one) for one in flat]))
        self.limited.append(self._field(theta_hat, "limit"))
        return theta_hat

    def _field(self, theta_hat: Any, method: str) -> tuple[int, ...]:
        """The indices of an array of the state; raises NotRational for anything else."""
        flat = [self._ring.exact(one) for one in np.asarray(theta_hat, dtype=object).reshape(-1)]
        found = tuple(next(iter(one.used), -1) for one in flat)
        same = all((one - self._ring.variables[i]).is_zero for one, i in zip(flat, found, strict=True))
        if not same or found not in self._fields:
            raise NotRational(f"`{method}` of the known set is applied to something other than a whole array of the state")
        return found

    def _matrix(self, gain: Gain, size: int) -> fmpq_mat:
        entries = self._ring.exact(np.asarray(gain.as_matrix(size), dtype=object))
        if entries.shape != (size, size) or not all(one.is_constant for one in entries.reshape(-1)):
            raise NotRational("the gain of its projection is not constant")
        found = fmpq_mat([[one.number for one in row] for row in entries])
        if not is_positive_definite(found):
            raise NotRational("the gain of its projection is not symmetric and positive definite")
        return found


class FreeRegressor:
    """A regressor phi whose value at x is free variables: what holds for all their values holds for phi(x)."""

    def __init__(self, size: int, ring: Ring, x: Any) -> None:
        self._ring, self._x = ring, x
        self.places = ring.free(size, "phi")

    def size(self, _: int) -> int:
        """The number of components."""
        return len(self.places)

    def __call__(self, x: Any) -> Any:
        """The variables; raises NotRational anywhere but at x."""
        if len(x) != len(self._x) or any(
            not (a - b).is_zero for a, b in zip(self._ring.exact(np.asarray(x)), self._x, strict=True)
        ):
            raise NotRational("it evaluates phi at a point other than x")
        return np.array([self._ring.variables[i] for i in self.places], dtype=object)


class ReadKnown:
    """The known part of a plant, with exact numbers."""

    def __init__(self, known: Known, ring: Ring, phi: FreeRegressor | None, fields: frozenset[tuple[int, ...]]) -> None:
        self._known, self._ring = known, ring
        self.matched = known.matched if phi is None else replace(known.matched, regressor=phi)
        self.estimate_set = None if known.estimate_set is None else ReadSet(known.estimate_set, ring, fields)

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._known, name)
        exact = isinstance(value, float) or (isinstance(value, np.ndarray) and value.dtype.kind == "f")
        return self._ring.exact(value) if exact else value


@dataclass(frozen=True, eq=False)
class Reading:
    """The loop: indices of the variables, rates by index, the initial state, and the supplied functions.

    limited  the indices of estimates that the code limits to the known set
    kept     those that the method ``limit`` limits; ``only_kept`` if no other method limits any
    phi      the indices of the components of phi(x), if they are free
    regressor  phi(x) itself
    """

    ring: Ring
    e: range
    x: range
    r: range
    theta: range
    state: range
    parts: tuple[StatePart, ...]
    rates: dict[int, Rational]
    control: tuple[Rational, ...]
    start: tuple[fmpq, ...]
    x0: tuple[Rational, ...]
    declared: Lyapunov
    normals: tuple[Normals, ...]
    limited: frozenset[int]
    kept: tuple[tuple[int, ...], ...]
    only_kept: bool
    phi: tuple[int, ...]
    regressor: tuple[Rational, ...]

    def along(self, function: Rational) -> Rational:
        """The derivative of the function along the motion of the loop."""
        inside = function.used - set(self.theta)
        if not inside <= self.rates.keys():
            raise NotRational(
                "V and the quantities that stay zero may depend only on the state, x, x_m and theta, not on r or functions of x"
            )
        return sum((function.derivative(i) * self.rates[i] for i in inside), self.ring.constant(fmpq(0)))


def read(problem: Problem, controller: Controller, *, free_phi: bool = False) -> Reading:
    """Read the loop; with ``free_phi``, free variables replace phi(x).

    Raises NotRational if the code is not a rational function, or does not agree with its values on numbers.
    """
    known = problem.known
    equations: Any = controller.bind(known)
    parts = state_parts(equations, equations.initial())
    n, p, commands = known.n, known.parameters, len(problem.commands)
    sizes = {"e": n, "x": n, "r": commands, "theta": p, "state": sum(part.size for part in parts)}
    names = [f"{name}_{i + 1}" for name in ("e", "x", "r", "theta") for i in range(sizes[name])]
    names += [f"{part.name}_{i + 1}" if part.size > 1 else part.name for part in parts for i in range(part.size)]
    ring, places, first = Ring(names), {}, 0
    for name, size in sizes.items():
        places[name] = range(first, first + size)
        first += size
    x = ring.array(places["x"].start, (n,))
    phi = FreeRegressor(known.matched.regressor.size(n), ring, x) if free_phi else None
    found = _of_lines(problem, controller, ring, places, parts, equations, phi)
    _require_agreement(problem, equations, found)
    return found


def _of_lines(
    problem: Problem,
    controller: Controller,
    ring: Ring,
    places: dict[str, range],
    parts: tuple[StatePart, ...],
    numeric: Any,
    free: FreeRegressor | None,
) -> Reading:
    first = places["state"].start
    fields = frozenset(tuple(range(first + part.start, first + part.start + part.size)) for part in parts)
    known = ReadKnown(problem.known, ring, free, fields)
    equations: Any = _exactly(controller, ring).bind(known)
    e, x, theta = (ring.array(places[name].start, (len(places[name]),)) for name in ("e", "x", "theta"))
    r = ring.array(places["r"].start, (len(places["r"]),) if isinstance(problem.reference, tuple) else ())
    template = numeric.initial()
    state = _filled(template, iter([ring.array(places["state"].start + part.start, part.shape) for part in parts]))
    x_m = x - e
    u = equations.control(state, x, x_m, r)
    rates = _flat(equations.derivative(state, x, x_m, r, u), ring)
    before = [] if known.estimate_set is None else list(known.estimate_set.limited)
    if any(one is not other and not (one - other).is_zero for one, other in zip(
        _flat(equations.limit(state), ring), _flat(state, ring), strict=True
    )):  # fmt: skip
        raise NotRational("`limit` changes the state beyond the projection onto the known set, which may increase V")
    kept_in = known.estimate_set
    kept = () if kept_in is None else tuple(kept_in.limited[len(before) :])
    b, A_m, phi = known.b, known.A_m, ring.exact(np.asarray(known.matched.phi(x)))
    drive = phi.T @ theta + u
    moves = A_m @ x + np.dot(b, drive)
    model = A_m @ x_m + np.dot(b, np.dot(known.k_0, r))
    control = tuple(np.atleast_1d(np.asarray(ring.exact(u), dtype=object)))
    by_place = dict(zip(places["state"], rates, strict=True))
    by_place |= dict(zip(places["x"], moves, strict=True)) | dict(zip(places["e"], moves - model, strict=True))
    return Reading(
        ring=ring, **{name: places[name] for name in ("e", "x", "r", "theta", "state")}, parts=parts, rates=by_place,
        control=control,
        start=tuple(one.number for one in _flat(equations.initial(), ring)), x0=tuple(known.x0),
        declared=equations.lyapunov(state, x, x_m, theta),
        normals=() if kept_in is None else _in_use(kept_in, (*rates, *control)),
        limited=frozenset() if kept_in is None else frozenset(place for field in kept_in.limited for place in field),
        kept=kept, only_kept=not before,
        phi=() if free is None else tuple(free.places),
        regressor=tuple(ring.exact(np.asarray(problem.known.matched.regressor(x)))),
    )  # fmt: skip


def _in_use(known_set: ReadSet, code: tuple[Rational, ...]) -> tuple[Normals, ...]:
    """The projections whose result the law uses."""
    used = set().union(*(one.used for one in code))
    return tuple(one for one in known_set.normals if used & set(one.places))


def _exactly(controller: Any, ring: Ring) -> Any:
    """A copy whose numbers are exact."""
    if not is_dataclass(controller):
        return controller
    found = copy.copy(controller)
    for one in fields(controller):
        value = getattr(controller, one.name)
        if isinstance(value, float) or (isinstance(value, np.ndarray) and value.dtype.kind == "f"):
            object.__setattr__(found, one.name, ring.exact(value))
    return found


def _filled(template: Any, arrays: Iterator[Any]) -> Any:
    if not isinstance(template, tuple):
        return next(arrays)
    parts = [_filled(part, arrays) for part in template]
    return tuple(parts) if type(template) is tuple else type(template)(*parts)


def _flat(state: Any, ring: Ring) -> list[Rational]:
    return [ring.exact(one) for _, leaf in leaves(state) for one in np.asarray(leaf, dtype=object).reshape(-1)]


def _require_agreement(problem: Problem, equations: Any, found: Reading) -> None:
    """Require that the code on numbers agrees with its reading, at three states each with the estimates inside the known set, on
    its faces and beyond it."""
    random = np.random.default_rng(0)
    in_the_set = {one.of for one in found.normals} | set(found.kept)
    for where in ("inside", "on", "beyond") if in_the_set else ("inside",):
        for _ in range(3):
            values = _drawn(problem, found, random, in_the_set, where)
            flat = [as_float(values[i]) for i in found.state]
            state = _shaped(equations, found, flat)
            same = (where == "beyond" and not found.only_kept) or _moves_agree(problem, equations, found, values, state)
            if not same or not np.allclose(_numbers((), equations.limit(state)), _limited(problem, found, flat), AGREES, AGREES):
                raise NotRational("evaluated on numbers, its code differs from the expressions that were read from it")


def _moves_agree(problem: Problem, equations: Any, found: Reading, values: list[fmpq], state: Any) -> bool:
    x, e, r = (np.array([as_float(values[i]) for i in places]) for places in (found.x, found.e, found.r))
    command: Any = r if isinstance(problem.reference, tuple) else r[0]
    u = equations.control(state, x, x - e, command)
    on_numbers = _numbers(u, equations.derivative(state, x, x - e, command, u))
    normals = {place for one in found.normals for place in one.places}
    free = [fmpq(0) if i in normals else one for i, one in enumerate(values)]
    read_of_them, without = (
        np.array([as_float(one.at(at)) for one in (*found.control, *(found.rates[i] for i in found.state))])
        for at in (values, free)
    )
    return bool((np.abs(read_of_them - on_numbers) <= AGREES * (1 + np.maximum(np.abs(on_numbers), np.abs(without)))).all())


def _shaped(equations: Any, found: Reading, flat: list[float]) -> Any:
    arrays = [np.array(flat[part.start : part.start + part.size]).reshape(part.shape) for part in found.parts]
    return _filled(equations.initial(), iter(arrays))


def _limited(problem: Problem, found: Reading, flat: list[float]) -> Array:
    """The state after ``limit``, by the known set itself."""
    limited, first = np.array(flat), found.state.start
    for field in found.kept:
        assert problem.known.estimate_set is not None
        rows = [place - first for place in field]
        limited[rows] = problem.known.estimate_set.limit(limited[rows])
    return limited


def _numbers(u: Any, state: Any) -> Array:
    return np.concatenate([np.ravel(u), *(np.ravel(leaf) for _, leaf in leaves(state))]).astype(float)


def _drawn(
    problem: Problem, found: Reading, random: np.random.Generator, in_the_set: set[tuple[int, ...]], where: str
) -> list[fmpq]:
    """Random values of all variables; functions and normals have their actual values."""
    drawn = [exact_number(float(one)) for one in np.round(random.uniform(-1, 1, len(found.ring.variables)), 3)]
    known_set = problem.known.estimate_set
    for field in sorted(in_the_set):
        for place, one in zip(field, _estimates(known_set, random, where), strict=True):
            drawn[place] = exact_number(float(one))
    at_x = problem.known.matched.regressor(np.array([as_float(drawn[i]) for i in found.x])) if found.phi else ()
    for place, one in zip(found.phi, at_x, strict=True):
        drawn[place] = exact_number(float(one))
    for place, (name, argument) in found.ring.functions.items():
        at = as_float(argument.at(drawn))
        drawn[place] = exact_number(float(getattr(np, name)(at)))
    for normals in found.normals:
        rate, theta_hat = (np.array(list(map(as_float, part))) for part in (
            [one.at(drawn) for one in normals.rate], [drawn[i] for i in normals.of]
        ))  # fmt: skip
        K = np.array([list(map(as_float, row)) for row in normals.gain.tolist()])
        assert known_set is not None
        gain = Gain(K) if np.count_nonzero(K) > len(K) else Gain(np.diag(K).copy())
        subtracted = rate - known_set.project(rate, theta_hat, gain)
        for place, one in zip(normals.places, np.linalg.solve(K, subtracted), strict=True):
            drawn[place] = exact_number(float(one))
    return drawn


def _estimates(known_set: EstimateSet | None, random: np.random.Generator, where: str) -> Array:
    """Estimates inside the known set, on its boundary, or beyond it."""
    assert known_set is not None and not isinstance(known_set, ParameterProduct)
    middle, (lower, upper) = known_set.middle, known_set.extent
    half = np.minimum(upper - lower, 1e3) / 2
    if where == "inside":
        return middle + random.uniform(-0.6, 0.6, len(middle)) * half / len(middle)
    beyond = middle + random.choice([-1, 1], len(middle)) * random.uniform(0.5, 2.5, len(middle)) * half
    return beyond if where == "beyond" else np.asarray(known_set.limit(beyond))
