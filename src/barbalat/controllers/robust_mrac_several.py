"""Robust and normalised MRAC for several inputs: the parametric model (13) with an equation for each input.

With C_0 (m, n) in place of c_0', W_m(s) = C_0 (sI - A_m)^-1 B is square. z = C_0 (x - xi) = phi'theta with phi (p m, m), and
epsilon, which drives the law, is a vector. For C_0 = B'P, W_m is strictly positive real. See docs/equations.md, section 12.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat import validate
from barbalat.adaptation.guarantee import ModifiedLaw
from barbalat.adaptation.law import AdaptiveLaw, Estimation, Normalization
from barbalat.controllers.parametric_model import OnParametricModel, State
from barbalat.controllers.settings import initial_estimate
from barbalat.controllers.windup import applied
from barbalat.linear.conditions import require_hurwitz
from barbalat.problem.known_set import EstimateSet
from barbalat.problem.regressors import MatchedTerm
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Value
from barbalat.validate import Array, InputError


@dataclass(frozen=True, eq=False)
class AuxiliaryFilter:
    """Q(s) = W_m(s)^-1/(tau s + 1): q' = A q + B v, Q[v] = C q + D v.

    C_0 q is v filtered by the lag. The input is chosen so that C_0 q' = (v - C_0 q)/tau.
    """

    A: Array
    B: Array
    C: Array
    D: Array

    @classmethod
    def of(cls, C_0: Array, A_m: Array, B: Array, tau: float) -> AuxiliaryFilter:
        inverse = np.linalg.inv(C_0 @ B)
        C = -inverse @ (C_0 / tau + C_0 @ A_m)
        return cls(A_m + B @ C, B @ inverse / tau, C, inverse / tau)

    def derivative(self, q: Value, v: Value) -> Value:
        return self.A @ q + self.B @ v

    def output(self, q: Value, v: Value) -> Value:
        return self.C @ q + self.D @ v


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations(OnParametricModel):
    """The equations for several inputs, which are those for one input with a vector epsilon."""

    A_m: Array
    B: Array  # (n, m)
    k_0: Array
    matched: MatchedTerm
    C_0: Array  # (m, n)
    Q: AuxiliaryFilter | None
    law: AdaptiveLaw
    normalization: Normalization
    theta_hat0: Array
    x0: Array
    estimate_set: EstimateSet | None
    limits: Array | None = None  # limits of the inputs, if the parametric model receives sat(u)
    enters: Array | None = None  # (n, q), the matrix by which the commands enter the state directly

    def estimation(self, state: State, x: Value) -> Estimation:
        z = self.C_0 @ (x - state.xi)  # (13)
        phi = (self.C_0 @ state.Xi).T  # (13)
        m_s_squared = self.normalization.m_s_squared(phi.reshape(-1), state.n_d)  # (16) with |phi|_F
        return Estimation(phi, m_s_squared, (z - phi.T @ state.theta_hat) / m_s_squared)

    def auxiliary_input_argument(self, state: State, x: Value) -> Value:
        """The signal that -Q(s) filters to become the auxiliary input."""
        estimation = self.estimation(state, x)
        return estimation.epsilon * estimation.m_s_squared + self.C_0 @ state.swapping

    def control(self, state: State, x: Value, x_m: Value, r: Value) -> Value:
        u = -self.matched.phi(x).T @ state.theta_hat + np.dot(self.k_0, r)
        if self.Q is None:
            return u
        return u - self.Q.output(state.filter, self.auxiliary_input_argument(state, x))  # (14)

    def derivative(self, state: State, x: Value, x_m: Value, r: Value, u: Value) -> State:
        u = applied(u, self.limits)
        rates = self.law.rates(state.theta_hat, state.memory, self.estimation(state, x), self.estimate_set)  # (15)
        swapping_dot, filter_dot = self.auxiliary_rates(state, x, rates.theta_hat)
        xi_dot = self.A_m @ state.xi + self.B @ u
        return State(
            theta_hat=rates.theta_hat,
            memory=rates.memory,
            xi=xi_dot if self.enters is None else xi_dot + self.enters @ r,
            Xi=self.A_m @ state.Xi + self.B @ self.matched.phi(x).T,
            n_d=self.normalization.driven(state.n_d, u @ u),
            swapping=swapping_dot,
            filter=filter_dot,
        )


def equations(
    known: Known,
    *,
    c_0: Array | None,
    tau: float | None,
    law: AdaptiveLaw,
    normalization: Normalization,
    theta_hat0: Array | None,
    estimate_set: EstimateSet | None,
    limits: Array | None,
) -> Equations:
    """Raise InputError if W_m does not have relative degree one for each input, or has a zero in Re s >= 0."""
    if isinstance(law, ModifiedLaw) and law.leakage is not None and law.leakage.one_input_only:
        raise InputError(f"{type(law.leakage).__name__} supports only plants with one input, got {known.inputs}; give a sigma")
    C_0 = known.b.T @ known.P if c_0 is None else validate.array("c_0", c_0, (known.inputs, known.n))
    require_minimum_phase(C_0, known)
    law.initial(known.parameters)  # rejects settings of a different size
    return Equations(
        A_m=known.A_m,
        B=known.b,
        k_0=np.asarray(known.k_0),
        matched=known.matched,
        C_0=C_0,
        Q=None if tau is None else AuxiliaryFilter.of(C_0, known.A_m, known.b, tau),
        law=law,
        normalization=normalization,
        theta_hat0=initial_estimate(theta_hat0, estimate_set, known),
        x0=known.x0,
        estimate_set=estimate_set,
        limits=limits,
        enters=known.enters,
    )


def require_minimum_phase(C_0: Array, known: Known) -> None:
    """Raise InputError unless C_0 B is regular and the zeros of W_m, which are the modes with C_0 x = 0, decay."""
    CB = C_0 @ known.b
    if np.linalg.matrix_rank(CB) < known.inputs:
        raise InputError(f"c_0 must have a row for each input and make c_0 b nonsingular, but c_0 b = {validate.show(CB)}")
    inside = np.linalg.svd(C_0)[2][known.inputs :].T  # an orthonormal basis of C_0 x = 0
    if inside.shape[1]:
        kept = np.eye(known.n) - known.b @ np.linalg.solve(CB, C_0)
        require_hurwitz("the zeros of c_0 (sI - A_m)^-1 b", inside.T @ kept @ known.A_m @ inside)
