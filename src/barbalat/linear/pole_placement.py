"""A_m by pole placement."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from typing import Any

import numpy as np

from barbalat.validate import Array, InputError, square_matrix


def place(A: Any, b: Array, poles: Iterable[Any]) -> Array:
    """A - b K with the poles asked for, by state feedback; b is (n,) or (n, m).

    A complex pole is given once, as [real, imaginary], or as a complex number.
    """
    from scipy.signal import place_poles

    A = square_matrix("plant.A", A)
    b = np.asarray(b, dtype=float).reshape(len(A), -1)
    wanted: list[complex] = []
    for pole in _once_each(poles):
        parts = np.atleast_1d(pole)
        if len(parts) not in (1, 2):
            raise InputError.of("reference_model.poles", f"must be numbers or [real, imaginary], got {pole!r}")
        wanted += [complex(*parts)] if len(parts) == 1 or parts[1] == 0 else [complex(*parts), complex(*parts).conjugate()]
    if len(wanted) != len(A):
        raise InputError.of("reference_model.poles", f"must place {len(A)} poles (a complex one counts twice), got {len(wanted)}")
    try:
        with warnings.catch_warnings():
            # every iterate has the poles asked for; what has not converged is how little they move with A
            warnings.filterwarnings("ignore", "Convergence was not reached", UserWarning)
            K = place_poles(A, b, np.array(wanted)).gain_matrix
    except ValueError as error:
        raise InputError(f"reference_model.poles can't be placed: {str(error).splitlines()[0]}") from None
    return np.asarray(A - b @ K.real)


def _once_each(poles: Iterable[Any]) -> list[Any]:
    """Poles as case files have them: of complex numbers that come in pairs one of each pair, as [real, imaginary]."""
    given = list(poles)
    pairs = [pole for pole in given if isinstance(pole, complex) and pole.imag > 0]
    alone = [pole for pole in given if isinstance(pole, complex) and pole.imag < 0 and pole.conjugate() not in pairs]
    real = [pole.real if isinstance(pole, complex) else pole for pole in given if not isinstance(pole, complex) or pole.imag == 0]
    return [*real, *([pole.real, abs(pole.imag)] for pole in (*pairs, *alone))]
