"""A_m by pole placement."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from typing import Any

import numpy as np

from barbalat.linear.conditions import require_controllable
from barbalat.validate import Array, InputError, counted, square_matrix

FIELD = "reference_model.poles"


def place(A: Any, b: Array, poles: Iterable[Any]) -> Array:
    """A - b K with the requested poles, where K is found by state feedback; b is (n,) or (n, m).

    A complex pole is given once, as [real, imaginary], or as a complex number. A pole may be repeated as often as there are
    inputs, or with one input any number of times.

    Source: Ackermann's formula for repeated poles with one input; otherwise Tits and Yang (1996), in SciPy's implementation.
    """
    A = square_matrix("plant.A", A)
    b = np.asarray(b, dtype=float).reshape(len(A), -1)
    wanted = wanted_poles(poles, len(A), FIELD)
    inputs = b.shape[1]
    often = max(set(wanted), key=wanted.count)
    if wanted.count(often) > inputs == 1:
        K = _ackermann(A, b, wanted)
    elif wanted.count(often) > inputs:
        raise InputError.of(
            FIELD,
            f"has {_text(often)} {wanted.count(often)} times, but {counted(inputs, 'input')} can place a pole at most that many "
            f"times: "
            "move the poles slightly apart, or give A_m",
        )
    else:
        K = _robust(A, b, wanted, FIELD)
    return np.asarray(A - b @ K)


def observer_gain(A: Array, C: Array, wanted: list[complex], field: str) -> Array:
    """L, (n, p), for which A - L C has the requested eigenvalues: state feedback of the dual pair, by the methods of ``place``.

    ``field`` names the setting with the poles, for messages.
    """
    p = len(C)
    often = max(set(wanted), key=wanted.count)
    count = wanted.count(often)
    if count > p == 1:
        return np.asarray(_ackermann(A.T, C.T, wanted).T)
    if count > p:
        raise InputError.of(
            field,
            f"has one pole {count} times, but {counted(p, 'measured quantity')} can place a pole at most that many times: "
            "move the poles slightly apart",
        )
    return np.asarray(_robust(A.T, C.T, wanted, field).T)


def wanted_poles(poles: Iterable[Any], n: int, field: str) -> list[complex]:
    """Both poles of each pair; raises InputError unless there are n poles, all in Re s < 0."""
    wanted = _wanted(poles, n, field)
    unstable = [pole for pole in wanted if not pole.real < 0]
    if unstable:
        raise InputError.of(field, f"must lie in Re s < 0, got {_text(unstable[0])}")
    return wanted


def _wanted(poles: Iterable[Any], n: int, field: str) -> list[complex]:
    """Both poles of each pair; raises InputError unless there are n poles."""
    given, wanted = list(poles), []
    for pole in _once_each(given):
        parts = np.atleast_1d(pole)
        if len(parts) not in (1, 2):
            raise InputError.of(field, f"must be numbers or [real, imaginary], got {pole!r}")
        wanted += [complex(*parts)] if len(parts) == 1 or parts[1] == 0 else [complex(*parts), complex(*parts).conjugate()]
    if len(wanted) != n:
        found = ", ".join(map(_text, wanted))
        raise InputError.of(field, f"must place {n} poles (a complex one counts twice), got {len(wanted)}: {found}")
    return wanted


def _ackermann(A: Array, b: Array, wanted: list[complex]) -> Array:
    require_controllable("(plant.A, plant.b)", A, b[:, 0])
    columns = [b[:, 0]]
    for _ in range(len(A) - 1):
        columns.append(A @ columns[-1])
    last = np.linalg.solve(np.column_stack(columns).T, np.eye(len(A))[-1])
    polynomial = np.zeros_like(A)
    for coefficient in np.poly(wanted).real:
        polynomial = polynomial @ A + coefficient * np.eye(len(A))
    return np.asarray(last @ polynomial).reshape(1, -1)


def _robust(A: Array, b: Array, wanted: list[complex], field: str) -> Array:
    from scipy.signal import place_poles

    try:
        with warnings.catch_warnings():
            # every iterate has the requested poles; only the sensitivity has not converged
            warnings.filterwarnings("ignore", "Convergence was not reached", UserWarning)
            return np.asarray(place_poles(A, b, np.array(wanted)).gain_matrix.real)
    except ValueError as error:
        raise InputError(f"{field} can't be placed: {str(error).splitlines()[0]}") from None


def _text(pole: complex) -> str:
    return f"{pole.real:g}" if pole.imag == 0 else f"{pole:g}"


def _once_each(given: list[Any]) -> list[Any]:
    """Poles in the form of case files: one pole of each complex pair, as [real, imaginary]."""
    pairs = [pole for pole in given if isinstance(pole, complex) and pole.imag > 0]
    alone = [pole for pole in given if isinstance(pole, complex) and pole.imag < 0 and pole.conjugate() not in pairs]
    real = [pole.real if isinstance(pole, complex) else pole for pole in given if not isinstance(pole, complex) or pole.imag == 0]
    return [*real, *([pole.real, abs(pole.imag)] for pole in (*pairs, *alone))]
