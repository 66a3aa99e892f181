"""The Lyapunov-preserving sampled controllers: implicit midpoint steps in closed form, O(n^2) for each sample.

docs/sampled.md states and proves what holds. What multiplies a sample time T is taken in its middle: x_mid = (x + x_next)/2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.adaptation import implicit
from barbalat.adaptation.gain import as_matrix, times
from barbalat.controllers import l1, robust_mrac
from barbalat.controllers.windup import applied
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


@dataclass(frozen=True, eq=False)
class Predictor:
    """Predictor (8) and law (7) in one implicit midpoint step; with C = 1 the MRAC.

    V = x_tilde'P x_tilde + theta_tilde'Gamma^-1 theta_tilde falls by T |x_tilde_mid|^2 at each sample, for every Gamma and T.
    """

    continuous: l1.Equations
    sample_time: float
    model: LinearStep
    filter: Filter
    coupling: Array | float  # T^2/4 b'P (I - T/2 A_m)^-1 b > 0; (m, m) with m inputs

    @classmethod
    def of(cls, equations: l1.Equations, T: float) -> Predictor:
        if not equations.modifications.is_off:
            raise InputError("discretization = 'midpoint' is proven for the plain law, without leakage, dead zone and learning")
        implicit.require_projectable(equations.gamma, equations.box)
        model = LinearStep.of(equations.A_m, T)
        coupling = T**2 / 4 * (equations.b.T @ equations.P @ model.half @ equations.b)
        if np.ndim(coupling) == 0:
            coupling = float(coupling)
        return cls(equations, T, model, Filter.of(equations.C, T), coupling)

    def initial(self) -> l1.State:
        return self.continuous.initial()

    def control(self, state: l1.State, x: Value, x_m: Value, r: Value) -> Value:
        return self.continuous.control(state, x, x_m, r)

    def advance(self, state: l1.State, before: Sample, u: Value, now: Sample) -> l1.State:
        c, T, u = self.continuous, self.sample_time, self.continuous.applied(u)
        x_mid = (before.x + now.x) / 2
        phi = (c.uncertainty.with_input(before.x, u) + c.uncertainty.with_input(now.x, u)) / 2
        known = c.uncertainty.known_input(u)
        # the predictor's middle, were the estimates to rest; that they move with it costs one division: the coupling is rank one
        at_rest = self.model.middle(state.x_hat, np.dot(c.b, phi.T @ state.theta_hat + known))
        gain = times(c.gamma, phi) if len(phi.shape) == 1 else as_matrix(c.gamma, phi.shape[0]) @ phi
        moved = T * np.dot(gain, self._solve(phi.T @ gain, (x_mid - at_rest) @ (c.P @ c.b)))
        x_hat = self.model.end(state.x_hat, np.dot(c.b, phi.T @ (state.theta_hat + moved / 2) + known))
        following = l1.State(implicit.into(state.theta_hat + moved, c.box, c.gamma), x_hat, state.filter)
        wanted = c.filter_input(state, before.x, before.r), c.filter_input(following, now.x, now.r)
        return following._replace(filter=self.filter.end(state.filter, *wanted))

    def _solve(self, excitation: Value, right: Value) -> Value:
        """(I + coupling excitation)^-1 right: a division for one input, elimination for several.

        ``excitation`` is Phi'Gamma Phi; for several inputs det(I + K E) != 0 since K has a positive definite symmetric part
        and E is positive semidefinite.
        """
        inputs = self.continuous.uncertainty.inputs
        if inputs == 1:
            return right / (1 + self.coupling * excitation)
        return np.linalg.solve(np.eye(inputs) + self.coupling @ excitation, right)


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
