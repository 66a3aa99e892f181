"""What is large for a component of the error: the unit in which the default bands are shares, the same for all controllers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Signal
from barbalat.validate import Array

ROUNDING = 1e-9
"""A model's component that moves by less than this part of the largest one rests; what is seen of it are roundings."""
RESTING = 0.01
"""It rests too where it moves by less than this part of what initial state, noise and disturbances make of it: a command of
next to nothing is none."""
INSTANTS = 2**12
"""Of a run, at which disturbances and the model's free motion are taken."""


@dataclass(frozen=True, eq=False)
class Uncommanded:
    """What moves the n components beside the command, whoever controls them.

    answer  (n,) their largest motion under the disturbances alone, where nothing counters these: that of the model, which is the
            loop with known parameters; a disturbance of an output that is fed back stands in the place of the command
    spread  (n, n) how large each becomes in the model's free motion from one unit of another
    """

    answer: Array
    spread: Array

    @classmethod
    def of(cls, problem: TrackingProblem, t_end: float) -> Uncommanded:
        """From t = 0 to t_end [s]."""
        A, B, C = problem.model.matrices
        C = np.atleast_2d(C)
        step = t_end / INSTANTS
        signals, inputs = _disturbances(problem, B)
        ahead, held = _sampled(A, inputs, step)
        powers = [np.eye(len(A))]
        for _ in range(INSTANTS):
            powers.append(ahead @ powers[-1])
        spread = np.abs(C @ np.array(powers) @ np.linalg.pinv(C)).max(axis=0)
        t = step * np.arange(INSTANTS)
        answer = np.zeros(len(C))
        if len(inputs):
            x = np.zeros(len(A))
            for values in np.array([np.asarray(signal(t), dtype=float) for signal in signals]).T:
                x = ahead @ x + held @ values
                answer = np.maximum(answer, np.abs(C @ x))
        if problem.output_disturbance is not None:
            answer = np.maximum(answer, np.abs(np.asarray(problem.output_disturbance(t), dtype=float)).max())
        return cls(answer, spread)


def _sampled(A: Array, inputs: Array, step: float) -> tuple[Array, Array]:
    """Phi and Gamma of x' = A x + inputs' d, with d held for a step, by one exponential (Van Loan 1978, IEEE TAC 23(3))."""
    from scipy.linalg import expm

    n, k = len(A), len(inputs)
    whole = np.zeros((n + k, n + k))
    whole[:n, :n], whole[:n, n:] = A, inputs.T
    found = expm(step * whole)
    return found[:n, :n], found[:n, n:]


def _disturbances(problem: TrackingProblem, B: Array) -> tuple[list[Signal], Array]:
    """The signals that move the state of what is simulated, and (k, n) along which direction of the plant's each does."""
    b, acting = getattr(problem.plant, "b", None), problem.surroundings
    matched = [] if acting.disturbance is None else [(acting.disturbance, B if b is None else b)]
    measured = problem.dynamics.output  # of a truth with other states those of the plant
    every = [*matched, *((one.signal, measured(np.asarray(one.direction, dtype=float))) for one in acting.unmatched)]
    rows = [np.pad(np.reshape(direction, -1), (0, len(B) - np.size(direction))) for _, direction in every]
    return [signal for signal, _ in every], np.array(rows).reshape(-1, len(B))  # no disturbance enters a baseline's own states


def scale_of(model: Array, initial: Array, noise: Array | None, beside: Uncommanded) -> Array:
    """The scale of each component, (M, n): the largest |y_m| of the run.

    Where the model rests, the largest of |y| at t = 0, the noise's standard deviation, and the answer to the disturbances; where
    none of these is there, what the model's free motion makes of the other components' scales; 0 where nothing moves at all.
    """
    moves = np.where(model > ROUNDING * model.max(axis=-1, keepdims=True, initial=0.0), model, 0.0)
    other = np.maximum(np.maximum(np.abs(initial), 0.0 if noise is None else noise), beside.answer)
    found = np.where(moves > RESTING * other, moves, other)
    return np.asarray(np.where(found > 0, found, found @ beside.spread.T))
