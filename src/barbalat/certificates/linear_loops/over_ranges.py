"""The margins of linear loops over the ranges of physical parameters: one controller around the real plant at each point.

The plant at p is A(p), b(p), with its gain, delay, actuator and sensor; A and b are not projected onto theta and omega, so the
loop includes the unmatched part. The controller is differentiated once, by the exact Jacobians of its equations with frozen
estimates, and the plant matrices are inserted. Estimates that are true at the design point have the true values for the plant at
p, theta_hat = theta(p); other estimates keep their values.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from barbalat.certificates.assumptions import LINEAR_LOOP_ONLY
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import NotApplicable
from barbalat.certificates.linear_loops.at_rest import (
    Rest,
    estimates_of,
    reduced,
    rest_of,
    resting_parts,
    rows_of,
    without_limits,
)
from barbalat.certificates.linear_loops.from_sample_to_sample import of_jacobians
from barbalat.certificates.linear_loops.ideal import open_jacobians
from barbalat.certificates.linear_loops.margin_values import KEYS_OF_MARGINS, is_unstable
from barbalat.certificates.linear_loops.sampled_rest import SampledRest, acting, adapting_of, sampled_rest
from barbalat.certificates.requested_keys import is_needed
from barbalat.certificates.rows import said_of
from barbalat.controllers import NormalizedMrac, RobustMrac, Sampled
from barbalat.linear.margins import Margins, margins
from barbalat.linear.sampled_loop import SampledLoop, delay_margin
from barbalat.linear.systems import StateSpace, TransferFunction, sensitivity, series
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import jacobian_function, sampled_jacobian_function
from barbalat.loop.packing import flatten
from barbalat.loop.true_values import truth_of
from barbalat.problem.actuation import PlantInput
from barbalat.problem.from_ranges import Members
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.validate import Array, InputError

MARGINS_KEY = "margins_over_known_set"
DRAWN, DELAYS = 40, 3
"""Seeded points inside the ranges, and number of points at which the delay margin of a sampled loop is computed. These are the
points with the smallest ratio of phase margin to frequency, because the computation takes as long as a hundred other margins."""
SEARCHED = (
    "{count} plants of the parameters' ranges, at {corners} corners, the nominal values and {drawn} seeded points: "
    "the smallest found, not a guarantee"
)
SHIFT, FREQUENCIES = 1e-3, 20
"""Size of the displacement at which the loop is checked for linearity, and the number of frequencies of this check."""


@dataclass(frozen=True, eq=False)
class PlantAt:
    """x' = A x + b v at values of the parameters, with v from u by ``dynamics`` and a delay, and x measured with a lag.

    theta, omega  projection of the plant, (p,) and (m,), to which estimates with true values are set
    """

    parameters: dict[str, float]
    A: Array
    b: Array
    dynamics: StateSpace | None
    delay: float
    lag: float
    theta: Array
    omega: Array

    def around(self, loop: StateSpace) -> StateSpace:
        """A loop through A and b, with the path before the input and the lag, which is in series with everything that is fed
        back."""
        loop = loop if self.dynamics is None else series(self.dynamics, loop)
        return loop if self.lag == 0 else series(loop, TransferFunction(np.ones(1), np.array([self.lag, 1.0])).realise())


def plants_of(problem: Problem) -> list[PlantAt]:
    """The plants of a design whose set is derived from the ranges of parameters; the first is the nominal one."""
    assert problem.derived is not None
    members = problem.derived.members(DRAWN)
    return [plant_at(problem, members, k) for k in range(len(members.parameters))]


def plant_at(problem: Problem, members: Members, k: int) -> PlantAt:
    """The plant of one member; raises InputError if the parameters give no input path or no sensor."""
    assert problem.derived is not None
    physical, values = problem.derived.physical, members.parameters[k]
    assert physical is not None
    own, there = physical.inputs(physical.nominal), physical.inputs(values)
    path = problem.plant.paths[0] if there is None else _moved(problem.plant.paths[0], own, there)
    sensing, measures = physical.sensing(physical.nominal), physical.sensing(values)
    lag = 0.0 if problem.sensor is None else problem.sensor.lag
    if sensing is not None and measures is not None:
        lag = measures.lag + (lag - sensing.lag)
    dynamics = None if path.dynamics is None else path.dynamics.realise()
    uncertain = {name: values[name] for name in members.uncertain}
    return PlantAt(uncertain, *physical.matrices(values), dynamics, path.delay, lag, members.theta[k], members.omega[k])


def _moved(path: PlantInput, own: PlantInput, there: PlantInput) -> PlantInput:
    """The input path of the problem with the changes due to the parameters; studies may already have changed its gain and
    delay."""
    parts = {
        name: getattr(there, name)
        for name in ("actuator", "multiplicative")
        if getattr(there, name) is not None and _numbers(getattr(there, name)) != _numbers(getattr(own, name))
    }
    return replace(path, gain=there.gain * (path.gain / own.gain), delay=there.delay + (path.delay - own.delay), **parts)


def _numbers(system: Any) -> tuple[list[float], list[float]]:
    return np.ravel(system.num).tolist(), np.ravel(system.den).tolist()


@dataclass(frozen=True, eq=False)
class Frozen(ABC):
    """A controller with frozen estimates, separate from its plant: the loop without input path and lag, and its flat state.

    ideal  names of the estimates that have their true values there; None for a linear controller, which has no frozen states
    """

    problem: Problem
    loop: ClosedLoop
    state: Array
    signals: Array
    ideal: frozenset[str] | None

    @property
    def which(self) -> str:
        """A description of the loop."""
        started = "in sampled-data form " if self.loop.sampled else ""
        if self.ideal is None or not self.loop.parameters:
            return f"{started}with a fixed controller"
        return f"{started}with its estimates frozen{', theta_hat = theta' if self.ideal else ''}"

    def at(self, plant: PlantAt) -> StateSpace | SampledLoop:
        """The loop around a plant, without its delay."""
        return self.around(self.with_estimates_of(plant), plant)

    @abstractmethod
    def around(self, state: Array, plant: PlantAt) -> StateSpace | SampledLoop:
        """The loop around a plant, without its delay, at a flat state."""
        ...

    @cached_property
    def resting(self) -> Array:
        """The rows of the states that a freeze holds."""
        return rows_of(self.loop, [] if self.ideal is None else resting_parts(self.loop))

    def is_linear(self, plant: PlantAt) -> bool:
        """Whether the loop is the same at a different state and therefore does not depend on the equilibrium."""
        marked = self.loop.unpack(np.arange(self.loop.size))
        held = marked.held.started if self.loop.sampled else []
        free = np.setdiff1d(np.arange(self.loop.size), np.concatenate([self.resting, np.ravel(held).astype(int)]))
        moved = self.state.copy()
        moved[free] += SHIFT * max(1.0, float(np.abs(self.state).max())) * np.cos(1.0 + np.arange(len(free)))
        w = np.geomspace(1e-2, 1e2, FREQUENCIES) * max(1.0, float(np.abs(np.linalg.eigvals(plant.A)).max()))
        loops = (self.around(state, plant) for state in (self.state, moved))
        one, other = ((one.as_continuous(0.0) if isinstance(one, SampledLoop) else one).response(w) for one in loops)
        return np.allclose(one, other, rtol=1e-6, atol=1e-9 * np.abs(one).max())

    def with_estimates_of(self, plant: PlantAt) -> Array:
        """The flat state with the true estimates for a plant."""
        state = self.state.copy()
        if self.ideal:
            moved = replace(self.problem, plant=replace(self.problem.plant, theta=plant.theta))
            if self.problem.input_gain is not None:
                moved = moved.with_inputs(lambda path: replace(path, gain=float(plant.omega[0])))
            for part in self.loop.parts:
                if part.name in self.ideal:
                    state[part.rows] = truth_of(moved, part)
        return state


class FrozenContinuous(Frozen):
    """A controller in continuous time, with its observer and baseline."""

    @cached_property
    def _open(self) -> Callable[[Array, float], Any]:
        found: Callable[[Array, float], Any] = open_jacobians(
            self.loop, lambda state, v: self.loop.derivative_given_input(state, self.signals, v)
        )
        return found

    def around(self, state: Array, plant: PlantAt) -> StateSpace:
        """From v to -u."""
        A, _, C = (np.array(part) for part in self._open(state, 0.0))
        marked, n = self.loop.unpack(np.arange(self.loop.size)), len(plant.A)
        x = marked.x
        own = np.setdiff1d(np.arange(self.loop.size), np.concatenate([x, marked.x_m, self.resting]))
        k, lagged = len(own), n if plant.lag > 0 else 0
        read = slice(k + n, k + 2 * n) if lagged else slice(k, k + n)
        M, B, u = np.zeros((k + n + lagged,) * 2), np.zeros(k + n + lagged), np.zeros(k + n + lagged)
        M[:k, :k], M[:k, read], M[k : k + n, k : k + n] = A[np.ix_(own, own)], A[np.ix_(own, x)], plant.A
        if lagged:
            M[read, k : k + n], M[read, read] = np.eye(n) / plant.lag, -np.eye(n) / plant.lag
        B[k : k + n], u[:k], u[read] = plant.b.reshape(-1), C[0, own], C[0, x]
        loop = reduced(M, B, u, (np.arange(len(M)) >= k) & (np.arange(len(M)) < k + n))
        return loop if plant.dynamics is None else series(plant.dynamics, loop)


class FrozenSampled(Frozen):
    """A controller that acts at samples, with its observer and baseline."""

    @cached_property
    def _between(self) -> Callable[[Array, Array], Array]:
        return jacobian_function(self.loop)

    @cached_property
    def _at_samples(self) -> Callable[[Array, Array], Array]:
        return sampled_jacobian_function(self.loop, frozen=self.ideal is not None)

    def around(self, state: Array, plant: PlantAt) -> SampledLoop:
        """The sampled-data loop."""
        slopes, J = (np.array(of(state, self.signals)) for of in (self._between, self._at_samples))
        found = of_jacobians(self.loop, slopes, J, left_out=self.resting)
        loop, x, n = found.loop, found.rows["x"], len(plant.A)
        own = np.setdiff1d(np.arange(len(loop.A)), x)
        path = StateSpace.gain(1.0) if plant.dynamics is None else plant.dynamics
        k, order, lagged = len(own), path.order, n if plant.lag > 0 else 0
        X, z, last = slice(k, k + n), slice(k + n, k + n + order), slice(k + n + order, k + n + order + lagged)
        read, size = last if lagged else X, k + n + order + lagged
        A, E, J, C = np.zeros((size, size)), np.zeros((size, 1)), np.eye(size), np.zeros((1, size))
        A[:k, :k], A[X, X], A[X, z], A[z, z] = loop.A[np.ix_(own, own)], plant.A, np.outer(plant.b, path.C), path.A
        E[X, 0], E[z, 0] = path.D * plant.b.reshape(-1), path.B
        if lagged:
            A[last, X], A[last, last] = np.eye(n) / plant.lag, -np.eye(n) / plant.lag
        J[:k, :k], J[:k, read], C[:, :k] = loop.J[np.ix_(own, own)], loop.J[np.ix_(own, x)], loop.C[:, own]
        rows = {"x": np.arange(k, k + n)}
        return acting(replace(found, loop=SampledLoop(A, E, J, C, loop.T), rows=rows)).loop


def frozen_controller(
    problem: Problem, controller: Controller, *, linear: bool
) -> FrozenContinuous | FrozenSampled | NotApplicable:
    """The controller separate from its plant, at the equilibrium of the design's margin; a ``linear`` controller has no frozen
    states."""
    whole = ClosedLoop.of(problem, controller)
    kind = FrozenSampled if whole.sampled else FrozenContinuous
    if linear:
        loop = _alone(without_limits(whole))
        state = np.zeros(loop.size)
        if whole.sampled:
            state[loop.unpack(np.arange(loop.size)).held.started] = 1.0  # after the first sample
        return kind(problem, loop, state, np.zeros(loop.signal_count), None)
    rest: Rest | SampledRest | NotApplicable
    if isinstance(controller, Sampled):
        rest = sampled_rest(problem, controller, adapting_of(problem, controller.controller), frozen=True)
    else:
        rest = rest_of(problem, whole, frozen=True)
    if isinstance(rest, NotApplicable):
        return rest
    state = np.asarray(flatten(rest.loop.unpack(rest.state)._replace(input=((),), sensor=np.zeros(0))))
    loop, ideal = _alone(rest.loop), frozenset(part.name for part in rest.ideal)
    if isinstance(controller, (RobustMrac, NormalizedMrac)):  # at zero the swapping term vanishes, see ``frozen``
        at_zero = np.zeros(loop.size)
        rows = rows_of(loop, estimates_of(loop))
        at_zero[rows] = state[rows]
        state = at_zero
    return kind(problem, loop, state, rest.signals, ideal)


def _alone(loop: ClosedLoop) -> ClosedLoop:
    return replace(loop, paths=(None,), lag=None)


@dataclass(frozen=True, eq=False)
class OverRanges:
    """The smallest margins found, keyed by the names of ``Margins``, each with the plant; or the plant whose loop is unstable."""

    least: dict[str, tuple[float, PlantAt]]
    unstable_at: PlantAt | None
    searched: str


def over_ranges(loops: Iterable[tuple[StateSpace | SampledLoop, PlantAt]]) -> OverRanges:
    """The smallest margins of the loops in addition to the plants' delays."""
    found, delays, lost = [], [], []
    for loop, plant in loops:
        if isinstance(loop, SampledLoop):
            beyond = loop.radius(plant.delay) - 1
            one = margins(loop.as_continuous(plant.delay)) if beyond < 0 else None
            delays.append((loop, plant))
        else:
            beyond = float(np.linalg.eigvals(sensitivity(loop).A).real.max(initial=-np.inf))
            one = _continuous(loop, plant.delay)
        if one is None:
            lost.append((beyond, plant))
        found.append((one, plant))
    plants = [plant for _, plant in found]
    searched = SEARCHED.format(count=len(plants), corners=len(plants) - 1 - DRAWN, drawn=DRAWN)
    if lost:
        return OverRanges({}, max(lost, key=lambda one: one[0])[1], searched)
    least = {}
    for name in KEYS_OF_MARGINS:
        values = np.array([getattr(one, name) for one, _ in found])
        k = int(values.argmax() if name == "gain_down" else values.argmin())
        least[name] = (float(values[k]), plants[k])
    if delays:  # margins of a sampled loop are evaluated on the unit circle, where a delay is not a pure phase
        order = np.argsort([one.delay for one, _ in found if one is not None], kind="stable")[:DELAYS]
        exact = [(value, plants[k]) for k in order if (value := _sampled(*delays[k])) is not None]
        least.pop("delay")
        if exact:
            least["delay"] = min(exact, key=lambda one: one[0])
    return OverRanges(least, None, searched)


def _continuous(loop: StateSpace, delay: float) -> Margins | None:
    """The margins in addition to a delay; None if the loop is unstable with it."""
    try:
        return margins(loop, delay)
    except InputError:
        if is_unstable(loop, delay):
            return None
        raise


def _sampled(loop: SampledLoop, plant: PlantAt) -> float | None:
    """The delay margin; None if there is none up to the longest delay tried."""
    try:
        return delay_margin(loop, plant.delay)
    except InputError:
        return None


def is_over_ranges(problem: TrackingProblem) -> bool:
    """Whether the plant has physical parameters and a loop whose margins can be given over their ranges."""
    if not isinstance(problem, Problem) or problem.derived is None:
        return False
    return problem.plant.inputs == 1 and problem.plant.is_linear


def entry_of(draft: Draft, which: str, problem: Problem, loop_at: Callable[[PlantAt], StateSpace | SampledLoop]) -> None:
    """Add the margins of a loop over the ranges to those that the draft already has."""
    with draft.part(MARGINS_KEY):
        try:
            found = over_ranges((loop_at(plant), plant) for plant in plants_of(problem))
        except InputError as error:
            draft.note(f"{NONE} of the linear loop {which}: {error}")
            return
        entry: dict[str, Any] = {"loop": which, "over": RANGES, "searched": found.searched, "unlimited": []}
        if found.unstable_at is not None:
            entry |= _place("unstable_at", problem, found.unstable_at)
            draft.note(f"linear loop {which}: unstable within the parameters' ranges, at {said_of(found.unstable_at.parameters)}")
        for name, (value, plant) in found.least.items():
            if np.isfinite(value):
                entry[KEYS_OF_MARGINS[name]] = {"value": value} | _place("", problem, plant)
            else:
                entry["unlimited"].append(KEYS_OF_MARGINS[name])
        draft.estimate({MARGINS_KEY: [*(draft.get(MARGINS_KEY) or []), entry]}, LINEAR_LOOP_ONLY)


RANGES, NONE = "the parameters' ranges", "no margins over the parameters' ranges"


def _place(key: str, problem: Problem, plant: PlantAt) -> dict[str, Any]:
    """A plant in JSON."""
    names = (key, f"{key}_gain", f"{key}_parameters") if key else ("theta", "input_gain", "parameters")
    found = (plant.theta.tolist(), None if problem.input_gain is None else float(plant.omega[0]), plant.parameters)
    return {name: value for name, value in zip(names, found, strict=True) if value is not None}


def with_margins_over_ranges(
    certificate: Certificate, problem: TrackingProblem, controller: Controller, *, linear: bool
) -> Certificate:
    """The certificate of a controller on a plant with physical parameters, with the margins over their ranges.

    linear  whether the controller is linear even without a freeze
    """
    if not is_over_ranges(problem) or not is_needed(MARGINS_KEY) or certificate.failure:
        return certificate
    assert isinstance(problem, Problem)
    assert problem.derived is not None
    draft = Draft({entry.key: entry for entry in certificate.entries}, list(certificate.notes))
    if problem.derived.unmatched and draft.get("mu_parameters") is not None:
        draft.note("mu covers the known set of theta, without the unmatched remainders of the parameters' ranges")
    apart = frozen_controller(problem, controller, linear=linear)
    if isinstance(apart, NotApplicable):
        draft.note(f"{NONE}: {apart.why}")
    elif not apart.is_linear(plant_at(problem, problem.derived.members(0), 0)):
        draft.note(f"{NONE}: with frozen estimates the loop is not linear")
    else:
        entry_of(draft, apart.which, problem, apart.at)
    return replace(certificate, entries=tuple(draft.entries.values()), notes=tuple(draft.notes))
