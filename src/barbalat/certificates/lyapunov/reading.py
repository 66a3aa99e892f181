"""The code of a law together with the plant (1) and the model (2), read as exact rational functions."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from flint import fmpq

from barbalat.certificates.lyapunov.rational import NotRational, Rational, Ring, as_float, exact_number
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
    """The term that a projection subtracts, Gamma n with (theta_hat - theta)'n >= 0; with ``alone``, every theta_tilde_i n_i >=
    0."""

    of: tuple[Rational, ...]
    places: tuple[int, ...]
    alone: bool


class ReadSet:
    """The known set with its projection replaced by normals of unknown length; everything else is inherited from the set."""

    def __init__(self, known_set: EstimateSet, ring: Ring) -> None:
        self._set, self._ring = known_set, ring
        self.normals: list[Normals] = []
        self.limited: set[int] = set()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._set, name)

    def project(self, rate: Any, theta_hat: Any, gain: Gain = UNIT_GAIN) -> Any:
        """Rate - Gamma n, n in the set's normal cone."""
        if gain.couples and self._set.cuts_corners:
            raise NotRational("with a gain matrix its projection cuts the corners of the set")
        if any(not isinstance(one, Rational) or len(one.used) != 1 for one in theta_hat):
            raise NotRational("it projects a quantity that is not a part of its state")
        places = self._ring.free(len(theta_hat), "n")
        alone = not gain.couples and getattr(self._set, "fills_its_extent", False)
        self.normals.append(Normals(tuple(theta_hat), tuple(places), alone))
        return rate - gain.times(np.array([self._ring.variables[i] for i in places], dtype=object))

    def limit(self, theta_hat: Any) -> Any:
        """Limit numbers as the set does; variables stay unchanged, because a projected law keeps them inside."""
        flat = np.asarray(theta_hat, dtype=object)
        if all(not isinstance(one, Rational) or one.is_constant for one in flat):
            return self._set.limit(np.array([float(one) for one in flat]))
        self.limited |= {place for one in flat for place in one.used}
        return theta_hat


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
            raise NotRational("it evaluates phi elsewhere than at x")
        return np.array([self._ring.variables[i] for i in self.places], dtype=object)


class ReadKnown:
    """The known part of a plant, with exact numbers."""

    def __init__(self, known: Known, ring: Ring, phi: FreeRegressor | None) -> None:
        self._known, self._ring = known, ring
        self.matched = known.matched if phi is None else replace(known.matched, regressor=phi)
        self.estimate_set = None if known.estimate_set is None else ReadSet(known.estimate_set, ring)

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._known, name)
        exact = isinstance(value, float) or (isinstance(value, np.ndarray) and value.dtype.kind == "f")
        return self._ring.exact(value) if exact else value


@dataclass(frozen=True, eq=False)
class Reading:
    """The loop: indices of the variables, rates by index, the initial state, and the supplied functions.

    limited  the indices of estimates that ``limit`` keeps in the known set
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
    known = ReadKnown(problem.known, ring, free)
    equations: Any = _exactly(controller, ring).bind(known)
    e, x, theta = (ring.array(places[name].start, (len(places[name]),)) for name in ("e", "x", "theta"))
    r = ring.array(places["r"].start, (len(places["r"]),) if isinstance(problem.reference, tuple) else ())
    template = numeric.initial()
    state = _filled(template, iter([ring.array(places["state"].start + part.start, part.shape) for part in parts]))
    x_m = x - e
    u = equations.control(state, x, x_m, r)
    rates = _flat(equations.derivative(state, x, x_m, r, u), ring)
    if any(one is not other and not (one - other).is_zero for one, other in zip(
        _flat(equations.limit(state), ring), _flat(state, ring), strict=True
    )):  # fmt: skip
        raise NotRational("`limit` changes the state beyond the projection onto the known set, which may increase V")
    kept = known.estimate_set
    b, A_m, phi = known.b, known.A_m, ring.exact(np.asarray(known.matched.phi(x)))
    drive = phi.T @ theta + u
    moves = A_m @ x + np.dot(b, drive)
    model = A_m @ x_m + np.dot(b, np.dot(known.k_0, r))
    by_place = dict(zip(places["state"], rates, strict=True))
    by_place |= dict(zip(places["x"], moves, strict=True)) | dict(zip(places["e"], moves - model, strict=True))
    return Reading(
        ring=ring, **{name: places[name] for name in ("e", "x", "r", "theta", "state")}, parts=parts, rates=by_place,
        control=tuple(np.atleast_1d(np.asarray(ring.exact(u), dtype=object))),
        start=tuple(one.number for one in _flat(equations.initial(), ring)), x0=tuple(known.x0),
        declared=equations.lyapunov(state, x, x_m, theta), normals=() if kept is None else tuple(kept.normals),
        limited=frozenset() if kept is None else frozenset(kept.limited),
        phi=() if free is None else tuple(free.places),
        regressor=tuple(ring.exact(np.asarray(problem.known.matched.regressor(x)))),
    )  # fmt: skip


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
    """Require that the code on numbers agrees with its reading, at three states inside the known set."""
    random = np.random.default_rng(0)
    for _ in range(3):
        values = _drawn(problem, found, random)
        x, e = (np.array([as_float(values[i]) for i in places]) for places in (found.x, found.e))
        flat = [as_float(values[i]) for i in found.state]
        arrays = [np.array(flat[part.start : part.start + part.size]).reshape(part.shape) for part in found.parts]
        state = _filled(equations.initial(), iter(arrays))
        r: Any = np.array([as_float(values[i]) for i in found.r])
        r = r if isinstance(problem.reference, tuple) else r[0]
        u = equations.control(state, x, x - e, r)
        on_numbers = _numbers(u, equations.derivative(state, x, x - e, r, u))
        read_of_them = np.array([
            as_float(one.at(values)) for one in (*found.control, *(found.rates[i] for i in found.state))
        ])  # fmt: skip
        scale = 1 + np.abs(on_numbers)
        if not (np.abs(read_of_them - on_numbers) <= AGREES * scale).all():
            raise NotRational("evaluated on numbers, its code differs from the expressions that were read from it")


def _numbers(u: Any, state: Any) -> Array:
    return np.concatenate([np.ravel(u), *(np.ravel(leaf) for _, leaf in leaves(state))]).astype(float)


def _drawn(problem: Problem, found: Reading, random: np.random.Generator) -> list[fmpq]:
    """Random values of all variables; functions have their actual values, normals are zero, projected estimates are inside the
    set."""
    drawn = [exact_number(float(one)) for one in np.round(random.uniform(-1, 1, len(found.ring.variables)), 3)]
    known_set = problem.known.estimate_set
    for normals in found.normals:
        assert known_set is not None and not isinstance(known_set, ParameterProduct)
        middle, (lower, upper) = known_set.middle, known_set.extent
        for i, (of, place) in enumerate(zip(normals.of, normals.places, strict=True)):
            drawn[place] = fmpq(0)
            (own,) = of.used
            drawn[own] = exact_number(float(middle[i] + random.uniform(-0.3, 0.3) * min(upper[i] - lower[i], 1e3) / len(middle)))
    at_x = problem.known.matched.regressor(np.array([as_float(drawn[i]) for i in found.x])) if found.phi else ()
    for place, one in zip(found.phi, at_x, strict=True):
        drawn[place] = exact_number(float(one))
    for place, (name, argument) in found.ring.functions.items():
        at = as_float(argument.at(drawn))
        drawn[place] = exact_number(float(getattr(np, name)(at)))
    return drawn
