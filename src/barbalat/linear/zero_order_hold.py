"""The discrete-time form of a linear system whose input is held between samples; exact for every sample time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from barbalat.protocols import Value
from barbalat.validate import Array


@dataclass(frozen=True, eq=False)
class HeldSystem:
    """x[k+1] = Phi x[k] + Gamma r[k], with Phi = exp(A T), Gamma = integral_0^T exp(A s) ds B."""

    Phi: Array  # (n, n)
    Gamma: Array  # (n,) for one input, (n, q) for q

    @classmethod
    def of(cls, A: Array, B: Array, T: float) -> HeldSystem:
        """Return the exact sampled form of x' = A x + B r, with B (n,) or (n, q), for samples of length T [s]."""
        A, B = (np.ascontiguousarray(matrix, dtype=float) for matrix in (A, B))
        return _discretised(A.tobytes(), B.tobytes(), B.shape, T)

    def following(self, x: Value, r: Value) -> Value:
        """The state one sample later."""
        return self.Phi @ x + np.dot(self.Gamma, r)


@lru_cache(maxsize=64)  # cached, since the members of an ensemble mostly share the model
def _discretised(A: bytes, B: bytes, shape: tuple[int, ...], T: float) -> HeldSystem:
    """Discretise by one exponential of [[A, B], [0, 0]] T (Van Loan 1978, IEEE TAC 23(3))."""
    from scipy.linalg import expm

    n = shape[0]
    columns = np.frombuffer(B).reshape(n, -1)
    whole = np.zeros((n + columns.shape[1],) * 2)
    whole[:n, :n], whole[:n, n:] = np.frombuffer(A).reshape(n, n), columns
    found = expm(T * whole)
    Phi, Gamma = np.ascontiguousarray(found[:n, :n]), np.ascontiguousarray(found[:n, n:].reshape(shape))
    for part in (Phi, Gamma):
        part.flags.writeable = False
    return HeldSystem(Phi, Gamma)
