"""Bounds, valid at all times, on a continuous linear loop's response to commands and disturbances of known sizes, by L1 norms.

Plant, input dynamics, sensor lag, observer, controller and reference model are one linear system z' = A z + B w, y = C z + D w,
where w contains the commands and the disturbances. With |w_j| <= W_j each output is at most

    sum_j ||y_i <- w_j||_1 W_j + sup |h_i|,    h(t) = C e^(A t) z(0).

h tends to zero, so |h_i(t)| is at most |h_i(0)| plus the variation of h_i before t, and at most the variation after t. Hence sup
|h_i| is at most half of |h_i(0)| + integral |h_i'|.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from barbalat.certificates.linear_loops.at_rest import adapting_parts, estimates_of, rows_of, without_limits
from barbalat.linear.enclosure import OUTWARD_FACTOR
from barbalat.linear.l1_norms.norm import row_norms
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import linear_maps
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.validate import Array, InputError

ROUNDED = 1 + 1e-9
"""Allowance for the rounding of the loop's matrices, which contain sums and products of a few float64 numbers."""
CANCELLED = 1e-10
"""The same for x - x_m, as a fraction of the bound on x: x and x_m may cancel."""
UNSTABLE = "the linear loop is unstable with the case's theta"


class Response(NamedTuple):
    """Bounds on every component at all times.

    e  |x - x_m|
    x  |x|
    u  |u|, before any limit
    """

    e: float
    x: float
    u: float


@dataclass(frozen=True, eq=False)
class LinearLoop:
    """z' = A z + B w, u = C z + D w, and V z + V_w w reaches the plant's input. w contains the commands, then the disturbances.

    x, x_m  the rows of z with the state of (1), including a baseline's states, and with that of the model
    states  the number of the plant's states, whose differences from the model's are e
    """

    A: Array
    B: Array
    C: Array
    D: Array
    V: Array
    V_w: Array
    start: Array
    x: Array
    x_m: Array
    states: int

    def outputs(self) -> dict[str, tuple[Array, Array]]:
        """C and D of e, x and u."""
        unit, k = np.eye(len(self.A)), self.states
        of_x, of_x_m, nothing = unit[self.x[:k]], unit[self.x_m[:k]], np.zeros((k, self.B.shape[1]))
        return {"e": (of_x - of_x_m, nothing), "x": (of_x, nothing), "u": (self.C, self.D)}

    def as_facts(self) -> dict[str, Any]:
        """The numbers for ``barbalat-check``."""
        return {name: part.tolist() if isinstance(part, np.ndarray) else part for name, part in vars(self).items()}


def loop_of(problem: Problem, controller: Controller) -> LinearLoop:
    """The loop without limits, by the exact Jacobians of its equations; raises InputError if it is not linear and
    time-invariant."""
    closed = replace(without_limits(ClosedLoop.of(problem, controller)), noise_bound=None)
    if closed.clocked:
        raise InputError("the plant depends on time, but the theorem holds only for time-invariant plants")
    start, signals = np.asarray(closed.initial(), dtype=float), np.zeros(closed.signal_count)
    if adapting_parts(closed, signals):
        raise InputError("the loop is not linear: the controller adapts")
    out = rows_of(closed, estimates_of(closed))  # given numbers that stay constant
    kept = np.setdiff1d(np.arange(closed.size), out)
    maps = linear_maps(closed, kept, start)
    if maps is None:
        raise InputError("the loop is not linear")
    places, sizes = closed.unpack(np.arange(closed.size)), closed.signals
    where = np.full(closed.size, -1)
    where[kept] = np.arange(len(kept))
    acting = (sizes.commands or 1) + sizes.matched + sizes.unmatched
    A, C, V = np.split(maps[:, : len(kept)], [len(kept), len(kept) + closed.inputs])
    B, D, V_w = np.split(maps[:, len(kept) : len(kept) + acting], [len(kept), len(kept) + closed.inputs])
    x = where[np.concatenate([places.x, places.baseline])]
    return LinearLoop(A, B, C, D, V, V_w, start[kept], x, where[places.x_m], problem.plant.states)


def response(problem: Problem, controller: Controller, r: Array, d: Array) -> Response:
    """Bounds for commands of the sizes ``r`` (q,) and disturbances of the sizes ``d``. Raises InputError if the loop is not
    linear or unstable."""
    loop, sizes = loop_of(problem, controller), np.concatenate([r, d])
    e, x, u = (_largest(loop, C, D, sizes) for C, D in loop.outputs().values())
    return Response((e + CANCELLED * x) * OUTWARD_FACTOR, x, u)


def _largest(loop: LinearLoop, C: Array, D: Array, sizes: Array) -> float:
    if not np.linalg.eigvals(loop.A).real.max() < 0:
        raise InputError(UNSTABLE)
    try:
        found = np.array(row_norms(loop.A, loop.B * sizes, C, D * sizes)[0])
        if loop.start.any():
            moving = row_norms(loop.A, loop.start[:, None], C @ loop.A, np.zeros((len(C), 1)))[0]
            found = found + (np.abs(C @ loop.start) + moving) / 2
    except ValueError as error:  # not certainly Hurwitz
        raise InputError(UNSTABLE) from error
    return float(found.max()) * ROUNDED
