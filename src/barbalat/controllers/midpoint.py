"""The Lyapunov-preserving sampled controllers: implicit steps in closed form, O(n^2) for each sample.

docs/sampled.md states and proves what holds. What is measured is taken in the sample's middle, x_mid = (x + x_next)/2, what is
estimated at its end.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from barbalat.adaptation import implicit, within
from barbalat.controllers import l1, robust_mrac
from barbalat.controllers.windup import ModifiedError, applied
from barbalat.known_set import KnownSet
from barbalat.linear import StateSpace
from barbalat.protocols import Sample, Value
from barbalat.validate import Array, InputError


def half_step(A: Array, T: float) -> Array:
    """(I - T/2 A)^-1, which exists for every T > 0 where A is Hurwitz."""
    return np.linalg.inv(np.eye(len(A)) - T / 2 * A)


@dataclass(frozen=True, eq=False)
class LinearStep:
    """x' = A x + forcing over one sample with the forcing held at its middle value."""

    half: Array  # (I - T/2 A)^-1
    T: float

    @classmethod
    def of(cls, A: Array, T: float) -> LinearStep:
        return cls(half_step(A, T), T)

    def middle(self, state: Value, forcing: Value) -> Value:
        return self.half @ (state + self.T / 2 * forcing)

    def end(self, state: Value, forcing: Value) -> Value:
        return 2 * self.middle(state, forcing) - state


@dataclass(frozen=True, eq=False)
class Filter:
    """C(s), Q(s) by the trapezoidal rule (Tustin): stable for every T, the same gain at DC."""

    system: StateSpace
    step: LinearStep

    @classmethod
    def of(cls, system: StateSpace, T: float) -> Filter:
        return cls(system, LinearStep.of(system.A, T))

    def end(self, state: Value, before: Value, now: Value) -> Value:
        middle = (before + now) / 2
        return self.step.end(state, self.system.B * middle if state.ndim == 1 else np.outer(self.system.B, middle))


class Unmoved(NamedTuple):
    """The end of the sample, were the estimates zero or at rest."""

    x_hat: Value  # (n,) predictor with zero estimates
    error: Value  # x_tilde'P b with the estimates as they are; (m,) with m inputs
    phi: Value  # regressor in the middle


@dataclass(frozen=True, eq=False)
class Predictor:
    """Predictor (8) and law (7) in one implicit step; with C = 1 the MRAC.

    V = x_tilde'P x_tilde + theta_tilde'Gamma^-1 theta_tilde falls by at least T |x_tilde|^2 a sample, for every Gamma, T.
    The predictor is fed with the estimate as the known set leaves it: with C = 1 it then stays with the reference model.
    """

    continuous: l1.Equations
    sample_time: float
    known_set: KnownSet | None  # what the step keeps to; with a leakage it holds the origin as well
    end: Array  # (I - T A_m)^-1
    filter: Filter
    coupling: Array | float  # T b'P (I - T A_m)^-1 b > 0; (m, m) with m inputs
    windup: ModifiedError | None = None

    @classmethod
    def of(cls, equations: l1.Equations, T: float, windup: ModifiedError | None = None) -> Predictor:
        modifications, box = equations.modifications, equations.box
        if modifications.dead_zone is not None:
            raise InputError(
                "discretization = 'midpoint' takes no dead zone on sqrt(e'P e): its implicit step has no closed form; take "
                "'euler', or a dead zone in a law on the parametric model"
            )
        implicit.require_projectable(equations.gamma, box)
        end = half_step(equations.A_m, 2 * T)
        coupling = T * (equations.b.T @ equations.P @ end @ equations.b)
        return cls(
            equations,
            T,
            within.kept_to(box, len(equations.theta_hat0), leaking=modifications.leakage is not None),
            end,
            Filter.of(equations.C, T),
            float(coupling) if np.ndim(coupling) == 0 else coupling,
            windup,
        )

    def initial(self) -> l1.State:
        return self.continuous.initial()

    def control(self, state: l1.State, x: Value, x_m: Value, r: Value) -> Value:
        u = self.continuous.control(state, x, x_m, r)
        return u if self.windup is None else self.windup.control(u, self.continuous.limits)

    def advance(self, state: l1.State, before: Sample, u: Value, now: Sample) -> l1.State:
        c, T, u = self.continuous, self.sample_time, self.continuous.applied(u)
        unmoved = self._unmoved(state, before, u, now)
        memory = self._memory(state, before, u, now)
        theta_hat = implicit.with_leakage(
            c.modifications.leakage, state.theta_hat, unmoved.error, lambda w: self._moved(state, memory, unmoved, w)
        )
        x_hat = unmoved.x_hat + T * (self.end @ np.dot(c.b, unmoved.phi.T @ theta_hat))
        following = l1.State(implicit.into(theta_hat, c.box, c.gamma), x_hat, state.filter, memory)
        wanted = c.filter_input(state, before.x, before.r), c.filter_input(following, now.x, now.r)
        return following._replace(filter=self.filter.end(state.filter, *wanted))

    def _unmoved(self, state: l1.State, before: Sample, u: Value, now: Sample) -> Unmoved:
        c, T = self.continuous, self.sample_time
        phi = (c.uncertainty.with_input(before.x, u) + c.uncertainty.with_input(now.x, u)) / 2
        # A_m acts on x_mid - x_tilde: what is measured enters as in the midpoint rule, what is estimated at the sample's end
        measured = np.dot(c.b, c.uncertainty.known_input(u)) - c.A_m @ ((now.x - before.x) / 2)
        x_hat = self.end @ (state.x_hat + T * measured)
        error = (now.x - x_hat) @ (c.P @ c.b) - np.dot(self.coupling, phi.T @ state.theta_hat)
        return Unmoved(x_hat, error, phi)

    def _moved(self, state: l1.State, memory: Any, unmoved: Unmoved, w: Value) -> Value:
        """The estimate at the sample's end, with the leakage w."""
        c, T, learning = self.continuous, self.sample_time, self.continuous.modifications.learning
        pull = () if learning is None else (learning.gamma_c * memory.R, learning.gamma_c * memory.Q)
        gain, rest = implicit.at_rest(c.gamma, state.theta_hat, T, w, *pull)
        error = unmoved.error - np.dot(self.coupling, unmoved.phi.T @ (rest - state.theta_hat))
        return within.step(rest, T * gain, unmoved.phi, self.coupling, error, self.known_set)

    def _memory(self, state: l1.State, before: Sample, u: Value, now: Sample) -> Any:
        c, learning = self.continuous, self.continuous.modifications.learning
        if learning is None:
            return state.memory
        phi = (c.uncertainty.with_input(before.x, u) + c.uncertainty.with_input(now.x, u)) / 2
        known = c.uncertainty.known_input(u)
        return learning.advance(state.memory, self.sample_time, c.A_m, c.b, (before.x + now.x) / 2, phi, known)


@dataclass(frozen=True, eq=False)
class Estimator:
    """The normalised laws on the parametric model (13): the filters by midpoint, the law as in ``adaptation.implicit``."""

    continuous: robust_mrac.Equations
    sample_time: float
    model: LinearStep
    filter: Filter | None

    @classmethod
    def of(cls, equations: robust_mrac.Equations, T: float) -> Estimator:
        implicit.require_implicit(equations.law, equations.box)
        Q = None if equations.Q is None else Filter.of(equations.Q, T)
        return cls(equations, T, LinearStep.of(equations.A_m, T), Q)

    def initial(self) -> robust_mrac.State:
        return self.continuous.initial()

    def control(self, state: robust_mrac.State, x: Value, x_m: Value, r: Value) -> Value:
        return self.continuous.control(state, x, x_m, r)

    def advance(self, state: robust_mrac.State, before: Sample, u: Value, now: Sample) -> robust_mrac.State:
        c, T = self.continuous, self.sample_time
        u = applied(u, c.limits)
        x_mid = (before.x + now.x) / 2
        xi_mid = self.model.middle(state.xi, c.b * u)
        Xi_mid = self.model.middle(state.Xi, np.outer(c.b, (c.regressor(before.x) + c.regressor(now.x)) / 2))
        phi = c.c_0 @ Xi_mid  # (13)
        z = c.c_0 @ (x_mid - xi_mid)  # (13)
        decay = np.exp(-c.normalization.delta_0 * T)
        n_d = decay * state.n_d + (1 - decay) / c.normalization.delta_0 * (u * u)  # (16), exact for the u that was held
        m_s_squared = c.normalization.m_s_squared(phi, (state.n_d + n_d) / 2)
        theta_hat, memory = implicit.step(c.law, T, state.theta_hat, state.memory, z, phi, m_s_squared, c.box)
        following = robust_mrac.State(
            theta_hat=theta_hat,
            memory=memory,
            xi=2 * xi_mid - state.xi,
            Xi=2 * Xi_mid - state.Xi,
            n_d=n_d,
            swapping=state.swapping,
            filter=state.filter,
        )
        if self.filter is None:
            return following
        following = following._replace(swapping=self.model.end(state.swapping, Xi_mid @ (theta_hat - state.theta_hat) / T))
        wanted = c.auxiliary_input_argument(state, before.x), c.auxiliary_input_argument(following, now.x)
        return following._replace(filter=self.filter.end(state.filter, *wanted))
