"""A_m by pole placement."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from barbalat.problem.plant import input_matrix
from barbalat.validate import InputError, square_matrix


def place(A: Any, b: Any, poles: list[Any]) -> np.ndarray:
    """A - b K with the poles asked for, by state feedback; a complex pole is given once, as [real, imaginary]."""
    from scipy.signal import place_poles

    A = square_matrix("plant.A", A)
    b = input_matrix("plant.b", b, len(A)).reshape(len(A), -1)
    wanted: list[complex] = []
    for pole in poles:
        parts = np.atleast_1d(pole)
        if len(parts) not in (1, 2):
            raise InputError(f"reference_model.poles must be numbers or [real, imaginary], got {pole!r}")
        wanted += [complex(*parts)] if len(parts) == 1 or parts[1] == 0 else [complex(*parts), complex(*parts).conjugate()]
    if len(wanted) != len(A):
        raise InputError(f"reference_model.poles must place {len(A)} poles (a complex one counts twice), got {len(wanted)}")
    try:
        with warnings.catch_warnings():
            # every iterate has the poles asked for; what has not converged is how little they move with A
            warnings.filterwarnings("ignore", "Convergence was not reached", UserWarning)
            K = place_poles(A, b, np.array(wanted)).gain_matrix
    except ValueError as error:
        raise InputError(f"reference_model.poles can't be placed: {str(error).splitlines()[0]}") from None
    return np.asarray(A - b @ K.real)
