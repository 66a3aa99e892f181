"""The filters from the estimates of the piecewise-constant law to u: C(s), and C(s) H_m^-1 H_um for the unmatched estimates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat import validate
from barbalat.controllers.steps import half_step
from barbalat.linear.systems import StateSpace, TransferFunction
from barbalat.protocols import Value
from barbalat.validate import Array, InputError

DEPENDENCE_TOLERANCE = 1e-9
"""Relative tolerance: smaller entries are rounding errors of products of matrices with entries of size 1."""


@dataclass(frozen=True, eq=False)
class FilterStep:
    """z[k+1] = A z[k] + B (w[k] + w[k+1]), u = C z + D w by the trapezoidal rule; the first m channels of w (n,) are matched."""

    A: Array
    B: Array
    C: Array
    D: Array

    def end(self, z: Value, before: Value, now: Value) -> Value:
        return self.A @ z + self.B @ (before + now)

    def output(self, z: Value, w: Value) -> Value:
        return self.C @ z + self.D @ w


def filter_step(A_m: Array, B: Array, m: int, C: TransferFunction | None, c: Array | None, T: float) -> FilterStep:
    """The filter for samples of T [s]; ``c``, (m, n), is the output from which the unmatched part is to be removed, or
    ``None``."""
    n = len(A_m)
    single, known = (StateSpace.gain(1.0), 0) if C is None else (C.realise(), C.relative_degree)
    order = single.order
    parts = [np.kron(np.eye(m), part) for part in (single.A, single.B[:, None], single.C[None, :])]
    A, W, out = parts[0], np.hstack([parts[1], np.zeros((m * order, n - m))]), parts[2]
    D = np.hstack([single.D * np.eye(m), np.zeros((m, n - m))])
    if c is not None and n > m:
        inverse = _compensation(A_m, B, m, single, known, c)
        A = np.block([[A, np.zeros((len(A), len(inverse[0])))], [np.zeros((len(inverse[0]), len(A))), inverse[0]]])
        W = np.vstack([W, np.hstack([np.zeros((len(inverse[0]), m)), inverse[1]])])
        out = np.hstack([out, inverse[2]])
    half = half_step(A, T)
    return FilterStep(half @ (np.eye(len(A)) + T / 2 * A), T / 2 * half @ W, out, D)


def _compensation(A_m: Array, B: Array, m: int, C: StateSpace, known: int, c: Array) -> tuple[Array, Array, Array]:
    """-C(s) H_m(s)^-1 H_um(s): (A, B, C) from sigma_hat_um to u, where v keeps c'w zero in w' = A_m w + b v + b_um zeta.

    zeta = C(s) sigma_hat_um. ``known`` contains as many of its derivatives, beginning with zeta itself, as the relative degree of
    C(s), so nothing is differentiated. With r_i the relative degree of c_i, v is chosen such that (d/dt + a)^r_i c_i'w = 0,
    starting from zero, so c_i'w is zero. The constant a, on which H_m^-1 H_um does not depend, only makes rounding errors decay.
    """
    b, b_um, k = B[:, :m], B[:, m:], len(A_m) - m
    A_z, B_z, C_z = (np.kron(np.eye(k), part) for part in (C.A, C.B[:, None], C.C[None, :]))
    degrees = [_relative_degree(A_m, b, row) for row in c]
    if max(degrees) > known:
        raise InputError(
            f"output needs a filter of relative degree {max(degrees)} or more: C(s) H_m(s)^-1 H_um(s) must be proper, got {known}"
        )
    derivatives = [C_z @ np.linalg.matrix_power(A_z, j) for j in range(known)]
    a = float(np.abs(np.linalg.eigvals(A_m)).max())
    rows = [
        _kept_at_zero(A_m, b, b_um, row, np.poly(np.full(r, -a))[::-1], derivatives) for row, r in zip(c, degrees, strict=True)
    ]
    E, of_w, of_z = (np.array(part) for part in zip(*rows, strict=True))
    if not abs(np.linalg.det(E / np.abs(E).max())) > DEPENDENCE_TOLERANCE:
        raise InputError(
            f"output must be decoupled by the inputs: c_i'A_m^(r_i - 1) b is singular, got output = {validate.show(c)}"
        )
    K_w, K_z = -np.linalg.solve(E, of_w), -np.linalg.solve(E, of_z)
    zeros = np.linalg.eigvals(A_m + b @ K_w).real.max()
    if not zeros < 0:
        raise InputError(
            f"output must have a minimum-phase transfer function H_m(s), but a zero has real part {zeros:.4g}"
            "; omit output, and unmatched disturbances are only estimated"
        )
    A = np.block([[A_z, np.zeros((len(A_z), len(A_m)))], [b @ K_z + b_um @ C_z, A_m + b @ K_w]])
    return A, np.vstack([B_z, np.zeros((len(A_m), k))]), np.hstack([K_z, K_w])


def _kept_at_zero(
    A_m: Array, b: Array, b_um: Array, row: Array, weights: Array, derivatives: list[Array]
) -> tuple[Array, Array, Array]:
    """The coefficients of v, w and zeta's states in the sum of the weighted derivatives of row'w, from the zeroth to the r-th."""
    r = len(weights) - 1
    powers = [row @ np.linalg.matrix_power(A_m, j) for j in range(r + 1)]
    of_w = sum(weight * power for weight, power in zip(weights, powers, strict=True))
    of_z = sum(weights[j] * (powers[s] @ b_um) @ derivatives[j - 1 - s] for j in range(1, r + 1) for s in range(j))
    return powers[r - 1] @ b, np.asarray(of_w), np.asarray(of_z)


def _relative_degree(A_m: Array, b: Array, row: Array) -> int:
    """The number of derivatives of c'x until an input appears."""
    size = np.linalg.norm(b)
    for r in range(1, len(A_m) + 1):
        if np.linalg.norm(row @ b) > DEPENDENCE_TOLERANCE * np.linalg.norm(row) * size:
            return r
        row = row @ A_m
    raise InputError(f"output must respond to an input, but c'(sI - A_m)^-1 b is zero, got {validate.show(row)}")
