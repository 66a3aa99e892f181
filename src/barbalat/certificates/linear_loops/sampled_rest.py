"""Linearises the sampled-data loop of a sampled controller at its equilibrium for a constant command.

An equilibrium is a state that changes neither at a sample nor between two samples. The motion of the plant is exact there, and
the step of the law, an Euler or an implicit step, is differentiated as implemented.
"""

from __future__ import annotations

from collections.abc import Callable, Container
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from barbalat.certificates.entry import NotApplicable, PlaceOfRest
from barbalat.certificates.linear_loops.at_rest import (
    adapting_parts,
    estimates_of,
    largest_commands,
    newton,
    place_of,
    resting_parts,
    rows_of,
    why_no_rest,
    without_limits,
    words_of,
)
from barbalat.certificates.linear_loops.from_sample_to_sample import Linearised, of_jacobians
from barbalat.linear.sampled_loop import SampledLoop
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import jacobian_function, right_hand_side, sampled_function, sampled_jacobian_function
from barbalat.loop.true_values import truth_of
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.roles import StatePart
from barbalat.validate import Array

ON_A_FACE = "at its equilibrium the estimates are on the known set's boundary, at a corner of the projection"
POLISHING_STEPS = 2
"""Number of additional Newton steps: constant states can be distinguished from rounding only if the equilibrium is exact to the
last digits."""
BESIDE = 1e-10
"""Distance from the equilibrium, as a fraction of the state's size, for central differences of the law."""
BY_ROUNDING = 1e-9
"""Relative size below which motion is attributed to rounding or to errors of the central differences."""


@dataclass(frozen=True, eq=False)
class SampledRest:
    """A loop at its equilibrium for the constant commands ``level``; ``state`` is the flat state of ``loop`` just after a sample.

    ideal  the estimates that have their true values at the equilibrium
    """

    problem: TrackingProblem
    loop: ClosedLoop
    state: Array
    signals: Array
    level: Array
    ideal: tuple[StatePart, ...]

    @cached_property
    def found(self) -> PlaceOfRest:
        """The commands and the estimates at the equilibrium."""
        return place_of(self.loop, self.state, self.level, self.ideal)

    def with_estimates_frozen(self) -> Linearised:
        """The loop with estimates and memory frozen."""
        return acting(self._frozen_at(self.state))

    def _frozen_at(self, state: Array) -> Linearised:
        return of_jacobians(self.loop, *self._jacobians(self._sampled_frozen, state), left_out=self.resting)

    def _jacobians(self, sampled: Callable[[Array, Array], Array], state: Array) -> tuple[Array, Array]:
        return np.array(self._between(state, self.signals)), np.array(sampled(state, self.signals))

    @cached_property
    def _between(self) -> Callable[[Array, Array], Array]:
        return jacobian_function(self.loop)

    @cached_property
    def _sampled(self) -> Callable[[Array, Array], Array]:
        return sampled_jacobian_function(self.loop)

    @cached_property
    def _sampled_frozen(self) -> Callable[[Array, Array], Array]:
        return sampled_jacobian_function(self.loop, frozen=True)

    def at(self, theta: Array) -> SampledLoop:
        """The loop with frozen estimates for the plant with a different theta, for phi(x) = x and one input.

        The loop is linear, so it depends on the state at which it is differentiated only through the estimates.
        """
        problem = self.problem
        assert isinstance(problem, Problem)
        moved = replace(problem, plant=replace(problem.plant, theta=theta))
        state = self.state.copy()
        for part in self.ideal:
            value = truth_of(moved, part)
            assert value is not None
            state[part.rows] = value
        found = self._frozen_at(state)
        own = problem.plant.states  # the states of a baseline are known, and so are their inputs
        return acting(replace(found, loop=found.for_change(problem.plant.b[:own], (theta - problem.plant.theta)[:own]))).loop

    def with_its_law(self) -> SampledLoop:
        """The loop with its law, without constant combinations of the estimates and the law's memory."""
        between, J = np.array(self._between(self.state, self.signals)), sum(self._on_both_sides, np.zeros(())) / 2
        whole = of_jacobians(self.loop, between, J, estimates=self.resting)
        found = acting(whole)
        rows = found.rows["estimates"]
        V = _moved(found.loop.J, rows[rows >= 0])
        loop = found.loop
        return SampledLoop(V.T @ loop.A @ V, V.T @ loop.E, V.T @ loop.J @ V, loop.C @ V, loop.T)

    @property
    def resting(self) -> Array:
        """The rows of the estimates and of the law's memory."""
        return rows_of(self.loop, resting_parts(self.loop))

    @cached_property
    def has_a_corner(self) -> bool:
        """Whether the law has a corner at the equilibrium, as on a face of the known set, so that its Jacobians on the two sides
        differ."""
        one, other = self._on_both_sides
        return not np.allclose(one, other, rtol=1e-3, atol=1e-6 * np.abs(one).max())

    @cached_property
    def _on_both_sides(self) -> tuple[Array, Array]:
        """The Jacobians of a sample on both sides of the equilibrium: an implicit step uses the magnitude of an error, which is
        zero there."""
        rows = rows_of(self.loop, estimates_of(self.loop))
        hair = np.zeros(self.loop.size)
        hair[rows] = BESIDE * max(1.0, float(np.linalg.norm(self.state))) * np.cos(1.0 + np.arange(len(rows)))
        one, other = (np.array(self._sampled(self.state + side, self.signals)) for side in (hair, -hair))
        return one, other


def sampled_rest(
    problem: TrackingProblem, controller: Controller, adapting: Container[str], *, frozen: bool
) -> SampledRest | NotApplicable:
    """The equilibrium of the loop, with true estimates if they are known; ``frozen`` estimates keep their initial values.

    For ``adapting``, see ``adapting_of``.
    """
    loop = ClosedLoop.of(problem, controller)
    why = why_no_rest(loop)
    if why is not None:
        return why
    loop = without_limits(loop)
    level, signals = largest_commands(problem, loop)
    estimates = estimates_of(loop)
    true = {part: value for part in estimates if part.name in adapting and (value := truth_of(problem, part)) is not None}
    if not frozen and (not true or any(part.name in adapting and part not in true for part in estimates)):
        return NotApplicable("its estimates have no true values, so its equilibrium is not known")
    everything = np.arange(2 * loop.size)
    kept = rows_of(loop, resting_parts(loop) if frozen else estimates)
    free, resting = np.setdiff1d(np.arange(loop.size), kept), np.setdiff1d(everything, kept) if frozen else everything
    moves, slopes = _moves(loop, signals, frozen=frozen), _slopes(loop, signals, frozen=frozen)
    state = newton(moves, slopes, _start(loop, level, signals, true), free, resting)
    if state is None:
        return NotApplicable(f"no equilibrium of the sampled-data loop was found {words_of(level)}")
    for _ in range(POLISHING_STEPS):
        state[free] -= np.linalg.lstsq(slopes(state)[np.ix_(resting, free)], moves(state)[resting], rcond=None)[0]
    return SampledRest(problem, loop, state, signals, level, tuple(true))


def adapting_of(problem: TrackingProblem, continuous: Controller) -> frozenset[str]:
    """The names of the estimates that change, determined from the continuous controller that is sampled.

    An observer and the shell of its measurements are omitted: the observer of a sampled controller has no continuous form, and
    the same estimates change without an observer.
    """
    if isinstance(problem, Problem) and problem.fixed_observer is not None:
        problem = replace(problem, observer=None, sensor=None, shell=None, faults=(), truth=None)
    loop = without_limits(ClosedLoop.of(problem, continuous))
    return frozenset(part.name for part in adapting_parts(loop, largest_commands(problem, loop)[1]))


def _moves(loop: ClosedLoop, signals: Array, *, frozen: bool) -> Callable[[Array], Array]:
    """The change at a sample, and the rates between samples, (2 size,)."""
    sampled, rates = sampled_function(loop, frozen=frozen), right_hand_side(loop)

    def moves(state: Array) -> Array:
        return np.concatenate([np.asarray(sampled(state, signals)).ravel() - state, np.asarray(rates(state, signals)).ravel()])

    return moves


def _slopes(loop: ClosedLoop, signals: Array, *, frozen: bool) -> Callable[[Array], Array]:
    sampled, between = sampled_jacobian_function(loop, frozen=frozen), jacobian_function(loop)
    identity = np.eye(loop.size)
    return lambda state: np.vstack([np.asarray(sampled(state, signals)) - identity, np.asarray(between(state, signals))])


def _start(loop: ClosedLoop, level: Array, signals: Array, true: dict[StatePart, Array]) -> Array:
    """The state after a sample: model and plant at the model's steady state, held there, with true estimates."""
    start, places = np.array(loop.initial(), dtype=float), loop.unpack(np.arange(loop.size))
    held = places.held
    start[held.started] = 1.0
    start[held.r] = level.reshape(np.shape(held.r))
    A, B, _ = loop.model.matrices  # type: ignore[attr-defined]  # of every problem's model
    x_m = np.linalg.solve(A, -(B.reshape(len(A), -1) @ level))
    start[places.x_m] = start[held.x_m] = x_m
    for part, value in true.items():
        start[part.rows] = value
    if len(places.x) + (0 if loop.baseline is None else loop.baseline.order) == len(x_m):
        start[places.x], start[held.baseline] = x_m[: len(places.x)], x_m[len(places.x) :]
        if len(held.observer) == len(places.x):
            start[held.observer] = x_m[: len(places.x)]
    for part in loop.parts:
        if part.role.kind == "predictor" and part.size == len(x_m):
            start[part.rows] = x_m
    # the held control and the dynamics before and after the plant count only through their rates
    between = [places.x, held.u.reshape(-1), places.sensor, *(np.reshape(part, -1) for path in places.input for part in path)]
    free = np.concatenate([part.reshape(-1) for part in between]).astype(int)
    jacobian = jacobian_function(loop)
    rests = newton(
        lambda state: np.asarray(loop.derivative(state, signals), dtype=float),
        lambda state: np.asarray(jacobian(state, signals)),
        start,
        free if loop.baseline is not None or len(places.x) != len(x_m) else free[len(x_m) :],
        np.setdiff1d(np.arange(loop.size), places.x_m),
    )
    start = start if rests is None else rests
    measured, _ = loop.sampled_at(start, signals)
    start[held.measured] = measured
    return start


def _moved(J: Array, rows: Array) -> Array:
    """Orthonormal columns that span all combinations of these ``rows`` of the state except those that stay constant. A row whose
    motion is smaller than that of another row by this factor changes only by rounding."""
    moves = (J - np.eye(len(J)))[rows]
    sizes = np.linalg.norm(moves, axis=1)
    moving = sizes > BY_ROUNDING * sizes.max(initial=0.0)
    scaled = np.where(moving[:, None], moves / np.where(moving, sizes, 1.0)[:, None], 0.0)
    left, values, _ = np.linalg.svd(scaled)
    rank = int(np.sum(values > BY_ROUNDING * values.max(initial=0.0)))
    conserved = left[:, rank:] / np.where(moving, sizes, 1.0)[:, None]
    if conserved.shape[1] == 0:
        return np.eye(len(J))
    whole = np.zeros((len(J), conserved.shape[1]))
    whole[rows] = conserved
    return np.asarray(np.linalg.svd(whole)[0][:, conserved.shape[1] :])


def acting(found: Linearised) -> Linearised:
    """The loop without states that affect neither the control nor the plant: zero entries of these Jacobians are exact.

    A state of the plant that is not fed back has no effect on the margins, but the loop may be unstable because of it.
    """
    loop, x = found.loop, found.rows["x"]
    acts = (loop.C != 0).any(axis=0)
    acts[x[x >= 0]] = True
    for _ in range(len(acts)):
        acts = acts | (loop.A[acts] != 0).any(axis=0) | (loop.J[acts] != 0).any(axis=0)
    kept = np.flatnonzero(acts)
    inner, where = np.ix_(kept, kept), np.full(len(acts) + 1, -1)
    where[kept] = np.arange(len(kept))
    rows = {name: where[part] for name, part in found.rows.items()}
    return Linearised(SampledLoop(loop.A[inner], loop.E[kept], loop.J[inner], loop.C[:, kept], loop.T), rows)
