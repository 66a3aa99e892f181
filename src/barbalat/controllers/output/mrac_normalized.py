"""Output-feedback MRAC with a normalised law on the parametric model and with the auxiliary input.

Source: Section IV of the paper, first sentence; Ioannou and Sun, sections 6.5 and 9.3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from barbalat.adaptation import implicit
from barbalat.adaptation.law import AdaptiveLaw, Estimation, Normalization
from barbalat.controllers.output.mrac_unnormalized import REGRESSOR_FILTERS
from barbalat.controllers.parametric_model import PARAMETRIC_MODEL, Estimator
from barbalat.controllers.steps import Filter, LinearStep
from barbalat.controllers.windup import applied
from barbalat.linear.systems import StateSpace
from barbalat.problem.known_set import ParameterBox, limit
from barbalat.protocols import Sample, Value
from barbalat.roles import Role, within
from barbalat.validate import Array


@dataclass(frozen=True, eq=False)
class OutputEstimator(Estimator):
    """The laws on the parametric model z = W_m[u] = theta'phi_p; ``regressors`` advances omega_1 and omega_2."""

    continuous: Equations
    regressors: LinearStep

    @classmethod
    def of(cls, equations: Equations, T: float) -> OutputEstimator:
        law = implicit.require_sampled(equations.law, equations.estimate_set)
        Q = None if equations.Q is None else Filter.of(equations.Q, T)
        regressors, model = LinearStep.of(equations.regressor_filter.A, T), LinearStep.of(equations.W_m.A, T)
        return cls(equations, T, law, model, Q, regressors)

    def advance(self, state: State, before: Sample, u: Value, now: Sample) -> State:
        c = self.continuous
        y, r, u = (before.x + now.x) / 2, (before.r + now.r) / 2, applied(u, c.limits)
        g, W_m = c.regressor_filter.B, c.W_m
        omega_1, omega_2 = self.regressors.middle(state.omega_1, g * u), self.regressors.middle(state.omega_2, g * y)
        omega = np.concatenate([omega_1, omega_2, y.reshape(1), r.reshape(1)])
        xi, Xi = self.model.middle(state.xi, W_m.B * u), self.model.middle(state.Xi, np.outer(W_m.B, omega))
        phi = np.concatenate([(W_m.C @ Xi)[:-1], y.reshape(1)])
        learnt = self.learnt(state, z=W_m.C @ xi, phi=phi, driven=u * u + y * y)
        following = state._replace(
            **learnt._asdict(),
            omega_1=2 * omega_1 - state.omega_1,
            omega_2=2 * omega_2 - state.omega_2,
            xi=2 * xi - state.xi,
            Xi=2 * Xi - state.Xi,
        )
        following = following._replace(swapping=self.swapped(state, following, Xi))
        return following._replace(filter=self.filtered(state, following, before, now))


class State(NamedTuple):
    """The controller's states."""

    theta_hat: Value  # (2 n,): theta_1 (n - 1), theta_2 (n - 1), theta_3, c_0
    omega_1: Value  # (n - 1,) alpha(s)/Lambda(s)[u]
    omega_2: Value  # (n - 1,) alpha(s)/Lambda(s)[y]
    memory: Any  # of the law
    xi: Value  # (order of W_m,) W_b(s)[u]
    Xi: Value  # (order of W_m, 2 n) W_b(s)[omega']
    n_d: Value  # scalar, dynamic normalising signal
    swapping: Value  # (order of W_m,) (sI - A)^-1 [Xi theta_hat']
    filter: Value  # state of Q(s)


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations:
    """u = theta_hat'omega + u_a, omega = [alpha/Lambda u; alpha/Lambda y; y; r]."""

    regressor_filter: StateSpace
    W_m: StateSpace
    law: AdaptiveLaw
    normalization: Normalization
    Q: StateSpace | None
    theta_hat0: Array
    estimate_set: ParameterBox | None
    limits: Array | None = None  # limits of the input, if the parametric model receives sat(u)

    @property
    def roles(self) -> dict[str, Role]:
        return PARAMETRIC_MODEL | REGRESSOR_FILTERS | within("memory", self.law)

    def initial(self) -> State:
        parameters, order = len(self.theta_hat0), self.W_m.order
        rest = np.zeros(self.regressor_filter.order)
        return State(
            theta_hat=self.theta_hat0,
            omega_1=rest,
            omega_2=rest,
            memory=self.law.initial(parameters),
            xi=np.zeros(order),
            Xi=np.zeros((order, parameters)),
            n_d=np.zeros(()),
            swapping=np.zeros(0 if self.Q is None else order),
            filter=np.zeros(0 if self.Q is None else self.Q.order),
        )

    def omega(self, state: State, y: Value, r: Value) -> Value:
        return np.concatenate([state.omega_1, state.omega_2, y.reshape(1), r.reshape(1)])

    def estimation(self, state: State, y: Value) -> Estimation:
        """The parametric model z = W_m[u] = theta'phi_p, phi_p = [W_m omega_1; W_m omega_2; W_m y; y]."""
        z = self.W_m.C @ state.xi
        filtered = self.W_m.C @ state.Xi
        phi = np.concatenate([filtered[:-1], y.reshape(1)])
        m_s_squared = self.normalization.m_s_squared(phi, state.n_d)
        return Estimation(phi, m_s_squared, (z - state.theta_hat @ phi) / m_s_squared)

    def regressor_at(self, state: State, y: Value, u: Value) -> Value:
        """The normalised regressor phi_p/m at this state."""
        estimation = self.estimation(state, y)
        return estimation.phi / np.sqrt(estimation.m_s_squared)

    def auxiliary_input_argument(self, state: State, y: Value) -> Value:
        """epsilon m^2 - W_c[(W_b[omega'] theta')], W_c = -C'(sI - A)^-1."""
        estimation = self.estimation(state, y)
        return estimation.epsilon * estimation.m_s_squared + self.W_m.C @ state.swapping

    def control(self, state: State, y: Value, y_m: Value, r: Value) -> Value:
        u = state.theta_hat @ self.omega(state, y, r)
        return u if self.Q is None else u + self.Q.output(state.filter, self.auxiliary_input_argument(state, y))

    def derivative(self, state: State, y: Value, y_m: Value, r: Value, u: Value) -> State:
        omega, u = self.omega(state, y, r), applied(u, self.limits)
        rates = self.law.rates(state.theta_hat, state.memory, self.estimation(state, y), self.estimate_set)
        swapping, filter_dot = state.swapping, state.filter
        if self.Q is not None:
            swapping = self.W_m.A @ state.swapping + state.Xi @ rates.theta_hat
            filter_dot = self.Q.derivative(state.filter, self.auxiliary_input_argument(state, y))
        return State(
            theta_hat=rates.theta_hat,
            omega_1=self.regressor_filter.derivative(state.omega_1, u),
            omega_2=self.regressor_filter.derivative(state.omega_2, y),
            memory=rates.memory,
            xi=self.W_m.derivative(state.xi, u),
            Xi=self.W_m.A @ state.Xi + np.outer(self.W_m.B, omega),
            n_d=self.normalization.n_d_dot(state.n_d, u) + y * y,
            swapping=swapping,
            filter=filter_dot,
        )

    def limit(self, state: State) -> State:
        return state._replace(theta_hat=limit(state.theta_hat, self.estimate_set), memory=self.law.limit(state.memory))

    def sampled(self, T: float) -> OutputEstimator:
        return OutputEstimator.of(self, T)
