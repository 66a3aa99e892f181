"""Theorem 1 as numbers: P, nu_0, the bounds (9) and (10), the condition on C(s) and where it flips.

Everything that is called a bound is rounded outward. The derivations are in docs/theorem-1.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np

from barbalat.certify.l1 import Enclosure, float_above, l1_norm
from barbalat.known_set import KnownSet, ParameterBox
from barbalat.linear import StateSpace, TransferFunction, input_filter
from barbalat.problem import Known, Problem
from barbalat.protocols import BoundedSignal
from barbalat.validate import Array, InputError

if TYPE_CHECKING:
    from flint import arb_mat

OUTWARD = 1 + 1e-12
"""Room for the handful of roundings of plain arithmetic on numbers that are bounds already (each at most 1.2e-16)."""


@dataclass(frozen=True)
class ModelBounds:
    """Guaranteed bounds of the command and the reference model: sup |r|, sup max_i |x_m,i|, sup |x_m|_2."""

    r: float
    x_m: float
    x_m_euclidean: float


@dataclass(frozen=True)
class FilterCondition:
    """||W_b (1 - C)||_1 theta_max < 1, and the enclosure of the norm."""

    norm: Enclosure
    value_upper: float
    holds: bool


def smallest_eigenvalue(P: Array) -> float:
    """A guaranteed lower bound of lambda_min of the symmetric positive definite P, as tight as rounding allows.

    Raises InputError where P is not positive definite.
    """
    approximate = float(np.linalg.eigvalsh(P)[0])
    for slack in (1e-14, 1e-12, 1e-9, 1e-6, 1e-3):
        candidate = approximate - slack * float(np.linalg.norm(P, 2))
        if candidate > 0 and is_positive_definite(_exact(P), candidate):
            return candidate
    raise InputError(f"P must be positive definite, but its smallest eigenvalue is {approximate:.3g}")


def is_positive_definite(matrix: arb_mat, shift: float = 0.0) -> bool:
    """Whether the symmetric matrix - shift I is positive definite for certain: elimination in balls has positive pivots."""
    from flint import arb, arb_mat

    n = matrix.nrows()
    work = arb_mat(matrix)
    for i in range(n):
        work[i, i] -= arb(shift)
    for k in range(n):
        if not work[k, k] > 0:
            return False
        for i in range(k + 1, n):
            factor = work[i, k] / work[k, k]
            for j in range(k, n):
                work[i, j] -= factor * work[k, j]
    return True


def lyapunov_holds(P: Array, A_m: Array) -> bool:
    """Whether P A_m + A_m'P is negative definite for certain with P as it is stored, roundings and all."""
    exact_P, exact_A = _exact(P), _exact(A_m)
    return is_positive_definite(-(exact_P * exact_A + exact_A.transpose() * exact_P))


def _exact(matrix: Array) -> arb_mat:
    from flint import arb_mat

    return arb_mat(matrix.tolist())


def filtered_model(known: Known, C: StateSpace) -> tuple[Array, Array, Array, Array]:
    """W_b(s)(1 - C(s)), from one input to n outputs, as (A, B, C, D)."""
    n, m = known.n, C.order
    A = np.block([[known.A_m, -np.outer(known.b, C.C)], [np.zeros((m, n)), C.A]])
    B = np.concatenate([known.b * (1 - C.D), C.B])[:, None]
    return A, B, np.eye(n, n + m), np.zeros((n, 1))


def filter_condition(known: Known, C: StateSpace, theta_max: float) -> FilterCondition:
    """The condition under which Theorem 1 (ii) speaks."""
    return small_gain(l1_norm(*filtered_model(known, C)), theta_max)


def small_gain(norm: Enclosure, theta_max: float) -> FilterCondition:
    """norm theta_max < 1, with the product rounded up."""
    value = norm.upper * theta_max * OUTWARD
    return FilterCondition(norm, value, value < 1)


def derivative_norm(known: Known) -> Enclosure:
    """||s W_b(s)||_1; s W_b = A_m (sI - A_m)^-1 b + b is proper and its D = b counts."""
    return l1_norm(known.A_m, known.b[:, None], known.A_m, known.b[:, None])


def kappa_max(norm: Enclosure, theta_max: float) -> float:
    """1/(theta_max ||s W_b||_1), rounded down."""
    return math.inf if theta_max == 0 else 1 / (theta_max * norm.upper * OUTWARD)


def kappa_admissible(known: Known, theta_max: float, relative: float = 1e-6) -> float:
    """The largest kappa found for which the condition certainly holds for C = 1/(kappa s + 1), within ``relative``.

    Bisection between kappa_max, where it holds, and a kappa where it certainly fails; infinite if it never fails.
    """

    def holds(kappa: float) -> bool:
        return filter_condition(known, input_filter(kappa).realise(), theta_max).holds

    # 1 - C -> 1 for kappa -> infinity: the norm tends to that of W_b itself
    if theta_max == 0 or l1_norm(known.A_m, known.b[:, None], np.eye(known.n), np.zeros((known.n, 1))).upper * theta_max < 1:
        return math.inf
    good = kappa_max(derivative_norm(known), theta_max) * (1 - 1e-9)  # where kappa ||s W_b|| theta_max < 1, C's norm being 1
    bad = good
    while holds(bad):
        good, bad = bad, 2 * bad
    while bad / good > 1 + relative:
        middle = math.sqrt(good * bad)
        good, bad = (middle, bad) if holds(middle) else (good, middle)
    return good


def model_bounds(problem: Problem) -> ModelBounds:
    """Bounds from the signal's own and L1 norms, not from samples. InputError for a signal without a bound."""
    r = problem.reference
    if not isinstance(r, BoundedSignal):
        raise InputError(f"a certificate needs a reference with a bound, and {r!r} has none")
    each = state_bounds(problem)
    return ModelBounds(r.bound, max(each), math.hypot(*each) * OUTWARD)


def command_bounds(problem: Problem) -> Array:
    """(m,) bounds of sup |(k_0 r)_j|; InputError for a command without a bound."""
    pushed = np.zeros(problem.known.inputs)
    for command, column in zip(problem.commands, np.reshape(problem.known.k_0, (len(pushed), -1)).T, strict=True):
        if not isinstance(command, BoundedSignal):
            raise InputError(f"a certificate needs a reference with a bound, and {command!r} has none")
        pushed += np.abs(column) * command.bound
    return pushed


def state_bounds(problem: Problem) -> list[float]:
    """Guaranteed bounds of sup |x_m,i|, i = 1 ... n, for any inputs and commands: those of the inputs add up."""
    known, n, pushed = problem.known, problem.known.n, command_bounds(problem)
    columns = known.b.reshape(n, -1).T

    def forced(i: int) -> float:
        norms = [l1_norm(known.A_m, b[:, None], np.eye(n)[i : i + 1], np.zeros((1, 1))).upper for b in columns]
        return float(np.dot(pushed, norms))

    return [(forced(i) + free) * OUTWARD for i, free in enumerate(_free_response_bounds(known))]


def _free_response_bounds(known: Known) -> list[float]:
    """sup over t of |e_i'e^{A_m t} x0|: V = x'Px decreases, so it is at most sqrt(x0'P x0) sqrt((P^-1)_ii)."""
    if not known.x0.any():
        return [0.0] * known.n
    _require_lyapunov(known)
    P, x0 = _exact(known.P), _exact(known.x0[:, None])
    energy, inverse = (x0.transpose() * P * x0)[0, 0], P.inv()
    return [float_above((energy * inverse[i, i]).sqrt()) for i in range(known.n)]


def _require_lyapunov(known: Known) -> None:
    if not lyapunov_holds(known.P, known.A_m):
        raise InputError("P A_m + A_m'P could not be verified to be negative definite: A_m is too close to losing stability")


def theta_max_above(known_set: KnownSet) -> float:
    """The largest 1-norm in the known set, rounded up; a box's sum itself where it is a float."""
    if not isinstance(known_set, ParameterBox):
        return known_set.theta_max * OUTWARD
    largest = np.maximum(np.abs(known_set.lower), np.abs(known_set.upper))
    exact = sum((Fraction(value) for value in largest.tolist()), Fraction(0))
    nearest = float(exact)
    return nearest if Fraction(nearest) >= exact else math.nextafter(nearest, math.inf)


def ingredients(known: Known, known_set: KnownSet | None, model: ModelBounds) -> dict[str, Any]:
    """What (9) and (10) are computed from, by the certificate's keys: P, its lambda_min, theta_max, the bounds of r and x_m."""
    values: dict[str, Any] = {"P": known.P.tolist(), "lambda_min": smallest_eigenvalue(known.P)}
    if known_set is not None:
        values["theta_max"] = theta_max_above(known_set)
    return values | {"bounds": {"r": model.r, "x_m": model.x_m}}


def initial_parameter_error(theta_hat0: Array, theta: Array) -> float:
    """||theta_hat(0) - theta||_2, rounded up."""
    return float(np.linalg.norm(theta_hat0 - theta)) * OUTWARD


def largest_parameter_error(theta_hat0: Array, known_set: KnownSet) -> float:
    """The same for the worst theta in the known set."""
    return known_set.farthest(theta_hat0) * OUTWARD


def nu_0(parameter_error: float, known: Known) -> float:
    """||theta_tilde(0)||_2 / sqrt(lambda_min(P)), rounded up; the P that the controller uses is verified first."""
    _require_lyapunov(known)
    return parameter_error / math.sqrt(smallest_eigenvalue(known.P)) * OUTWARD


def mrac_bound(nu: float, gamma: float) -> float:
    """(9)."""
    return nu / math.sqrt(gamma) * OUTWARD


def l1_bound(nu: float, gamma: float, condition: FilterCondition, theta_max: float, k_0: float, model: ModelBounds) -> float:
    """(10), for any C(s): [nu_0/sqrt(Gamma) + N (theta_max |x_m| + |k_0| |r|)] / (1 - N theta_max), N = ||W_b (1 - C)||_1.

    Infinite where the condition does not hold.
    """
    if not condition.holds:
        return math.inf
    bias = condition.norm.upper * (theta_max * model.x_m + abs(k_0) * model.r)
    return (nu / math.sqrt(gamma) + bias) / (1 - condition.value_upper) * OUTWARD**3


def first_order_constants(
    nu: float, kappa: float, norm: Enclosure, theta_max: float, k_0: float, model: ModelBounds
) -> tuple[float, float] | None:
    """nu_1 and nu_2 of (10) for C = 1/(kappa s + 1); None where kappa is not below kappa_max."""
    remaining = 1 - kappa / kappa_max(norm, theta_max)
    if remaining <= 0:
        return None
    nu_1 = norm.upper * (theta_max * model.x_m + abs(k_0) * model.r) / remaining * OUTWARD**2
    return nu_1, nu / remaining * OUTWARD


def time_constant(C: TransferFunction | None) -> float | None:
    """kappa where C(s) = 1/(kappa s + 1), else None; 0 for C = 1."""
    if C is None:
        return 0.0
    return 1 / float(C.den[1]) if len(C.den) == 2 and len(C.num) == 1 else None
