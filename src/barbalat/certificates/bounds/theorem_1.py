"""The numbers of Theorem 1: P, nu_0, the bounds (9) and (10), the condition on C(s), and the kappa at which it fails.

Every bound is rounded outward. The derivations are in docs/proofs.md and docs/theorem-1.md.

``reference_error_bound`` bounds the distance of L1-AC from its reference system, the loop with the filter and known theta.

x_ref' = A_m x_ref + b (theta'x_ref + u_ref), u_ref = C(s)[-theta'x_ref + k_0 r], x_ref(0) = x(0), C at rest.

With theta_tilde = theta_hat - theta, x_tilde = x - x_hat and G = W_b (1 - C), (1) and (5) give x - x_ref = G theta'(x - x_ref)
- C W_b[theta_tilde'x], and (1) and (8) give x_tilde = -W_b[theta_tilde'x], from zero initial conditions. So

    x - x_ref = (I - G theta')^-1 C [x_tilde],   |x - x_ref| <= ||C||_1/(1 - ||G||_1 theta_max) nu_0/sqrt(Gamma),

if ||G||_1 theta_max < 1, which is the condition of Theorem 1 (ii).

Source: Hovakimyan and Cao, L1 Adaptive Control Theory (2010), section 2.1, with |theta_tilde(0)|, as in V(0), in place of the
largest value over the known set.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from barbalat.certificates.bounds.model import ModelBounds, require_lyapunov
from barbalat.linear.conditions import smallest_eigenvalue
from barbalat.linear.enclosure import OUTWARD_FACTOR, Enclosure
from barbalat.linear.l1_norms import l1_norm
from barbalat.linear.largest import largest_of_size
from barbalat.linear.systems import StateSpace, TransferFunction, input_filter
from barbalat.problem.state_feedback import Known
from barbalat.validate import Array


@dataclass(frozen=True)
class FilterCondition:
    """||W_b (1 - C)||_1 theta_max < 1, and the enclosure of the norm."""

    norm: Enclosure
    value_upper: float
    holds: bool


def filtered_model(known: Known, C: StateSpace) -> tuple[Array, Array, Array, Array]:
    """W_b(s)(1 - C(s)), from one input to n outputs, as (A, B, C, D)."""
    n, m = known.n, C.order
    A = np.block([[known.A_m, -np.outer(known.b, C.C)], [np.zeros((m, n)), C.A]])
    B = np.concatenate([known.b * (1 - C.D), C.B])[:, None]
    return A, B, np.eye(n, n + m), np.zeros((n, 1))


def filter_condition(known: Known, C: StateSpace, theta_max: float) -> FilterCondition:
    """The condition of Theorem 1 (ii)."""
    return small_gain(l1_norm(*filtered_model(known, C)).of_rounded_system(), theta_max)


def small_gain(norm: Enclosure, theta_max: float) -> FilterCondition:
    """norm theta_max < 1, with the product rounded up."""
    value = norm.upper * theta_max * OUTWARD_FACTOR
    return FilterCondition(norm, value, value < 1)


def derivative_norm(known: Known) -> Enclosure:
    """||s W_b(s)||_1, where s W_b = A_m (sI - A_m)^-1 b + b is proper and D = b contributes to the norm."""
    return l1_norm(known.A_m, known.b[:, None], known.A_m, known.b[:, None])


def kappa_max(norm: Enclosure, theta_max: float) -> float:
    """1/(theta_max ||s W_b||_1), rounded down."""
    return math.inf if theta_max == 0 else 1 / (theta_max * norm.upper * OUTWARD_FACTOR)


def kappa_admissible(known: Known, theta_max: float, relative: float = 1e-6) -> float:
    """The largest kappa found for which the condition provably holds for C = 1/(kappa s + 1), within ``relative``.

    Found by secants between kappa_max, where the condition holds, and a kappa for which it provably fails; infinite if it never
    fails.
    """

    def size(kappa: float) -> float:
        return filter_condition(known, input_filter(kappa).realise(), theta_max).value_upper

    # 1 - C -> 1 for kappa -> infinity: the norm tends to the norm of W_b
    if theta_max == 0 or l1_norm(known.A_m, known.b[:, None], np.eye(known.n), np.zeros((known.n, 1))).upper * theta_max < 1:
        return math.inf
    start = kappa_max(derivative_norm(known), theta_max) * (1 - 1e-9)  # kappa ||s W_b|| theta_max < 1 there, as ||C||_1 = 1
    return largest_of_size(size, start, within=relative)


def initial_parameter_error(theta_hat0: Array, theta: Array) -> float:
    """||theta_hat(0) - theta||_2, rounded up."""
    return float(np.linalg.norm(theta_hat0 - theta)) * OUTWARD_FACTOR


def nu_0(parameter_error: float, known: Known) -> float:
    """||theta_tilde(0)||_2 / sqrt(lambda_min(P)), rounded up; the P that the controller uses is verified first."""
    require_lyapunov(known)
    return parameter_error / math.sqrt(smallest_eigenvalue(known.P)) * OUTWARD_FACTOR


def mrac_bound(nu: float, gamma: float) -> float:
    """The bound (9) on the tracking error of MRAC, rounded up."""
    return nu / math.sqrt(gamma) * OUTWARD_FACTOR


def l1_bound(nu: float, gamma: float, condition: FilterCondition, theta_max: float, k_0: float, model: ModelBounds) -> float:
    """(10), for any C(s): [nu_0/sqrt(Gamma) + N (theta_max |x_m| + |k_0| |r|)] / (1 - N theta_max), N = ||W_b (1 - C)||_1.

    The bound is infinite if the condition does not hold.
    """
    if not condition.holds:
        return math.inf
    bias = condition.norm.upper * (theta_max * model.x_m + abs(k_0) * model.r)
    return (nu / math.sqrt(gamma) + bias) / (1 - condition.value_upper) * OUTWARD_FACTOR**3


def first_order_constants(
    nu: float, kappa: float, norm: Enclosure, theta_max: float, k_0: float, model: ModelBounds
) -> tuple[float, float] | None:
    """nu_1 and nu_2 of (10) for C = 1/(kappa s + 1); None if kappa is not below kappa_max."""
    remaining = 1 - kappa / kappa_max(norm, theta_max)
    if remaining <= 0:
        return None
    nu_1 = norm.upper * (theta_max * model.x_m + abs(k_0) * model.r) / remaining * OUTWARD_FACTOR**2
    return nu_1, nu / remaining * OUTWARD_FACTOR


def time_constant(C: TransferFunction | None) -> float | None:
    """kappa if C(s) = 1/(kappa s + 1), otherwise None; 0 for C = 1."""
    if C is None:
        return 0.0
    return 1 / float(C.den[1]) if len(C.den) == 2 and len(C.num) == 1 else None


def filter_norm(C: StateSpace) -> float:
    """An upper bound on ||C||_1."""
    return l1_norm(C).upper


def reference_error_bound(level: float, condition: FilterCondition, C: StateSpace) -> float:
    """gamma_1/sqrt(Gamma), a bound on every component of x - x_ref at all times; ``level`` is nu_0/sqrt(Gamma) for x_tilde.

    The bound is infinite if the condition does not hold.
    """
    if not condition.holds:
        return math.inf
    return filter_norm(C) * level / (1 - condition.value_upper) * OUTWARD_FACTOR**3


def exact_gain(known: Known, C: StateSpace, theta: Array) -> float:
    """||(I - G theta')^-1 C||_1, rounded up, for this theta only and without the small-gain theorem.

    Raises ValueError if the loop is unstable. A_m + b theta' is computed in floating point, so the bound holds for the rounded
    matrices.
    """
    n, order = known.n, C.order
    A, B, outputs, _ = filtered_model(known, C)
    behind = np.kron(np.eye(n), C.C.reshape(1, order))  # C acts on each component of x_tilde: w, (n,)
    feedback = theta[None]
    # x - x_ref = w + G theta'(x - x_ref)
    system = np.block(
        [
            [A + B @ feedback @ outputs, B @ feedback @ behind],
            [np.zeros((n * order, len(A))), np.kron(np.eye(n), C.A)],
        ]
    )
    inputs = np.vstack([np.zeros((len(A), n)), np.kron(np.eye(n), C.B.reshape(order, 1))])
    return l1_norm(system, inputs, np.hstack([outputs, behind]), C.D * np.eye(n)).upper
