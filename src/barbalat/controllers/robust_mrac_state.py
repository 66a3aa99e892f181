"""What the schemes on the parametric model (13) integrate, and what of it is the same for one input and for several."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, NamedTuple, Protocol

import numpy as np

from barbalat.adaptation.law import AdaptiveLaw, Estimation
from barbalat.controllers.parametric_model import PARAMETRIC_MODEL
from barbalat.problem.known_set import EstimateSet, limit
from barbalat.protocols import Value
from barbalat.roles import Role, within
from barbalat.validate import Array


class State(NamedTuple):
    """What the controller integrates."""

    theta_hat: Value  # (p,) estimate of theta, (p m,) with m inputs
    memory: Any  # of the law
    xi: Value  # (n,) the known part of x: xi' = A_m xi + b u, xi(0) = x(0); sat(u) with ``saturated_predictor``
    Xi: Value  # (n, p) W_b(s)[phi(x)'], where phi(x) = x in the paper
    n_d: Value  # scalar, dynamic normalising signal
    swapping: Value  # (n,) (sI - A_m)^-1 [Xi theta_hat']; (0,) without auxiliary input
    filter: Value  # (n,) state of Q(s); (0,) without auxiliary input


class RealisedFilter(Protocol):
    """Q(s) of (14), with n states."""

    def derivative(self, q: Value, v: Value) -> Value: ...


class OnParametricModel(ABC):
    """Equations whose law is driven by the estimation error of (13)."""

    A_m: Array
    Q: RealisedFilter | None
    law: AdaptiveLaw
    theta_hat0: Array
    x0: Array
    box: EstimateSet | None

    @abstractmethod
    def estimation(self, state: State, x: Value) -> Estimation:
        """phi, m_s^2 and epsilon."""

    @abstractmethod
    def auxiliary_input_argument(self, state: State, x: Value) -> Value:
        """What -Q(s) filters to become the auxiliary input."""

    @property
    def roles(self) -> dict[str, Role]:
        return PARAMETRIC_MODEL | within("memory", self.law)

    def initial(self) -> State:
        n, p = len(self.A_m), len(self.theta_hat0)
        auxiliary = np.zeros(0 if self.Q is None else n)
        memory = self.law.initial(p)
        return State(self.theta_hat0, memory, self.x0, np.zeros((n, p)), np.zeros(()), auxiliary, auxiliary)

    def regressor_at(self, state: State, x: Value, u: Value) -> Value:
        estimation = self.estimation(state, x)
        return estimation.phi / np.sqrt(estimation.m_s_squared)

    def auxiliary_rates(self, state: State, x: Value, theta_hat_dot: Value) -> tuple[Value, Value]:
        """Return the rates of the states of the swapping term and of Q(s)."""
        if self.Q is None:
            return state.swapping, state.filter
        swapping_dot = self.A_m @ state.swapping + state.Xi @ theta_hat_dot
        return swapping_dot, self.Q.derivative(state.filter, self.auxiliary_input_argument(state, x))

    def limit(self, state: State) -> State:
        return state._replace(theta_hat=limit(state.theta_hat, self.box), memory=self.law.limit(state.memory))
