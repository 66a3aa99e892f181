"""Linearises the loop of any controller at its equilibrium for a constant command, by exact Jacobians and without assumptions on
the law."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from barbalat import budget
from barbalat.certificates.entry import NotApplicable, PlaceOfRest, RestingEstimates
from barbalat.certificates.linear_loops.ideal import open_jacobians
from barbalat.linear.systems import StateSpace
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import jacobian_function
from barbalat.loop.packing import column, flatten, symbols
from barbalat.loop.true_values import truth_of
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import BoundedSignal, Value
from barbalat.roles import StatePart
from barbalat.validate import Array, InputError, counted

MOST_NEWTON_STEPS, MOST_HALVINGS = 60, 30
REST_TOLERANCE = 1e-9
"""A Newton step below this fraction of the state is rounding error."""
SHIFT = 0.1
"""Distance, as a fraction of the state's size, at which a second equilibrium on a line of equilibria is checked."""
RANK_TOLERANCE = 1e-12
"""Singular values below this fraction of the largest one, for a matrix with scaled rows and columns, are rounding errors."""


@dataclass(frozen=True, eq=False)
class Rest:
    """A loop at its equilibrium under the constant ``signals``; ``state`` is the flat state of ``loop``.

    loop   the loop of the case without delay, limits and quantisation at the plant's input
    level  the commands at their largest values; zero if these are unknown
    ideal  the estimates that have their true values at the equilibrium
    """

    loop: ClosedLoop
    state: Array
    signals: Array
    level: Array
    ideal: tuple[StatePart, ...] = ()

    @property
    def place(self) -> str:
        """The values of the estimates; empty without estimates."""
        return f", where {self.found.where}" if self.found.estimates else ""

    @property
    def found(self) -> PlaceOfRest:
        """The commands and the estimates at the equilibrium."""
        return place_of(self.loop, self.state, self.level, self.ideal)

    @cached_property
    def is_one_of_many(self) -> bool:
        """Whether a neighbouring state is also an equilibrium but has a different Jacobian; estimates that have their true values
        are not changed."""
        jacobian = jacobian_function(self.loop)
        J = np.asarray(jacobian(self.state, self.signals))
        others = np.setdiff1d(np.arange(self.loop.size), rows_of(self.loop, self.ideal))
        shift, atol = SHIFT * max(1.0, float(np.linalg.norm(self.state))), REST_TOLERANCE * np.abs(J).max()
        for direction in _moved_by(J[:, others].T, left_over=True).T:
            moved = self.state.copy()
            moved[others] += shift * direction / np.linalg.norm(direction)
            if not np.allclose(np.asarray(jacobian(moved, self.signals)), J, rtol=REST_TOLERANCE, atol=atol):
                return True
        return False

    @cached_property
    def modes(self) -> Array:
        """Eigenvalues of the whole loop."""
        return np.linalg.eigvals(np.asarray(jacobian_function(self.loop)(self.state, self.signals)))

    def broken(self, *, frozen: bool) -> StateSpace:
        """The loop from the plant's input v to -u, for one input, with the estimates ``frozen`` or with their law.

        The result excludes the model, which v does not affect, the dynamics at the plant's input, and the sensor's lag. It also
        excludes combinations of the state that remain constant, such as the estimates in directions orthogonal to the regressor.
        With an observer, which also receives u, the lag is not in series with the loop and remains part of it.
        """
        whole = self.loop.unpack(self.state)
        stays = self.loop.observer is not None
        inner = replace(self.loop, paths=(None,), lag=self.loop.lag if stays else None)
        rest = flatten(whole._replace(input=((),), sensor=whole.sensor if stays else np.zeros(0)))
        jacobians = open_jacobians(inner, lambda state, v: inner.derivative_given_input(state, self.signals, v))
        reaches = self.loop.undelayed_input(self.state, self.signals)
        return _reduced(inner, jacobians(rest, reaches), frozen)

    def broken_at(self, i: int, *, frozen: bool) -> StateSpace:
        """The loop broken at input i of the plant, with the sign of L; the other inputs are closed and all dynamics are
        included."""
        loop, alone = self.loop, np.arange(self.loop.inputs) == i

        def given_input(state: Value, v: Value) -> tuple[Value, Value]:
            reaches = loop.undelayed_input(state, self.signals)
            return loop.derivative_given_input(state, self.signals, np.where(alone, v, reaches))[0], reaches[i]

        reaches = loop.undelayed_input(self.state, self.signals)[i]
        return _reduced(loop, open_jacobians(loop, given_input)(self.state, reaches), frozen)


def _reduced(loop: ClosedLoop, jacobians: Iterable[Any], frozen: bool) -> StateSpace:
    """Return L from A, B and C of the flat state, without the parts that don't belong to the loop.

    These parts are the model, frozen estimates and everything else that a freeze holds, constant states, and states without
    effect, such as a second layer behind frozen estimates, which would be an integrator.
    """
    A, B, C = (np.array(part) for part in jacobians)
    marked = loop.unpack(np.arange(loop.size))
    out = [*marked.x_m]
    if frozen:
        out += rows_of(loop, resting_parts(loop)).tolist()
    kept = np.setdiff1d(np.arange(loop.size), np.array(out, dtype=int))
    return reduced(A[np.ix_(kept, kept)], B[kept, 0], C[0, kept], np.isin(kept, marked.x))


def reduced(A: Array, B: Array, C: Array, of_plant: Array) -> StateSpace:
    """The loop from v to -u, u = C x, without constant states and without states that affect neither u nor the states
    ``of_plant``, (n,) of bool: the loop may be unstable because of a state of the plant that is not fed back."""
    acts = _acting(A, (C != 0) | of_plant)
    A, B, C = A[np.ix_(acts, acts)], B[acts], C[acts]
    moving = _moved_by(np.column_stack([A, B]))
    return StateSpace(moving.T @ A @ moving, moving.T @ B, -C @ moving, 0.0)


def _acting(A: Array, acts: Array) -> Array:
    """The states that affect one of the given states, directly or through others; a zero entry of these Jacobians is exactly
    zero."""
    for _ in range(len(acts)):
        acts = acts | (A[acts] != 0).any(axis=0)
    return np.asarray(acts)


def _moved_by(rates: Array, *, left_over: bool = False) -> Array:
    """Orthonormal columns that span the range of [A B]; w'[A B] = 0 means that w'state is conserved. With ``left_over``, return
    the vectors w instead."""
    rows = np.linalg.norm(rates, axis=1)
    scaled = rates / np.where(rows > 0, rows, 1.0)[:, None]
    columns = np.linalg.norm(scaled, axis=0)
    left, sizes, _ = np.linalg.svd(scaled / np.where(columns > 0, columns, 1.0))
    rank = int(np.sum(sizes > RANK_TOLERANCE * sizes.max(initial=0.0)))
    conserved = left[:, rank:] / np.where(rows > 0, rows, 1.0)[:, None]
    if left_over:
        return np.asarray(conserved)
    if conserved.shape[1] == 0:
        return np.eye(len(rates))
    return np.asarray(np.linalg.svd(conserved)[0][:, conserved.shape[1] :])


def rest_of(problem: TrackingProblem, loop: ClosedLoop, *, frozen: bool) -> Rest | NotApplicable:
    """The equilibrium of the loop; with ``frozen``, estimates and the law's memory keep their values.

    Newton's method starts from x = x_m and true estimates, if these satisfy the equations. If there are many equilibria, it takes
    the shortest steps.
    """
    if loop.sampled:
        return NotApplicable("the controller acts only at samples and has no known continuous form")
    why = why_no_rest(loop)
    if why is not None:
        return why
    loop = without_limits(loop)
    level, signals = largest_commands(problem, loop)
    adapting = adapting_parts(loop, signals)
    true = {part: value for part in adapting if (value := truth_of(problem, part)) is not None}
    held = rows_of(loop, resting_parts(loop) if frozen else [part for part in estimates_of(loop) if part not in adapting])
    start, everything, state = _start(loop, signals, true), np.arange(loop.size), None
    ideal: tuple[StatePart, ...] = ()
    if true and not frozen:  # among many equilibria, the one with true estimates, if it exists
        free = np.setdiff1d(everything, np.union1d(held, rows_of(loop, true)))
        state = _solved(loop, signals, start, free, everything)
        ideal = tuple(true) if state is not None else ()
    if state is None:
        state = _solved(loop, signals, start, np.setdiff1d(everything, held))
    under = words_of(level)
    if state is None:
        return NotApplicable(f"no equilibrium of the loop was found {under}")
    if not np.allclose(loop.limit(state), state, rtol=REST_TOLERANCE, atol=0):
        return NotApplicable(f"the internal limit of the controller acts at the equilibrium of the loop {under}")
    ideal = ideal or tuple(part for part, value in true.items() if np.array_equal(state[part.rows], value))
    return Rest(loop, state, signals, level, ideal)


def place_of(loop: ClosedLoop, state: Array, level: Array, ideal: tuple[StatePart, ...]) -> PlaceOfRest:
    """The commands and the estimates of a state; the estimates in ``ideal`` are at their true values."""
    estimates = (
        RestingEstimates(part.name, part.symbol, tuple(state[part.rows].tolist()), true=part in ideal)
        for part in estimates_of(loop)
    )
    return PlaceOfRest(tuple(level.tolist()), tuple(estimates))


def without_limits(loop: ClosedLoop) -> ClosedLoop:
    """The loop without delay and limits at the plant's input, anti-windup of a baseline and quantisation."""
    baseline, external = (fixed and replace(fixed, limits=None) for fixed in (loop.baseline, loop.external))
    paths = tuple(path and path.linear for path in loop.paths)
    return replace(loop, delayed=False, resolutions=None, paths=paths, baseline=baseline, external=external)


def why_no_rest(loop: ClosedLoop) -> NotApplicable | None:
    """Why no equilibrium is sought; None if one is sought."""
    if loop.clocked:
        return NotApplicable("the plant depends on time, so there is no equilibrium")
    try:
        budget.require(
            "the closed loop",
            loop.size,
            budget.of_linearisation,
            given=f"has {counted(loop.size, 'state')}, and its equilibrium and modes",
            fits=lambda most: f"at most {counted(most, 'state')}",
            what=f"the linearised loop of {counted(loop.size, 'state')}",
        )
    except InputError as beyond:  # the rest of the certificate is unaffected
        return NotApplicable(str(beyond))
    return None


def largest_commands(problem: TrackingProblem, loop: ClosedLoop) -> tuple[Array, Array]:
    """The commands at their largest values, zero if these are unknown, and the corresponding signals of the loop."""
    bounds = [command.bound if isinstance(command, BoundedSignal) else 0.0 for command in problem.commands]
    level = np.array(bounds, dtype=float)
    return level, np.concatenate([level, np.zeros(loop.signal_count - len(level))])


def words_of(level: Array) -> str:
    """The commands as part of a sentence."""
    return f"under the constant command {', '.join(f'{value:g}' for value in level)}"


def estimates_of(loop: ClosedLoop) -> list[StatePart]:
    """All estimates; the ones called theta_hat in results come first."""
    found = [*(() if loop.estimates is None else (loop.estimates,)), *loop.other_estimates]
    return [part for part in found if part.size]


def resting_parts(loop: ClosedLoop) -> list[StatePart]:
    """The parts of the state that a freeze holds."""
    return [part for part in loop.parts if part.role.rests]


def rows_of(loop: ClosedLoop, parts: Iterable[StatePart]) -> Array:
    """The indices of the parts in the flat state vector."""
    return np.concatenate([np.zeros(0, dtype=int), *(np.arange(loop.size)[part.rows] for part in parts)])


def adapting_parts(loop: ClosedLoop, signals: Array) -> list[StatePart]:
    """The estimates that change. An estimate whose rate is zero in every state is a setting, not an estimate of a plant
    parameter."""
    _, state = symbols("state", loop.size)
    rates = column(loop.derivative(state, signals))
    return [part for part in estimates_of(loop) if not rates[part.rows].is_zero()]


def _start(loop: ClosedLoop, signals: Array, true: Mapping[StatePart, Array]) -> Array:
    """The initial state with the model at rest, the plant at the same state, and true estimates if their sizes agree."""
    start = np.array(loop.initial(), dtype=float)
    places = loop.unpack(np.arange(loop.size))
    solved = _solved(loop, signals, start, places.x_m)
    if solved is None:
        return start
    start[places.x_m] = solved[places.x_m]
    if len(places.x) == len(places.x_m):
        start[places.x] = start[places.x_m]
    if len(places.observer) == len(places.x):  # settled, like a sensor
        start[places.observer] = start[places.x]
    if loop.lag is not None:  # settled, so that it forces no other state to change
        start[places.sensor] = loop.reading(start[places.x])
    for part, value in true.items():
        start[part.rows] = value
    return start


def _solved(loop: ClosedLoop, signals: Array, start: Array, free: Array, resting: Array | None = None) -> Array | None:
    """The state (size,) in which the ``free`` parts, or all ``resting`` parts, have zero rates; only free parts change."""
    jacobian = jacobian_function(loop)
    return newton(
        lambda state: np.asarray(loop.derivative(state, signals), dtype=float),
        lambda state: np.asarray(jacobian(state, signals)),
        start,
        free,
        free if resting is None else resting,
    )


def newton(
    rates: Callable[[Array], Array], jacobian: Callable[[Array], Array], start: Array, free: Array, resting: Array
) -> Array | None:
    """The state at which the ``resting`` rates vanish, found by the shortest changes of the ``free`` parts.

    None if no step leads closer to such a state.
    """
    state = start.copy()

    def found_at(state: Array) -> Array:
        with np.errstate(all="ignore"):
            return rates(state)[resting]

    for _ in range(MOST_NEWTON_STEPS):
        found, J = found_at(state), jacobian(state)[np.ix_(resting, free)]
        if not (np.isfinite(found).all() and np.isfinite(J).all()):
            return None
        rows = np.linalg.norm(J, axis=1)
        rows[rows == 0] = 1.0
        step: Array = np.linalg.lstsq(J / rows[:, None], found / rows, rcond=None)[0]
        size = max(np.linalg.norm(state), np.linalg.norm(start))
        if np.linalg.norm(step) <= REST_TOLERANCE * size:
            return state if (np.abs(found) <= REST_TOLERANCE * rows * size).all() else None
        for _ in range(MOST_HALVINGS):
            tried = state.copy()
            tried[free] -= step
            if np.linalg.norm(found_at(tried) / rows) < np.linalg.norm(found / rows):
                break
            step = step / 2
        else:
            return None
        state = tried
    return None
