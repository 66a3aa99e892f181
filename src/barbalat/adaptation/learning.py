"""Composite learning: the Lyapunov laws of MRAC and L1-AC with a memory of past data in addition to the present error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from barbalat import validate
from barbalat.adaptation.implicit import forgotten
from barbalat.protocols import Value
from barbalat.roles import Role
from barbalat.settings import Settings
from barbalat.validate import Array


class Memory(NamedTuple):
    """The states of the memory."""

    zeta: Value  # scalar, the filtered part of b^+ x that the known dynamics explain
    phi: Value  # (p,) phi(x)/(tau_f s + 1)
    R: Value  # (p, p) int weight phi phi'/m^2
    Q: Value  # (p,) int weight z phi/m^2


@dataclass(frozen=True, eq=False)
class CompositeLearning(Settings):
    """theta_hat' = proj(Gamma (x e'P b + gamma_c (Q - R theta_hat))): past data pull the estimates towards theta.

    gamma_c        weight of the memory relative to the tracking error, > 0
    time_constant  tau_f of the regressor's filter [s], > 0
    forgetting     beta of the memory [1/s], >= 0; by default 0, so nothing is forgotten
    capacity       capacity of the memory [s], > 0: new data have the weight 1 - trace(R)/capacity. Unlimited by default; without
                   forgetting, R then grows like t, and so does the rate Gamma gamma_c R of the law, which the step must resolve

    With b^+ = b'/(b'b), x' = A_m x + b (theta'x + u) gives z = theta'phi for z = (b^+ x - zeta)/tau_f, zeta' = z + b^+ A_m x + u,
    zeta(0) = b^+ x(0) and phi' = (phi(x) - phi)/tau_f, phi(0) = 0. No derivative of x is needed. With m^2 = 1 + phi'phi and the
    weight a: R' = a phi phi'/m^2 - beta R, Q' = a z phi/m^2 - beta Q, so Q = R theta, and V = e'P e + theta_tilde'Gamma^-1
    theta_tilde has V' = -|e|^2 - 2 gamma_c theta_tilde'R theta_tilde. Without forgetting lambda_min(R) never falls: once the data
    have excited all directions for a finite time, e and theta_tilde converge exponentially, without persistent excitation.
    Disturbances of the plant are remembered as well: neither a dead zone nor an epsilon-modification removes the memory's bias.

    Source: Slotine and Li (1989), composite adaptation; Chowdhary and Johnson (2010), concurrent learning (CDC); the
    memory in this form: Cho, Shin, Kim and Kim (2018), IEEE TAC 63(3); Pan and Yu (2016), IEEE TAC 61(6).
    """

    gamma_c: float
    _: KW_ONLY
    time_constant: float
    forgetting: float = 0.0
    capacity: float | None = None

    roles: ClassVar[Mapping[str, Role]] = {
        "zeta": Role.filter("filtered motion of composite learning"),
        "phi": Role.filter("filtered regressor of composite learning"),
        "R": Role.memory("information matrix in the law's memory"),
        "Q": Role.memory("the rest of the law's memory"),
    }

    def __post_init__(self) -> None:
        validate.freeze(self, gamma_c=validate.positive("learning.gamma_c", self.gamma_c))
        validate.freeze(self, time_constant=validate.positive("learning.time_constant", self.time_constant))
        validate.freeze(self, forgetting=validate.not_negative("learning.forgetting", self.forgetting))
        if self.capacity is not None:
            validate.freeze(self, capacity=validate.positive("learning.capacity", self.capacity))

    def initial(self, b: Array, x0: Array, parameters: int) -> Memory:
        p = parameters
        return Memory(_left_inverse(b) @ x0, np.zeros(p), np.zeros((p, p)), np.zeros(p))

    def rates(self, memory: Memory, A_m: Array, b: Array, x: Value, regressor: Value, u: Value) -> Memory:
        zeta, phi, R, Q = memory
        b_plus = _left_inverse(b)
        z = (b_plus @ x - zeta) / self.time_constant
        share = 1 / (1 + phi @ phi)
        if self.capacity is not None:
            share = share * np.maximum(1 - sum(R[i, i] for i in range(phi.shape[0])) / self.capacity, 0.0)
        return Memory(
            zeta=z + b_plus @ (A_m @ x) + u,
            phi=(regressor - phi) / self.time_constant,
            R=share * np.outer(phi, phi) - self.forgetting * R,
            Q=share * z * phi - self.forgetting * Q,
        )

    def advance(self, memory: Memory, T: float, A_m: Array, b: Array, x: Value, regressor: Value, u: Value) -> Memory:
        """The memory one sample of length T [s] later; ``x`` and ``regressor`` are taken at its middle. Q = R theta is kept
        exactly.

        The filters use the midpoint rule, forgetting is exact, and the capacity is never exceeded.
        """
        zeta, phi, R, Q = memory
        b_plus, half = _left_inverse(b), T / 2 / self.time_constant
        zeta_mid = (zeta + half * (b_plus @ x) + T / 2 * (b_plus @ (A_m @ x) + u)) / (1 + half)
        phi_mid = (phi + half * regressor) / (1 + half)
        z = (b_plus @ x - zeta_mid) / self.time_constant
        kept, gathered = forgotten(self.forgetting, T)
        share = gathered / (1 + phi_mid @ phi_mid)
        if self.capacity is not None:
            used = kept * sum(R[i, i] for i in range(phi.shape[0])) / self.capacity
            share = share * np.maximum(1 - used, 0.0) / (1 + share * (phi_mid @ phi_mid) / self.capacity)
        return Memory(
            zeta=2 * zeta_mid - zeta,
            phi=2 * phi_mid - phi,
            R=kept * R + share * np.outer(phi_mid, phi_mid),
            Q=kept * Q + share * z * phi_mid,
        )

    def pull(self, memory: Memory, theta_hat: Value) -> Value:
        """gamma_c (Q - R theta_hat)."""
        return self.gamma_c * (memory.Q - memory.R @ theta_hat)


def _left_inverse(b: Value) -> Value:
    return b / (b @ b)
