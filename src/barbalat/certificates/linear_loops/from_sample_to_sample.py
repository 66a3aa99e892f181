"""Linearises the sampled-data loop of a sampled controller, by the exact Jacobians of its equations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from barbalat.certificates.linear_loops.at_rest import without_limits
from barbalat.linear.sampled_loop import SampledLoop
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import jacobian_function, sampled_jacobian_function
from barbalat.problem.output_feedback import OutputProblem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.validate import Array


@dataclass(frozen=True, eq=False)
class Linearised:
    """The loop at zero, without limits and quantisation at the plant's input and without f(t, y); the delay is separate.

    rows  positions in X of the parts of the controller, by name, and of u, x, the measurement and the held measurement
    """

    loop: SampledLoop
    rows: dict[str, Array]

    def for_change(self, b: Array, change: Array) -> SampledLoop:
        """The loop for the plant whose theta differs by ``change`` (n,), for phi(x) = x and one input with the column b.

        The rows of the states of a dynamic baseline, which follow the plant's states in b and theta, belong to the controller and
        do not change.
        """
        A, x = self.loop.A.copy(), self.rows["x"]
        A[np.ix_(x, x)] += np.outer(b[: len(x)], change[: len(x)])
        return replace(self.loop, A=A)


def linearised(problem: TrackingProblem, controller: Controller) -> Linearised:
    """Linearise at zero; exact for a linear plant and a linear controller."""
    if isinstance(problem, OutputProblem) and problem.plant.nonlinear is not None:
        problem = replace(problem, plant=replace(problem.plant, nonlinear=None))
    loop = ClosedLoop.of(problem, controller)
    loop = without_limits(loop)
    state = np.zeros(loop.size)
    state[loop.unpack(np.arange(loop.size)).held.started] = 1.0  # after the first sample
    signals = np.zeros(loop.signal_count)
    slopes, J = (np.array(of(loop)(state, signals)) for of in (jacobian_function, sampled_jacobian_function))
    return of_jacobians(loop, slopes, J)


def of_jacobians(
    loop: ClosedLoop, slopes: Array, J: Array, *, left_out: Array | None = None, estimates: Array | None = None
) -> Linearised:
    """Compute the loop from the Jacobians between samples and at a sample, without states that v does not affect, the models, the
    command and the rows ``left_out``. The rows of the estimates have the name "estimates"."""
    assert loop.sample_time is not None
    marked = loop.unpack(np.arange(loop.size))
    held = marked.held
    out = np.concatenate([part.reshape(-1) for part in (marked.x_m, held.x_m, held.r, held.started, held.theta_hat)])
    idle = [row for row in range(loop.size) if not (J[row].any() or J[:, row].any() or slopes[row].any() or slopes[:, row].any())]
    # constant: the counter of missed samples, which stays zero
    out = np.concatenate([out, np.array(idle, dtype=int), np.zeros(0, dtype=int) if left_out is None else left_out])
    kept = np.setdiff1d(np.arange(loop.size), out)
    where = np.full(loop.size, -1)
    where[kept] = np.arange(len(kept))
    parts = marked.controller._asdict() | {"u": held.u, "x": marked.x, "held": held.measured}
    parts["measured"] = marked.x if loop.lag is None else marked.sensor
    rows = {name: where[part.reshape(-1)] for name, part in parts.items() if isinstance(part, np.ndarray)}
    rows["estimates"] = np.zeros(0, dtype=int) if estimates is None else where[estimates]
    inputs, between = held.u.reshape(-1), slopes.copy()
    between[:, inputs] = 0.0  # the held control acts as v
    C = np.eye(loop.size)[inputs]
    inner = np.ix_(kept, kept)
    found = SampledLoop(between[inner], slopes[np.ix_(kept, inputs)], J[inner], C[:, kept], loop.sample_time)
    return Linearised(found, rows)
