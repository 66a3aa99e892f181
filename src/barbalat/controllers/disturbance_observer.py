"""Observers of the state and of f in x' = A x + b (v + f), linear in what is measured of x and in v; f is taken as constant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.protocols import Value
from barbalat.validate import Array, InputError, show

PLACEMENT_TOLERANCE = 1e-6
"""Of the observer's characteristic polynomial: further off, the output hardly sees a state or the disturbance."""


@dataclass(frozen=True, eq=False)
class Observer:
    """xi' = F xi + G x + H v with (x_hat, f_hat) = M xi + N x; n states, m inputs."""

    F: Array
    G: Array
    H: Array
    M: Array
    N: Array

    @classmethod
    def of_state(cls, A: Array, b: Array, bandwidth: float) -> Observer:
        """f_hat = bandwidth/(s + bandwidth) [f] from the whole state: f_hat = xi + bandwidth b^+ x, without x'; x_hat = x.

        InputError where the columns of b depend on each other.
        """
        n, m = b.shape
        if np.linalg.matrix_rank(b) < m:
            raise InputError(f"adrc needs independent columns of plant.b, got {show(b)}")
        measured = bandwidth * np.linalg.pinv(b)
        return cls(
            F=-bandwidth * np.eye(m),
            G=-measured @ A - bandwidth * measured,
            H=-bandwidth * np.eye(m),
            M=np.vstack([np.zeros((n, m)), np.eye(m)]),
            N=np.vstack([np.eye(n), measured]),
        )

    @classmethod
    def of_output(cls, A: Array, b: Array, c: Array, bandwidth: float) -> Observer:
        """The extended-state observer: xi = (x_hat, f_hat), from c'x, with all n + 1 poles at -bandwidth, for one input.

        InputError where c'x does not see a state or the disturbance: c'(sI - A)^-1 b must not vanish at s = 0.
        """
        n, m = b.shape
        if m > 1:
            raise InputError(f"output goes with one input, got {m}: leave it out, so that the whole state is measured")
        extended, seen = np.block([[A, b], [np.zeros((1, n + 1))]]), np.append(c, 0.0)
        try:
            with np.errstate(all="ignore"):
                gain = _ackermann(extended, seen, bandwidth)
                F = extended - np.outer(gain, seen)
                off = np.abs(np.poly(F) / np.poly(np.full(n + 1, -bandwidth)) - 1).max()
        except np.linalg.LinAlgError:
            off = np.inf
        if not off <= PLACEMENT_TOLERANCE:
            raise InputError(
                f"output must see every state and a constant disturbance, but {show(c)} does not, or not beyond rounding with "
                f"the bandwidth {bandwidth:g}"
            )
        return cls(
            F=F,
            G=np.outer(gain, c),
            H=np.vstack([b, np.zeros((1, 1))]),
            M=np.eye(n + 1),
            N=np.zeros((n + 1, n)),
        )

    def started(self, x: Value) -> Value:
        """xi with the state measured and no disturbance, x_hat = x and f_hat = 0: M'M = I in both forms."""
        wanted = np.concatenate([x, np.zeros(self.N.shape[0] - x.shape[0])]) - self.N @ x
        return self.M.T @ wanted

    def derivative(self, xi: Value, x: Value, v: Value) -> Value:
        """The derivative of the observer's state xi."""
        return self.F @ xi + self.G @ x + self.H @ v

    def estimates(self, xi: Value, x: Value) -> tuple[Value, Value]:
        """x_hat (n,) and f_hat (m,)."""
        both, n = self.M @ xi + self.N @ x, self.N.shape[1]
        return both[:n], both[n:]


def _ackermann(A: Array, c: Array, bandwidth: float) -> Array:
    """g with all eigenvalues of A - g c' at -bandwidth: (A + bandwidth I)^N O^-1 [0 ... 0 1]', O the observability matrix."""
    size, rows = len(A), [c]
    for _ in range(size - 1):
        rows.append(rows[-1] @ A / bandwidth)  # scaled, so that rows are of one size
    last = np.zeros(size)
    last[-1] = np.float64(bandwidth) ** -(size - 1)
    column = np.linalg.solve(np.array(rows), last)
    return np.asarray(np.linalg.matrix_power(A + bandwidth * np.eye(size), size) @ column)
