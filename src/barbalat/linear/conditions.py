"""Conditions on matrices: Hurwitz and controllable (in balanced coordinates), and provably definite (in ball arithmetic)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from flint import arb, arb_mat

from barbalat.validate import Array, InputError, show


def balance(A: Array) -> tuple[Array, Array]:
    """(S^-1 A S, s) with S = diag(s) of powers of two, so nothing is rounded. After balancing, fast states do not dominate the
    norm."""
    from scipy.linalg import matrix_balance

    with np.errstate(invalid="ignore"):  # SciPy converts all scales to integers for a permutation that is not requested
        balanced, (scale, _) = matrix_balance(A, permute=False, separate=True)
    return np.asarray(balanced), np.asarray(scale)


def scaled(matrix: Array) -> tuple[Array, float]:
    """The matrix divided by a power of two near its largest entry, exactly, and that power. Norms and roots of the result do not
    overflow."""
    exponent = int(np.frexp(np.abs(matrix).max(initial=0.0))[1])
    with np.errstate(under="ignore"):
        return np.ldexp(matrix, -exponent), float(np.ldexp(1.0, exponent - 1))


def rounding(A: Array) -> float:
    """The size of a few rounding errors in an eigenvalue of the balanced A: a smaller eigenvalue cannot be distinguished from
    zero."""
    return 10 * len(A) * float(np.finfo(float).eps * np.linalg.norm(A, 2))


def require_hurwitz(field: str, A: Array) -> None:
    """Raise InputError unless the real part of every eigenvalue is negative by more than rounding."""
    largest, stable = largest_real_part(A)
    if not stable:
        raise InputError.of(field, f"must be Hurwitz, but its largest eigenvalue has real part {largest:.6g}: {show(A)}")


def largest_real_part(A: Array) -> tuple[float, bool]:
    """The largest real part of the eigenvalues, and whether it is negative by more than rounding."""
    return _largest_real_part(A.shape, np.asarray(A, dtype=float).tobytes())


@lru_cache(maxsize=256)  # cached: many plants that differ in their parameters have the same A_m
def _largest_real_part(shape: tuple[int, int], entries: bytes) -> tuple[float, bool]:
    unit, half = scaled(np.frombuffer(entries).reshape(shape))
    balanced, _ = balance(unit)
    largest = float(np.linalg.eigvals(balanced).real.max())
    return largest * half * 2, largest < -rounding(balanced)


def require_controllable(fields: str, A: Array, b: Array) -> None:
    """Raise InputError unless [lambda I - A, b] has full rank at every eigenvalue (Popov, Belevitch, Hautus); b is (n,) or
    (n, m)."""
    mode = unobservable_mode(A.T, b.reshape(len(b), -1).T)
    if mode is not None:
        shown = mode if mode.imag else mode.real
        raise InputError.of(fields, f"must be controllable, but b = {show(b)} does not reach the mode at {shown:.6g}")


def unobservable_mode(A: Array, C: Array, *, stable_too: bool = True) -> complex | None:
    """An eigenvalue of A whose mode is not observable in y = C x, beyond rounding; None if all modes are observable.

    stable_too  whether modes in Re s < 0 are included; without them this is a test of detectability
    """
    unit, half = scaled(A.T)
    balanced, scale = balance(unit)
    column = scaled(C.T)[0] / scale[:, None]
    size, norm = float(np.abs(column).max()), float(np.linalg.norm(balanced, 2)) or 1.0
    n = len(A)
    for eigenvalue in np.linalg.eigvals(balanced):
        if not stable_too and eigenvalue.real < -rounding(balanced):
            continue
        pencil = np.column_stack([(eigenvalue * np.eye(n) - balanced) / norm, column / size if size else column])
        # a factor of 100 because the eigenvalue also has a few rounding errors
        if np.linalg.svd(pencil, compute_uv=False)[-1] <= 100 * n * np.finfo(float).eps:
            return complex(eigenvalue * half * 2)
    return None


def smallest_eigenvalue(P: Array) -> float:
    """A guaranteed lower bound on lambda_min of the symmetric positive definite P, as tight as rounding allows.

    Raises InputError if P is not positive definite.
    """
    approximate = float(np.linalg.eigvalsh(P)[0])
    for slack in (1e-14, 1e-12, 1e-9, 1e-6, 1e-3):
        candidate = approximate - slack * float(np.linalg.norm(P, 2))
        if candidate > 0 and is_positive_definite(exact_matrix(P), candidate):
            return candidate
    raise InputError(f"P must be positive definite, but its smallest eigenvalue is {approximate:.3g}")


def is_positive_definite(matrix: arb_mat, shift: float = 0.0) -> bool:
    """Whether the symmetric matrix - shift I is provably positive definite: elimination in ball arithmetic has positive
    pivots."""
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
    """Whether P A_m + A_m'P is provably negative definite for the stored P, including its rounding errors."""
    exact_P, exact_A = exact_matrix(P), exact_matrix(A_m)
    return is_positive_definite(-(exact_P * exact_A + exact_A.transpose() * exact_P))


def exact_matrix(matrix: Array) -> arb_mat:
    """The matrix as balls, without rounding."""
    return arb_mat(matrix.tolist())
