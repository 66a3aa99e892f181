"""W_m(s) of the parametric model (13), the filter Q(s) of the auxiliary input that inverts it, and the filters around them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import lru_cache
from typing import Any, NamedTuple, Protocol

import numpy as np

from barbalat import validate
from barbalat.adaptation.law import AdaptiveLaw, Estimation
from barbalat.linear.systems import StateSpace, TransferFunction, transfer_function
from barbalat.problem.known_set import EstimateSet, limit
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Value
from barbalat.roles import Role, within
from barbalat.validate import Array, InputError

PARAMETRIC_MODEL = {
    "xi": Role.filter("filtered part of the parametric model (13) that is known"),
    "Xi": Role.filter("filtered regressor of the parametric model (13)"),
    "n_d": Role.filter("dynamic normalising signal of (16)"),
    "swapping": Role.filter("swapping term of the auxiliary input (14)"),
}
"""What schemes on the parametric model keep beside the estimates and the law's memory."""


def minimum_phase_model(c_0: Array, known: Known) -> TransferFunction:
    """W_m(s) = c_0'(sI - A_m)^-1 b; InputError where it has a zero in Re s >= 0 or is zero."""
    W_m = _model(c_0.tobytes(), known.A_m.tobytes(), known.b.tobytes())
    if not W_m.num.any():
        raise InputError(f"c_0 must not be zero, got {validate.show(c_0)}")
    if not W_m.is_minimum_phase:
        raise InputError(
            f"c_0 must make W_m(s) = c_0'(sI - A_m)^-1 b minimum phase, but c_0 = {validate.show(c_0)} "
            f"gives a zero with real part {W_m.zeros.real.max():.6g}"
        )
    return W_m


@lru_cache(maxsize=64)  # the members of an ensemble mostly share all three
def _model(c_0: bytes, A_m: bytes, b: bytes) -> TransferFunction:
    c, A, b_ = (np.frombuffer(part) for part in (c_0, A_m, b))
    return transfer_function(c, A.reshape(len(b_), len(b_)), b_)


@lru_cache(maxsize=64)  # by the model itself, which is the same one for the same numbers
def auxiliary_filter(W_m: TransferFunction, tau: float) -> StateSpace:
    """Q(s) = W_m(s)^-1/(tau s + 1)^n*, n* the relative degree of W_m: proper, stable, of the order of the plant."""
    lag = np.array([1.0])
    for _ in range(W_m.relative_degree):
        lag = np.polymul(lag, [tau, 1.0])
    return TransferFunction(W_m.den, np.polymul(W_m.num, lag)).realise()


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
    estimate_set: EstimateSet | None

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
        return state._replace(theta_hat=limit(state.theta_hat, self.estimate_set), memory=self.law.limit(state.memory))
