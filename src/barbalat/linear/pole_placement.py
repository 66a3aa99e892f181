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
    """A - b K with the poles asked for, by state feedback; b is (n,) or (n, m).

    A complex pole is given once, as [real, imaginary], or as a complex number; a pole may stand as often as there are inputs,
    with one input as often as one likes.

    Source: Ackermann's formula where a pole of one input stands several times; else Tits and Yang (1996), as SciPy has it.
    """
    A = square_matrix("plant.A", A)
    b = np.asarray(b, dtype=float).reshape(len(A), -1)
    wanted = _wanted(poles, len(A))
    unstable = [pole for pole in wanted if not pole.real < 0]
    if unstable:
        raise InputError.of(FIELD, f"must lie in Re s < 0, got {_text(unstable[0])}")
    inputs = b.shape[1]
    often = max(set(wanted), key=wanted.count)
    if wanted.count(often) > inputs == 1:
        K = _ackermann(A, b, wanted)
    elif wanted.count(often) > inputs:
        raise InputError.of(
            FIELD,
            f"has {_text(often)} {wanted.count(often)} times, and {counted(inputs, 'input')} can place a pole as often as that: "
            "move them a little apart, or give A_m",
        )
    else:
        K = _robust(A, b, wanted)
    return np.asarray(A - b @ K)


def _wanted(poles: Iterable[Any], n: int) -> list[complex]:
    """Both poles of each pair; InputError unless there are n."""
    given, wanted = list(poles), []
    for pole in _once_each(given):
        parts = np.atleast_1d(pole)
        if len(parts) not in (1, 2):
            raise InputError.of(FIELD, f"must be numbers or [real, imaginary], got {pole!r}")
        wanted += [complex(*parts)] if len(parts) == 1 or parts[1] == 0 else [complex(*parts), complex(*parts).conjugate()]
    if len(wanted) != n:
        found = ", ".join(map(_text, wanted))
        raise InputError.of(FIELD, f"must place {n} poles (a complex one counts twice), got {len(wanted)}: {found}")
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


def _robust(A: Array, b: Array, wanted: list[complex]) -> Array:
    from scipy.signal import place_poles

    try:
        with warnings.catch_warnings():
            # every iterate has the poles asked for; what has not converged is how little they move with A
            warnings.filterwarnings("ignore", "Convergence was not reached", UserWarning)
            return np.asarray(place_poles(A, b, np.array(wanted)).gain_matrix.real)
    except ValueError as error:
        raise InputError(f"{FIELD} can't be placed: {str(error).splitlines()[0]}") from None


def _text(pole: complex) -> str:
    return f"{pole.real:g}" if pole.imag == 0 else f"{pole:g}"


def _once_each(given: list[Any]) -> list[Any]:
    """Poles as case files have them: of complex numbers that come in pairs one of each pair, as [real, imaginary]."""
    pairs = [pole for pole in given if isinstance(pole, complex) and pole.imag > 0]
    alone = [pole for pole in given if isinstance(pole, complex) and pole.imag < 0 and pole.conjugate() not in pairs]
    real = [pole.real if isinstance(pole, complex) else pole for pole in given if not isinstance(pole, complex) or pole.imag == 0]
    return [*real, *([pole.real, abs(pole.imag)] for pole in (*pairs, *alone))]
