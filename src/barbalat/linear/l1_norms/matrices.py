"""The four matrices of a linear system, however it is given."""

from __future__ import annotations

from typing import Any

import numpy as np

from barbalat import validate
from barbalat.linear.systems import StateSpace, TransferFunction
from barbalat.validate import Array, InputError


def matrices(system: Any) -> tuple[Array, Array, Array, Array]:
    """A (n, n), B (n, m), C (p, n), D (p, m) of ours, or of a continuous-time system of python-control.

    A state space is taken as it is, with any number of inputs and outputs; a transfer function has one of each and is realised:
    its coefficients over the leading one of the denominator, rounded to floats.
    """
    if _is_python_control_state_space(system):
        if system.dt not in (0, None):
            raise InputError(f"the system must be a continuous-time one, got one with the sample time {system.dt}")
        return tuple(np.asarray(getattr(system, name), dtype=float) for name in "ABCD")  # type: ignore[return-value]
    if not isinstance(system, (StateSpace, TransferFunction)) and not hasattr(system, "ninputs"):
        raise InputError(
            "l1_norm takes the matrices A, B, C and D, or one TransferFunction, StateSpace or python-control system, "
            f"got {validate.show(system)}"
        )
    found = StateSpace.accept("the system", system)
    return found.A, found.B[:, None], found.C[None, :], np.array([[found.D]])


def _is_python_control_state_space(system: Any) -> bool:
    return all(hasattr(system, name) for name in ("A", "B", "C", "D", "dt"))
