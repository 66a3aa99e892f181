"""What the schemes on the parametric model (13) integrate."""

from __future__ import annotations

from typing import Any, NamedTuple

from barbalat.protocols import Value


class State(NamedTuple):
    """What the controller integrates."""

    theta_hat: Value  # (p,) estimate of theta, (p m,) with m inputs
    memory: Any  # of the law
    xi: Value  # (n,) the known part of x: xi' = A_m xi + b u, xi(0) = x(0); sat(u) with ``saturated_predictor``
    Xi: Value  # (n, p) W_b(s)[phi(x)'], where phi(x) = x in the paper
    n_d: Value  # scalar, dynamic normalising signal
    swapping: Value  # (n,) (sI - A_m)^-1 [Xi theta_hat']; (0,) without auxiliary input
    filter: Value  # (n,) state of Q(s); (0,) without auxiliary input
