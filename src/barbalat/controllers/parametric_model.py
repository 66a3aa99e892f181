"""W_m(s) of the parametric model (13), the filter Q(s) of the auxiliary input that inverts it, and the filters around them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from barbalat import validate
from barbalat.linear.systems import StateSpace, TransferFunction, transfer_function
from barbalat.problem.state_feedback import Known
from barbalat.roles import Role
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
