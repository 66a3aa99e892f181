"""The matching equation of direct MRAC, and the conditions on plant, model and filters for its solution."""

from __future__ import annotations

import numpy as np

from barbalat import validate
from barbalat.linear.systems import StateSpace, TransferFunction
from barbalat.validate import Array, InputError

SLOWEST_POLE_SHARE = 1e-9
"""Smallest ratio of a filter pole to the model's fastest pole. A slower pole cannot be distinguished from an integrator."""


def filter_polynomial(n: int, W_m: TransferFunction, filter_poles: Array | None) -> Array:
    """Lambda = Lambda_0 Z_m, monic of degree n - 1, highest power first.

    The roots of Lambda_0 are ``filter_poles``; by default all are at -a, where a is the largest modulus of the model's poles.
    """
    zeros = W_m.zeros
    free = n - 1 - len(zeros)
    if free < 0 or len(W_m.poles) > n:
        raise InputError(f"order must be at least that of the reference model and its zeros plus one, got {n}")
    if filter_poles is None:
        filter_poles = np.full(free, -np.abs(W_m.poles).max())
    if len(filter_poles) != free:
        wanted = f"{validate.counted(free, 'entry')} (order - 1 minus the number of the model's zeros)"
        raise InputError(f"filter_poles must have {wanted}, got {len(filter_poles)}")
    if not (np.asarray(filter_poles).real < -SLOWEST_POLE_SHARE * np.abs(W_m.poles).max()).all():
        raise InputError(
            "filter_poles must have negative real parts (Lambda must be Hurwitz) with a magnitude of at least "
            f"{SLOWEST_POLE_SHARE:g} times that of the model's fastest pole, got {validate.show(filter_poles)}"
        )
    return np.atleast_1d(np.real(np.poly(np.concatenate([zeros, filter_poles]))))


def input_filter(Lambda: Array) -> StateSpace:
    """alpha(s)/Lambda(s) with alpha = [s^(n-2), ..., 1]'; the state itself is the output, and C is not used."""
    order = len(Lambda) - 1
    A = np.vstack([-Lambda[1:], np.eye(order)[:-1]]) if order else np.zeros((0, 0))
    return StateSpace(A, np.eye(order)[:, 0] if order else np.zeros(0), np.zeros(order), 0.0)


def refuse_contradiction(plant: TransferFunction, order: int, relative_degree: int, sign: int) -> None:
    """Raise InputError if a plant of at most the assumed order is not in the assumed class; the extra dynamics of a higher-order
    plant count as unmodelled."""
    if len(plant.poles) > order:
        return
    if plant.relative_degree != relative_degree:
        raise InputError(
            f"relative_degree is {relative_degree}, but the plant, whose order {len(plant.poles)} is within order = {order}, "
            f"has {plant.relative_degree}"
        )
    if not plant.is_minimum_phase:
        raise InputError(f"the plant must be minimum phase, but it has a zero with real part {plant.zeros.real.max():.6g}")
    if np.sign(plant.num[0]) != sign:
        raise InputError(f"sign is {sign}, but the plant's high-frequency gain is {plant.num[0]:.6g}")


def matching_parameters(plant: TransferFunction, W_m: TransferFunction, Lambda: Array) -> Array:
    """Return theta* = (theta_1, theta_2, theta_3, c_0), (2 n,), for which the closed loop equals W_m exactly.

    Solves (Lambda - theta_1'alpha) R_p - k_p Z_p (theta_2'alpha + theta_3 Lambda) = Z_p Lambda_0 R_m, c_0 = k_m/k_p, monic Z_p
    and Z_m, with the time unit in which the model's fastest pole is 1. If theta* is not unique (a plant of lower order, or one
    with a pole-zero cancellation), the smallest solution in that unit is taken. Raises InputError for a plant whose order exceeds
    the order of Lambda plus one, or whose relative degree differs from the model's. Source: Ioannou and Sun, section 6.4.
    """
    n = len(Lambda)
    missing = n - len(plant.poles)
    if missing < 0 or plant.relative_degree != W_m.relative_degree:
        raise InputError(
            f"matching needs a plant of order {n} or below and relative degree {W_m.relative_degree}, "
            f"got {len(plant.poles)} and {plant.relative_degree}"
        )
    k_p, k_m, unit = plant.num[0], W_m.num[0], float(np.abs(W_m.poles).max())
    cancelling = np.poly(np.full(missing, -1.0))
    Z_p, R_p = (np.polymul(_scaled(side, unit), cancelling) for side in (plant.num / k_p, plant.den))
    Lambda, Z_m, R_m = (_scaled(side, unit) for side in (Lambda, W_m.num / k_m, W_m.den))
    Lambda_0, _ = np.polydiv(Lambda, Z_m)
    alpha = [np.eye(n - 1)[i] for i in range(n - 1)]  # s^(n-2), ..., 1
    columns = [-np.polymul(a, R_p) for a in alpha] + [-np.polymul(Z_p, a) for a in alpha] + [-np.polymul(Z_p, Lambda)]
    right = np.polysub(np.polymul(np.polymul(Z_p, Lambda_0), R_m), np.polymul(Lambda, R_p))
    rows = 2 * n - 1  # the leading coefficients, of s^(2n-1), are one on both sides
    matrix = np.column_stack([_padded(column, rows) for column in columns])
    theta = np.linalg.lstsq(matrix, _padded(right, rows), rcond=1e-12)[0]
    theta[n - 1 :] *= unit**plant.relative_degree / k_p
    powers = unit ** np.arange(1.0, n)
    return np.concatenate([theta[: n - 1] * powers, theta[n - 1 : 2 * n - 2] * powers, theta[2 * n - 2 :], [k_m / k_p]])


def _scaled(polynomial: Array, unit: float) -> Array:
    """A monic polynomial in s, rewritten in s/unit and made monic."""
    return polynomial / unit ** np.arange(float(len(polynomial)))


def _padded(polynomial: Array, size: int) -> Array:
    """The lowest ``size`` coefficients, highest power first."""
    polynomial = np.concatenate([np.zeros(max(size - len(polynomial), 0)), polynomial])
    return polynomial[len(polynomial) - size :]


def is_strictly_positive_real(W: TransferFunction) -> bool:
    """Whether Re W(j w) > 0 for all w and w^2 Re W(j w) is positive in the limit, for a stable W of relative degree 1.

    Re W has the sign of the even polynomial Re(num(j w) den(-j w)), which must have no root w^2 >= 0.
    """
    if W.relative_degree != 1 or not W.is_stable:
        return False

    def at_jw(p: Array) -> Array:
        powers = np.arange(len(p))[::-1]
        return np.asarray(p * (1j**powers))

    product = np.polymul(at_jw(W.num), np.conj(at_jw(W.den)))  # a polynomial in w
    even = np.real(np.asarray(product)[::-1][::2])[::-1]  # in w^2, highest power first
    roots = np.roots(even)
    touching = (np.abs(roots.imag) <= 1e-12 * (1 + np.abs(roots))) & (roots.real >= -1e-12 * (1 + np.abs(roots)))
    return bool(even[0] > 0 and even[-1] > 0 and not touching.any())
