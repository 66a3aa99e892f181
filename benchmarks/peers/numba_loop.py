"""Numba: loops over preallocated arrays, compiled by ``njit``, for Section V's L1 loop, alone or one member after another."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np

from benchmarks.loops import Case, command_table
from benchmarks.peers.equations import A_M, BOUND, GAMMA, K_0, KAPPA, P_B, STEP, THETA, WRITTEN
from benchmarks.race import Contestant

SIZE = 9


def contestants(case: Case, steps: int) -> list[Contestant]:
    """The contestants with and without ``fastmath``, for an ensemble also with a thread for each core. There is none for loops
    other than L1's."""
    if not case.name.startswith("L1"):
        return []
    in_threads = (False, True) if case.members > 1 else (False,)
    return [
        _contestant(case, steps, fastmath=fastmath, parallel=parallel) for fastmath in (False, True) for parallel in in_threads
    ]


def _contestant(case: Case, steps: int, *, fastmath: bool, parallel: bool) -> Contestant:
    trajectories = _compiled(fastmath=fastmath, parallel=parallel)
    gains = case.parameters[0] if case.members > 1 else np.array([GAMMA])

    def run(steps: int) -> np.ndarray:
        states = np.array(case.states.T, order="C")
        trajectories(states, gains, command_table()[:steps])
        return states.T[: WRITTEN[case.name].compared]

    return Contestant(f"Numba{', fastmath' * fastmath}{', prange' * parallel}", steps, run, threads=parallel)


def _compiled(*, fastmath: bool, parallel: bool) -> Callable[[Any, Any, Any], None]:
    a, b, p1, p2 = A_M[1, 0], A_M[1, 1], P_B[0], P_B[1]
    theta1, theta2 = THETA

    @numba.njit(fastmath=fastmath)
    def projected(rate, estimate):
        if (estimate >= BOUND and rate > 0.0) or (estimate <= -BOUND and rate < 0.0):
            return 0.0
        return rate

    @numba.njit(fastmath=fastmath)
    def derivative(y, gamma, r, k):
        x1, x2, u = y[0], y[1], y[8]
        learnt = y[4] * x1 + y[5] * x2
        error = gamma * ((x1 - y[6]) * p1 + (x2 - y[7]) * p2)
        k[0] = x2
        k[1] = a * x1 + b * x2 + u + theta1 * x1 + theta2 * x2
        k[2] = y[3]
        k[3] = a * y[2] + b * y[3] + K_0 * r
        k[4] = projected(error * x1, y[4])
        k[5] = projected(error * x2, y[5])
        k[6] = y[7]
        k[7] = a * y[6] + b * y[7] + u + learnt
        k[8] = (K_0 * r - learnt - u) / KAPPA

    @numba.njit(fastmath=fastmath)
    def stage(y, h, k, out):
        for i in range(SIZE):
            out[i] = y[i] + h * k[i]
        for i in (4, 5):
            out[i] = min(max(out[i], -BOUND), BOUND)

    @numba.njit(fastmath=fastmath)
    def trajectory(y, gamma, table):
        k = np.empty((4, SIZE))
        z = np.empty(SIZE)
        for n in range(len(table)):
            derivative(y, gamma, table[n, 0], k[0])
            stage(y, STEP / 2, k[0], z)
            derivative(z, gamma, table[n, 1], k[1])
            stage(y, STEP / 2, k[1], z)
            derivative(z, gamma, table[n, 1], k[2])
            stage(y, STEP, k[2], z)
            derivative(z, gamma, table[n, 2], k[3])
            for i in range(SIZE):
                k[0, i] += 2 * k[1, i] + 2 * k[2, i] + k[3, i]
            stage(y, STEP / 6, k[0], y)

    @numba.njit(fastmath=fastmath, parallel=parallel)
    def trajectories(states, gains, table):
        for member in numba.prange(len(states)):
            trajectory(states[member], gains[member], table)

    return trajectories
