"""How closely L1-AC follows its own reference system: the non-adaptive closed loop with the filter and theta known.

x_ref' = A_m x_ref + b (theta'x_ref + u_ref), u_ref = C(s)[-theta'x_ref + k_0 r], x_ref(0) = x(0), C at rest.

With theta_tilde = theta_hat - theta, x_tilde = x - x_hat and G = W_b (1 - C): (1) and (5) give x - x_ref = G theta'(x - x_ref)
- C W_b[theta_tilde'x], and (1) and (8) give x_tilde = -W_b[theta_tilde'x], from zero. So

    x - x_ref = (I - G theta')^-1 C [x_tilde],   |x - x_ref| <= ||C||_1/(1 - ||G||_1 theta_max) nu_0/sqrt(Gamma),

where ||G||_1 theta_max < 1: the condition of Theorem 1 (ii).

Source: Hovakimyan and Cao, L1 Adaptive Control Theory (2010), section 2.1, with |theta_tilde(0)|, which is what V(0) holds, where
they write its largest value over the known set.
"""

from __future__ import annotations

import math

import numpy as np

from barbalat.certificates.bounds.theorem_1 import FilterCondition, filtered_model
from barbalat.linear.enclosure import OUTWARD_FACTOR
from barbalat.linear.l1_norms import l1_norm
from barbalat.linear.systems import StateSpace
from barbalat.problem.state_feedback import Known
from barbalat.validate import Array


def filter_norm(C: StateSpace) -> float:
    """An upper bound of ||C||_1."""
    return l1_norm(C).upper


def reference_error_bound(level: float, condition: FilterCondition, C: StateSpace) -> float:
    """gamma_1/sqrt(Gamma), of every component of x - x_ref at all times; ``level`` is nu_0/sqrt(Gamma) of x_tilde.

    Infinite where the condition does not hold.
    """
    if not condition.holds:
        return math.inf
    return filter_norm(C) * level / (1 - condition.value_upper) * OUTWARD_FACTOR**3


def exact_gain(known: Known, C: StateSpace, theta: Array) -> float:
    """||(I - G theta')^-1 C||_1, rounded up: for this theta alone, without the small-gain theorem.

    ValueError where it is unstable. A_m + b theta' is formed in floating point: the bound is of the rounded matrices.
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
