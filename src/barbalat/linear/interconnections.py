"""Linear systems in series and in feedback."""

from __future__ import annotations

import numpy as np

from barbalat.linear.systems import StateSpace
from barbalat.validate import InputError


def series(first: StateSpace, second: StateSpace) -> StateSpace:
    """Two systems in a row: second(s) first(s)."""
    n, m = first.order, second.order
    A = np.block([[first.A, np.zeros((n, m))], [np.outer(second.B, first.C), second.A]])
    B = np.concatenate([first.B, second.B * first.D])
    C = np.concatenate([second.D * first.C, second.C])
    return StateSpace(A, B, C, second.D * first.D)


def sensitivity(loop: StateSpace) -> StateSpace:
    """S = 1/(1 + L); InputError where 1 + L(infinity) = 0."""
    return_difference = 1 + loop.D
    if abs(return_difference) < 1e-12:
        raise InputError(f"the closed loop is not well posed: 1 + L(infinity) = {return_difference:.3g}")
    closed = loop.A - np.outer(loop.B, loop.C) / return_difference
    return StateSpace(closed, loop.B / return_difference, -loop.C / return_difference, 1 / return_difference)


def complementary_sensitivity(loop: StateSpace) -> StateSpace:
    """T = 1 - S = L/(1 + L)."""
    S = sensitivity(loop)
    return StateSpace(S.A, S.B, -S.C, 1 - S.D)
