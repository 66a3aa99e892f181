"""What a linear system does under given signals: exact for signals that are straight between the instants."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from barbalat.protocols import Signal
from barbalat.validate import Array, signal_values

MOST_INSTANTS = 20_000
"""At which the signals are sampled at most."""


def driven_response(
    A: Array, B: Array, C: Array, x0: Array, signals: Sequence[Signal], t_end: float, steps: int
) -> tuple[Array, Array]:
    """Instants (K,) from 0 to ``t_end`` [s] and the output C x there, (K, outputs), of x' = A x + B [signals], x(0) = x0.

    There are ``steps`` intervals, or MOST_INSTANTS where these are fewer.
    """
    from scipy.signal import StateSpace as Continuous
    from scipy.signal import lsim

    t = np.linspace(0.0, t_end, min(steps, MOST_INSTANTS) + 1)
    driven = np.stack([signal_values(signal, t) for signal in signals], axis=1)
    _, y, _ = lsim(Continuous(A, B, C, np.zeros((len(C), B.shape[1]))), driven, t, X0=x0)  # type: ignore[call-overload]
    return t, np.asarray(y).reshape(len(t), len(C))
