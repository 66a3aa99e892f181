"""Validation of a plant by predicting samples: simulation, restarts for an unstable plant, and fits."""

from __future__ import annotations

import numpy as np

from barbalat.identify.output_error import simulated
from barbalat.identify.recording import Recording
from barbalat.linear.zero_order_hold import HeldSystem
from barbalat.validate import Array


def restart_every(matrix: Array, rest: Recording) -> int | None:
    """The number of samples after which the simulation of an unstable plant restarts; None if it never restarts."""
    n = len(matrix)
    growth, duration = float(np.linalg.eigvals(matrix[:, :n]).real.max()), float(rest.times[-1] - rest.times[0])
    return max(1, int(1 / (growth * mean_interval(rest)))) if growth * duration > 1 else None


def mean_interval(recording: Recording) -> float:
    """The mean sampling interval [s]."""
    return float(recording.times[-1] - recording.times[0]) / (len(recording.times) - 1)


def predicted(matrix: Array, rest: Recording, restarted: int | None) -> Array:
    """(N, n) states simulated with [A B] from the initial state that fits all samples best, or, with restarts, from the measured
    state at the first sample and again after every ``restarted`` samples."""
    if restarted is None:
        return simulated(rest, matrix)
    n, found = len(matrix), [rest.outputs[0]]
    with np.errstate(all="ignore"):
        for k, (h, u) in enumerate(zip(np.diff(rest.times), rest.inputs[:-1], strict=True)):
            start = rest.outputs[k] if k % restarted == 0 else found[-1]
            found.append(HeldSystem.of(matrix[:, :n], matrix[:, n:], float(h)).following(start, u))
    return np.array(found)


def fits(rest: Recording, states: Array) -> dict[str, float | None]:
    """By state: 1 - |y - predicted| / |y - mean|; None if a state did not move or its prediction diverged."""
    with np.errstate(all="ignore"):
        spread = np.linalg.norm(rest.outputs - rest.outputs.mean(axis=0), axis=0)
        missed = np.linalg.norm(rest.outputs - states, axis=0)
    told = [float(1 - m / s) if s > 0 and np.isfinite(m) else None for m, s in zip(missed, spread, strict=True)]
    return dict(zip(rest.output_names, told, strict=True))
