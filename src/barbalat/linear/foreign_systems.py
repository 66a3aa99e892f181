"""Systems of other packages, python-control and SciPy, as arrays."""

from __future__ import annotations

from typing import Any

import numpy as np

from barbalat import validate
from barbalat.validate import Array, InputError


def is_scipy(system: Any) -> bool:
    """Whether it is a continuous system of SciPy's; discrete ones are not taken."""
    if not type(system).__module__.startswith("scipy."):
        return False
    from scipy.signal import lti

    return isinstance(system, lti)


def foreign_state_space(system: Any) -> tuple[Array, Array, Array, Array] | None:
    """A, B, C, D of a continuous state space of another package; ``None`` for anything else."""
    if not all(hasattr(system, name) for name in ("A", "B", "C", "D")) or getattr(system, "dt", None) not in (0, None):
        return None
    A, B, C, D = (np.asarray(getattr(system, name), dtype=float) for name in "ABCD")
    return A, B, C, D


def foreign_coefficients(field: str, system: Any) -> tuple[Array, Array]:
    """num and den of a continuous SISO system, highest power first; InputError names the field."""
    if is_scipy(system):
        found = system.to_tf()
        num, den = np.squeeze(found.num), found.den
        if np.ndim(num) > 1:
            raise InputError.of(field, f"must have one input and one output, got {validate.show(system)}")
        return np.atleast_1d(num), den
    if not all(hasattr(system, name) for name in ("ninputs", "noutputs", "dt")):
        raise InputError.of(
            field,
            "must be a TransferFunction, (num, den), matrices (A, B, C, D), or a system of python-control or SciPy, "
            f"got {validate.show(system)}",
        )
    import control

    if (system.ninputs, system.noutputs) != (1, 1):
        raise InputError.of(field, f"must have one input and one output, got {system.ninputs} and {system.noutputs}")
    if system.dt not in (0, None):
        raise InputError.of(field, f"must be a continuous-time system, got one with the sample time {system.dt}")
    if not isinstance(system, (control.TransferFunction, control.StateSpace)):
        raise InputError.of(field, f"must be a transfer function or state space, got {type(system).__name__}")
    converted = control.tf(system)
    return np.asarray(converted.num[0][0], float), np.asarray(converted.den[0][0], float)
