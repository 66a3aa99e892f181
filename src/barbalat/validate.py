"""Checks of what a user gives: each failure is one sentence that names the field, the value and what would be right."""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np

Array: TypeAlias = Any
"""A float NumPy array; its shape stands beside each name. Constructors take whatever NumPy can turn into one, hence Any."""


class InputError(ValueError):
    """Input that can't be used; the message is one sentence for the user."""


def show(value: Any) -> str:
    """A value as it appears in a message: short, on one line."""
    text = " ".join(np.array2string(value, separator=", ").split()) if isinstance(value, np.ndarray) else repr(value)
    return text if len(text) <= 100 else text[:97] + "..."


def number(field: str, value: Any) -> float:
    """A finite real number."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise InputError(f"{field} must be a number, got {show(value)}")
    try:
        result = float(value)
    except OverflowError:
        result = math.inf
    if not math.isfinite(result):
        raise InputError(f"{field} must be finite, got {show(value)}")
    return result


def positive(field: str, value: Any) -> float:
    """A finite number above zero."""
    result = number(field, value)
    if result <= 0:
        raise InputError(f"{field} must be positive, got {show(value)}")
    return result


def not_negative(field: str, value: Any) -> float:
    """A finite number, zero or above."""
    result = number(field, value)
    if result < 0:
        raise InputError(f"{field} must not be negative, got {show(value)}")
    return result


def array(field: str, value: Any, shape: tuple[int | None, ...]) -> Array:
    """A read-only float array of finite numbers; ``None`` in ``shape`` stands for any positive size."""
    try:
        given = np.asarray(value)
        result = np.array(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{field} must be an array of numbers, got {show(value)}") from None
    if given.dtype.kind not in "iuf":
        raise InputError(f"{field} must be an array of real numbers, got {show(value)}")
    fits = result.ndim == len(shape) and all(s == k or (s is None and k > 0) for s, k in zip(shape, result.shape, strict=True))
    if not fits:
        wanted = " x ".join("n" if s is None else str(s) for s in shape)
        raise InputError(
            f"{field} must have shape {wanted}, got {' x '.join(map(str, result.shape)) or 'a number'}: {show(value)}"
        )
    if not np.isfinite(result).all():
        raise InputError(f"{field} must be finite, got {show(value)}")
    result.flags.writeable = False
    return result


def vector(field: str, value: Any, size: int | None = None) -> Array:
    """A read-only vector (size,), of any size if none is given."""
    return array(field, value, (size,))


def square_matrix(field: str, value: Any, size: int | None = None) -> Array:
    """A read-only square matrix."""
    result = array(field, value, (size, size))
    if result.shape[0] != result.shape[1]:
        raise InputError(f"{field} must be square, got {result.shape[0]} x {result.shape[1]}: {show(value)}")
    return result


def instance(field: str, value: Any, kind: type | tuple[type, ...]) -> None:
    """Refuse an object of another kind, with the kinds that would be right."""
    if not isinstance(value, kind):
        names = " or ".join(k.__name__ for k in (kind if isinstance(kind, tuple) else (kind,)))
        raise InputError(f"{field} must be a {names}, got {show(value)}")


def hurwitz(field: str, A: Array) -> None:
    """Every eigenvalue has a negative real part."""
    if A.size == 0:
        return
    largest = float(np.linalg.eigvals(A).real.max())
    if largest >= 0:
        raise InputError(f"{field} must be Hurwitz, but its largest eigenvalue has real part {largest:.6g}: {show(A)}")


def controllable(fields: str, A: Array, b: Array) -> None:
    """Popov-Belevitch-Hautus test: [lambda I - A, b] has full rank at every eigenvalue lambda of A."""
    n = A.shape[0]
    tolerance = 100 * n * np.finfo(float).eps  # relative; 100: eigenvalues themselves carry a few roundings
    scale = max(float(np.linalg.norm(A, 2)), 1e-300)
    size = max(float(np.linalg.norm(b)), 1e-300)
    for eigenvalue in np.linalg.eigvals(A):
        pencil = np.column_stack([(eigenvalue * np.eye(n) - A) / scale, b / size])
        if np.linalg.svd(pencil, compute_uv=False)[-1] <= tolerance:
            raise InputError(
                f"{fields} must be controllable, but the mode at {eigenvalue:.6g} cannot be reached from b = {show(b)}"
            )
