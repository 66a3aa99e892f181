"""The scale of each component of the error. The default bands are fractions of it and are the same for all controllers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Signal
from barbalat.validate import Array

ROUNDING = 1e-9
"""A component of the model that moves by less than this fraction of the largest one counts as being at rest; its motion is
rounding error."""
RESTING = 0.01
"""A component is also at rest if it moves by less than this fraction of its response to initial state, noise and disturbances, so
a negligible command counts as no command."""
INSTANTS = 2**12
"""Number of instants of a run at which disturbances and the model's free motion are evaluated."""


@dataclass(frozen=True, eq=False)
class Uncommanded:
    """The motion of the n components without a command, which does not depend on the controller.

    answer  (n,) the largest response of the components to the disturbances alone in the model, which is the loop with known
            parameters; a disturbance of a fed-back output replaces the command
    spread  (n, n) the largest value of each component in the model's free motion from an initial value of 1 of a different
            component
    """

    answer: Array
    spread: Array

    @classmethod
    def of(cls, problem: TrackingProblem, t_end: float) -> Uncommanded:
        """Return the motion for a run from 0 to t_end [s]."""
        A, B, C = problem.model.matrices
        C = np.atleast_2d(C)
        step = t_end / INSTANTS
        signals, inputs = _disturbances(problem, B)
        ahead, held = _sampled(A, inputs, step)
        powers = _powers(ahead, INSTANTS + 1)
        spread = np.abs(C @ powers @ np.linalg.pinv(C)).max(axis=0)
        t = step * np.arange(INSTANTS)
        answer = np.zeros(len(C))
        if len(inputs):
            values = np.array([np.asarray(signal(t), dtype=float) for signal in signals])
            answer = np.abs(_added_up(powers, values.T @ held.T) @ C.T).max(axis=0)
        if problem.output_disturbance is not None:
            answer = np.maximum(answer, np.abs(np.asarray(problem.output_disturbance(t), dtype=float)).max())
        return cls(answer, spread)


def _sampled(A: Array, inputs: Array, step: float) -> tuple[Array, Array]:
    """Return Phi and Gamma of x' = A x + inputs' d with d held for a step, by one exponential (Van Loan 1978, IEEE TAC 23(3))."""
    from scipy.linalg import expm

    n, k = len(A), len(inputs)
    whole = np.zeros((n + k, n + k))
    whole[:n, :n], whole[:n, n:] = A, inputs.T
    found = expm(step * whole)
    return found[:n, :n], found[:n, n:]


def _powers(ahead: Array, count: int) -> Array:
    """Return Phi^0, Phi^1, ... (count, n, n). Each multiplication of the known powers by the next one doubles their number."""
    found = np.eye(len(ahead))[None]
    while len(found) < count:
        found = np.concatenate([found, found @ (found[-1] @ ahead)])
    return found[:count]


def _added_up(powers: Array, forced: Array) -> Array:
    """Return x_1, x_2, ... (K, n) of x_{k+1} = Phi x_k + forced_k from x_0 = 0, by repeatedly doubling the number of terms."""
    x, terms = np.array(forced), 1
    while terms < len(x):
        x[terms:] += x[:-terms] @ powers[terms].T
        terms *= 2
    return x


def _disturbances(problem: TrackingProblem, B: Array) -> tuple[list[Signal], Array]:
    """Return the signals that move the simulated state, and their directions in the plant's state (k, n)."""
    b, acting = getattr(problem.plant, "b", None), problem.surroundings
    matched = [] if acting.disturbance is None else [(acting.disturbance, B if b is None else b)]
    measured = problem.dynamics.output  # converts the states of [truth] to those of the plant
    every = [*matched, *((one.signal, measured(np.asarray(one.direction, dtype=float))) for one in acting.unmatched)]
    rows = [np.pad(np.reshape(direction, -1), (0, len(B) - np.size(direction))) for _, direction in every]
    return [signal for signal, _ in every], np.array(rows).reshape(-1, len(B))  # no disturbance enters the states of a baseline


def scale_of(model: Array, initial: Array, noise: Array | None, beside: Uncommanded) -> Array:
    """Return the scale of each component (M, n), which is the largest |y_m| of the run.

    If the model is at rest, the scale is the largest of |y| at t = 0, the standard deviation of the noise, and the response to
    the disturbances. If these vanish too, it is the free response of the model to the scales of the other components. It is 0 if
    nothing moves at all.
    """
    moves = np.where(model > ROUNDING * model.max(axis=-1, keepdims=True, initial=0.0), model, 0.0)
    other = np.maximum(np.maximum(np.abs(initial), 0.0 if noise is None else noise), beside.answer)
    found = np.where(moves > RESTING * other, moves, other)
    return np.asarray(np.where(found > 0, found, found @ beside.spread.T))
