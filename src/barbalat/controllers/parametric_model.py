"""Parts of schemes that use the parametric model (13): W_m(s), the filter Q(s) that inverts it, the equations and the sampled
form."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple, Protocol, Self

import numpy as np

from barbalat import validate
from barbalat.adaptation.law import AdaptiveLaw, Estimation, Normalization, SampleData, SampledLaw
from barbalat.controllers.steps import Filter, LinearStep, SampledForm
from barbalat.linear.systems import StateSpace, TransferFunction, transfer_function
from barbalat.problem.known_set import EstimateSet, limit
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Equations, Sample, Value, kept
from barbalat.roles import Role, within
from barbalat.validate import Array, InputError

PARAMETRIC_MODEL = {
    "xi": Role.filter("filtered part of the parametric model (13) that is known"),
    "Xi": Role.filter("filtered regressor of the parametric model (13)"),
    "n_d": Role.filter("dynamic normalising signal of (16)"),
    "swapping": Role.filter("swapping term of the auxiliary input (14)"),
}
"""The states of schemes that use the parametric model, other than the estimates and the law's memory."""


def minimum_phase_model(c_0: Array, known: Known) -> TransferFunction:
    """Return W_m(s) = c_0'(sI - A_m)^-1 b; raises InputError if it is zero or has a zero in Re s >= 0."""
    W_m = _model(c_0.tobytes(), known.A_m.tobytes(), known.b.tobytes())
    if not W_m.num.any():
        raise InputError(f"c_0 must not be zero, got {validate.show(c_0)}")
    if not W_m.is_minimum_phase:
        raise InputError(
            f"c_0 must make W_m(s) = c_0'(sI - A_m)^-1 b minimum phase, but c_0 = {validate.show(c_0)} "
            f"gives a zero with real part {W_m.zeros.real.max():.6g}"
        )
    return W_m


@lru_cache(maxsize=64)  # most members of an ensemble share all three
def _model(c_0: bytes, A_m: bytes, b: bytes) -> TransferFunction:
    c, A, b_ = (np.frombuffer(part) for part in (c_0, A_m, b))
    return transfer_function(c, A.reshape(len(b_), len(b_)), b_)


@lru_cache(maxsize=64)  # keyed by the model object, which is the same for the same numbers
def auxiliary_filter(W_m: TransferFunction, tau: float) -> StateSpace:
    """Return Q(s) = W_m(s)^-1/(tau s + 1)^n*, where n* is the relative degree of W_m. Q is proper, stable and of the order of the
    plant."""
    lag = np.array([1.0])
    for _ in range(W_m.relative_degree):
        lag = np.polymul(lag, [tau, 1.0])
    return TransferFunction(W_m.den, np.polymul(W_m.num, lag)).realise()


class State(NamedTuple):
    """The controller's states."""

    theta_hat: Value  # (p,) estimate of theta, (p m,) with m inputs
    memory: Any  # of the law
    xi: Value  # (n,) the known part of x: xi' = A_m xi + b u, xi(0) = x(0); sat(u) with ``saturated_predictor``
    Xi: Value  # (n, p) W_b(s)[phi(x)'], where phi(x) = x in the paper
    n_d: Value  # scalar, dynamic normalising signal
    swapping: Value  # (n,) (sI - A_m)^-1 [Xi theta_hat']; (0,) without an auxiliary input
    filter: Value  # (n,) state of Q(s); (0,) without an auxiliary input


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
        """The signal that -Q(s) filters to become the auxiliary input."""

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


class ParametricEquations(Equations, Protocol):
    """The continuous equations that a sampled form advances."""

    @property
    def normalization(self) -> Normalization: ...

    @property
    def estimate_set(self) -> EstimateSet | None: ...

    def auxiliary_input_argument(self, state: Any, x: Value) -> Value: ...


class Learnt(NamedTuple):
    """The new parts of a state at the end of the sample, after the law's step."""

    theta_hat: Value
    memory: Any
    n_d: Value


@dataclass(frozen=True, eq=False)
class Estimator(SampledForm):
    """The filters use the midpoint rule, and the law the step of ``adaptation.implicit``; docs/sampled.md has the guarantees.

    The ``advance`` of a scheme computes the midpoint values of the filters, then calls ``learnt``, ``swapped`` and ``filtered``,
    in this order.

    model   of the filters xi and Xi
    filter  Q(s) of the auxiliary input; None without one
    """

    continuous: ParametricEquations
    sample_time: float
    law: SampledLaw
    model: LinearStep
    filter: Filter | None
    frozen: Value = field(default=None, kw_only=True)  # where it is true, estimates and memory are held; None: never

    explicit: ClassVar[bool] = False

    def learnt(self, state: Any, z: Value, phi: Value, driven: Value) -> Learnt:
        """Advance the law; ``driven`` is the input of n_d', held over the sample."""
        c, T = self.continuous, self.sample_time
        decay = np.exp(-c.normalization.delta_0 * T)
        n_d = decay * state.n_d + (1 - decay) / c.normalization.delta_0 * driven  # (16), exact for the held input
        data = SampleData(T, z, phi, c.normalization.m_s_squared(phi, (state.n_d + n_d) / 2))
        moved = self.law.sampled_step(state.theta_hat, state.memory, data, c.estimate_set)
        return Learnt(kept(self.frozen, state.theta_hat, moved.theta_hat), kept(self.frozen, state.memory, moved.memory), n_d)

    def freezing(self, frozen: Value) -> Self:
        return replace(self, frozen=frozen)

    def swapped(self, state: Any, following: Any, Xi_mid: Value) -> Value:
        """The state of the swapping term at the end of the sample; it exists only with an auxiliary input."""
        if self.filter is None:
            return state.swapping
        return self.model.end(state.swapping, Xi_mid @ (following.theta_hat - state.theta_hat) / self.sample_time)

    def filtered(self, state: Any, following: Any, before: Sample, now: Sample) -> Value:
        """The state of Q(s) at the end of the sample; ``following`` contains the rest of the new state."""
        if self.filter is None:
            return state.filter
        argument = self.continuous.auxiliary_input_argument
        return self.filter.end(state.filter, argument(state, before.x), argument(following, now.x))
