"""Three laws from outside the package whose authors hand in a Lyapunov function; ``certify`` checks it and gives the bounds.

    barbalat certify paper --controllers examples/laws_with_lyapunov.py

Each V is e'P e plus a quadratic form of the estimates' errors, with P A_m + A_m'P = -I; V' is in the docstrings.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from barbalat import InputError
from barbalat.interfaces import EstimateSet, Known, Lyapunov, Role, Value


def require_one_input(name: str, known: Known) -> None:
    """InputError for a plant that these laws do not support."""
    if known.inputs > 1 or known.matched.gain_unknown:
        raise InputError(f"{name} supports only plants with one input of known gain")


class Tuned(NamedTuple):
    """The state of the high-order tuner."""

    theta_hat: Value  # (p,) the estimates
    ahead: Value  # (p,) what they follow


@dataclass(frozen=True, eq=False)
class HighOrderTunerEquations:
    """The tuner on one plant."""

    gamma: float
    beta: float
    known: Known

    roles: ClassVar[Mapping[str, Role]] = {"ahead": Role.estimates("xi", meaning="what the estimates follow")}

    def initial(self) -> Tuned:
        """Estimates of zero."""
        return Tuned(np.zeros(self.known.parameters), np.zeros(self.known.parameters))

    def control(self, state: Tuned, x: Value, x_m: Value, r: Value) -> Value:
        """u = k_0 r - theta_hat'phi."""
        return self.known.k_0 * r - state.theta_hat @ self.known.matched.phi(x)

    def derivative(self, state: Tuned, x: Value, x_m: Value, r: Value, u: Value) -> Tuned:
        """xi' = gamma phi e'P b, theta_hat' = beta (1 + mu phi'phi)(xi - theta_hat), mu = 4 gamma |P b|^2/beta."""
        phi, P_b = self.known.matched.phi(x), self.known.P @ self.known.b
        mu = 4 * self.gamma * (P_b @ P_b) / self.beta
        return Tuned(self.beta * (1 + mu * (phi @ phi)) * (state.ahead - state.theta_hat), self.gamma * phi * ((x - x_m) @ P_b))

    def limit(self, state: Tuned) -> Tuned:
        """No projection."""
        return state

    def lyapunov(self, state: Tuned, x: Value, x_m: Value, theta: Value) -> Lyapunov:
        """V = e'P e + |xi - theta|^2/gamma + |xi - theta_hat|^2/gamma falls by |e|^2/4 at least."""
        e, off, lag = x - x_m, state.ahead - theta, state.ahead - state.theta_hat
        return Lyapunov(V=e @ self.known.P @ e + (off @ off + lag @ lag) / self.gamma, W=e @ e / 4)


@dataclass(frozen=True)
class HighOrderTuner:
    """MRAC whose estimates follow those of the gradient law by a filter that is faster where phi is large.

    With lag = xi - theta_hat, V' = -|e|^2 + 4 e'P b phi'lag - (2 beta/gamma)(1 + mu phi'phi)|lag|^2, which mu makes negative.
    Source: Gaudio, Annaswamy, Bolender, Lavretsky and Gibson, A Class of High Order Tuners for Adaptive Systems (2021).

    gamma  adaptive gain > 0
    beta   rate of the filter [1/s], > 0
    """

    gamma: float = 10.0
    beta: float = 5.0
    name: str = "high-order tuner"

    def bind(self, known: Known) -> HighOrderTunerEquations:
        """The equations for what is known of a plant."""
        require_one_input(self.name, known)
        return HighOrderTunerEquations(self.gamma, self.beta, known)


class Filtered(NamedTuple):
    """The state of composite adaptation."""

    theta_hat: Value  # (p,) the estimates
    zeta: Value  # scalar: the part of b^+ x explained by the known dynamics, filtered
    phi_f: Value  # (p,) the filtered regressor


@dataclass(frozen=True, eq=False)
class CompositeEquations:
    """Composite adaptation on one plant."""

    gamma: float
    gamma_c: float
    tau: float
    known: Known

    roles: ClassVar[Mapping[str, Role]] = {"zeta": Role.filter("filtered motion"), "phi_f": Role.filter("filtered regressor")}

    @property
    def estimate_set(self) -> EstimateSet | None:
        """The set onto which the estimates are projected."""
        return self.known.estimate_set

    @property
    def b_plus(self) -> Value:
        """b'/(b'b)."""
        return self.known.b / (self.known.b @ self.known.b)

    def initial(self) -> Filtered:
        """Estimates in the known set; the filters start so that z = 0."""
        start = np.zeros(self.known.parameters)
        start = start if self.estimate_set is None else self.estimate_set.limit(start)
        return Filtered(start, self.b_plus @ self.known.x0, np.zeros(self.known.parameters))

    def z(self, state: Any, x: Value) -> Value:
        """theta'phi, filtered, from what is measured."""
        return (self.b_plus @ x - state.zeta) / self.tau

    def filters(self, state: Any, x: Value, u: Value) -> tuple[Value, Value]:
        """zeta' = z + b^+ A_m x + u and phi_f' = (phi - phi_f)/tau."""
        zeta_dot = self.z(state, x) + self.b_plus @ (self.known.A_m @ x) + u
        return zeta_dot, (self.known.matched.phi(x) - state.phi_f) / self.tau

    def control(self, state: Any, x: Value, x_m: Value, r: Value) -> Value:
        """u = k_0 r - theta_hat'phi."""
        return self.known.k_0 * r - state.theta_hat @ self.known.matched.phi(x)

    def derivative(self, state: Any, x: Value, x_m: Value, r: Value, u: Value) -> Any:
        """theta_hat' = proj(gamma (phi e'P b + gamma_c phi_f (z - theta_hat'phi_f)))."""
        zeta_dot, phi_f_dot = self.filters(state, x, u)
        P_b = self.known.P @ self.known.b
        predicted = self.z(state, x) - state.theta_hat @ state.phi_f
        rate = self.gamma * (self.known.matched.phi(x) * ((x - x_m) @ P_b) + self.gamma_c * state.phi_f * predicted)
        if self.estimate_set is not None:
            rate = self.estimate_set.project(rate, state.theta_hat)
        return Filtered(rate, zeta_dot, phi_f_dot)

    def limit(self, state: Any) -> Any:
        """The state with its estimates in the known set."""
        return state if self.estimate_set is None else state._replace(theta_hat=self.estimate_set.limit(state.theta_hat))

    def lyapunov(self, state: Any, x: Value, x_m: Value, theta: Value) -> Lyapunov:
        """z = theta'phi_f at all times, and V' = -|e|^2 - 2 gamma_c (theta_tilde'phi_f)^2."""
        e, off = x - x_m, state.theta_hat - theta
        V = e @ self.known.P @ e + off @ off / self.gamma
        return Lyapunov(V=V, W=e @ e + self.gamma_c * (off @ state.phi_f) ** 2, zero=self.z(state, x) - theta @ state.phi_f)


@dataclass(frozen=True)
class CompositeAdaptation:
    """MRAC that adapts by the tracking error and by the prediction error of a filtered model.

    Source: Slotine and Li, Composite adaptive control of robot manipulators, Automatica 25(4), 1989.

    gamma    adaptive gain > 0
    gamma_c  weight of the prediction error > 0
    tau      time constant of the filters [s], > 0
    """

    gamma: float = 10.0
    gamma_c: float = 1.0
    tau: float = 0.1
    name: str = "composite"

    def bind(self, known: Known) -> CompositeEquations:
        """The equations for what is known of a plant."""
        require_one_input(self.name, known)
        return CompositeEquations(self.gamma, self.gamma_c, self.tau, known)


class Recalling(NamedTuple):
    """The state of concurrent learning."""

    theta_hat: Value  # (p,) the estimates
    zeta: Value
    phi_f: Value  # (p,)
    R: Value  # (p, p) the recorded phi_f phi_f'
    Q: Value  # (p,) the recorded phi_f z


@dataclass(frozen=True, eq=False)
class ConcurrentEquations(CompositeEquations):
    """Concurrent learning on one plant."""

    forgetting: float

    roles: ClassVar[Mapping[str, Role]] = {
        **CompositeEquations.roles,
        "R": Role.memory("information that was recorded"),
        "Q": Role.memory("what was recorded beside R"),
    }

    def initial(self) -> Any:
        """An empty memory."""
        p = self.known.parameters
        return Recalling(*super().initial(), np.zeros((p, p)), np.zeros(p))

    def derivative(self, state: Any, x: Value, x_m: Value, r: Value, u: Value) -> Any:
        """theta_hat' = proj(gamma (phi e'P b + gamma_c (Q - R theta_hat))), R and Q from phi_f phi_f' and phi_f z."""
        zeta_dot, phi_f_dot = self.filters(state, x, u)
        share = 1 / (1 + state.phi_f @ state.phi_f)
        P_b = self.known.P @ self.known.b
        recalled = state.Q - state.R @ state.theta_hat
        rate = self.gamma * (self.known.matched.phi(x) * ((x - x_m) @ P_b) + self.gamma_c * recalled)
        if self.estimate_set is not None:
            rate = self.estimate_set.project(rate, state.theta_hat)
        R_dot = share * np.outer(state.phi_f, state.phi_f) - self.forgetting * state.R
        Q_dot = share * state.phi_f * self.z(state, x) - self.forgetting * state.Q
        return Recalling(rate, zeta_dot, phi_f_dot, R_dot, Q_dot)

    def lyapunov(self, state: Any, x: Value, x_m: Value, theta: Value) -> Lyapunov:
        """Q = R theta and R >= 0 at all times, and V' = -|e|^2 - 2 gamma_c theta_tilde'R theta_tilde."""
        e, off = x - x_m, state.theta_hat - theta
        predicted = self.z(state, x) - theta @ state.phi_f
        return Lyapunov(
            V=e @ self.known.P @ e + off @ off / self.gamma,
            W=e @ e + self.gamma_c * (off @ state.R @ off),
            zero=(predicted, state.Q - state.R @ theta),
            nonnegative=state.R,
        )


@dataclass(frozen=True)
class ConcurrentLearning:
    """MRAC that adapts by the tracking error and by recorded data, which need no persistent excitation.

    Source: Chowdhary and Johnson, Concurrent learning for convergence in adaptive control without persistency of excitation,
    CDC 2010, with an integral in place of the stack of recorded points.

    gamma       adaptive gain > 0
    gamma_c     weight of the recorded data > 0
    tau         time constant of the filters [s], > 0
    forgetting  rate at which data are forgotten [1/s]
    """

    gamma: float = 10.0
    gamma_c: float = 1.0
    tau: float = 0.1
    forgetting: float = 0.05
    name: str = "concurrent learning"

    def bind(self, known: Known) -> ConcurrentEquations:
        """The equations for what is known of a plant."""
        require_one_input(self.name, known)
        return ConcurrentEquations(self.gamma, self.gamma_c, self.tau, known, self.forgetting)


CONTROLLERS = [HighOrderTuner(), CompositeAdaptation(), ConcurrentLearning()]
