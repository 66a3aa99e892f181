"""What commands and disturbances of known sizes can do to a sampled linear loop, at all times: sums of its impulse responses.

Plant, actuator, sensor lag, delay, controller and the model under the sampled command are one linear system from sample to
sample. With z its state just after a sample, the held command in it, and u as it is on its way through the delay,

    z[k+1] = M z[k] + N r[k+1] + J integral_0^T e^(A (T - s)) B d(t_k + s) ds.

What r can do to a row C z is the sum of |C M^i N|, for every sequence within its size. Of d only its bound is used: in a part of
the sample, T/P long, e^(A s) B is off its value at the part's start by at most e^(|A| T) (e^(|A| T/P) - I) |B|.

Between samples the motion under the held inputs is known at the parts' ends and where the delayed input switches. Within a part
of length h it is off the straight line between its ends by at most h^2/8 times |x''| <= e^(|A| h) |A (A x + E v)|. What d adds
within a sample is at most what it does to a row by the sample's end or by the part's.

The model follows r between the samples too: ``missed`` bounds what that changes.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from barbalat.certificates.entry import NotApplicable
from barbalat.certificates.linear_loops.at_rest import estimates_of, rows_of, without_limits
from barbalat.linear.enclosure import OUTWARD_FACTOR
from barbalat.linear.l1_norms import l1_norm
from barbalat.linear.sampled_loop import SampledLoop
from barbalat.linear.sampled_norms import SampledNorms, grown
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import jacobian_function, sampled_jacobian_function
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import BoundedSignal, BreakingSignal, Controller, Signal, SlopedSignal
from barbalat.signals.piecewise import rounding_of
from barbalat.validate import Array, InputError

PARTS = 16
"""Parts of a sample, at whose ends the motion is known exactly."""


class Response(NamedTuple):
    """Bounds at all times, of every component.

    held     |x - x_m|, x_m of the model under the command as it is sampled
    x        |x|
    u        |u|, before any limit
    """

    held: float
    x: float
    u: float


@dataclass(frozen=True, eq=False)
class _Whole:
    """The loop with its model and the held command: z by the names of ``rows``."""

    loop: SampledLoop
    N: Array  # (z, q) what a command does in a sample
    B: Array  # (z, d) where disturbances enter
    free: Array  # (z,) after the first sample without a command
    first: Array  # (z, q) what the first command does to that
    rows: dict[str, Array]
    A_m: Array
    b_r: Array  # (n, q)


def response(problem: Problem, controller: Controller, r: Array, d: Array) -> Response:
    """For commands of the sizes ``r`` (q,) and disturbances of the sizes ``d``; InputError where the loop forgets too slowly."""
    whole, delay = _whole(problem, controller), problem.delay
    loop, s = whole.loop, len(whole.loop.A)
    M = loop.closed(delay)
    behind = np.zeros((len(M) - s, 1))

    def padded(part: Array) -> Array:
        return np.vstack([part, np.tile(behind, part.shape[1])])

    reached, weights = _reached(loop.A, whole.B, loop.T)
    free = np.concatenate([whole.free, behind[:, 0]])

    def largest(C: Array) -> Array:
        norms = SampledNorms(M, C)
        found = (norms.summed(padded(whole.N)) + norms.largest(padded(whole.first))) @ r + norms.largest(free[:, None])[:, 0]
        if len(d):
            found = found + norms.summed(padded(loop.J @ reached)) @ (weights @ d)
        return np.asarray(found * OUTWARD_FACTOR)

    x, x_m, n = whole.rows["x"], whole.rows["x_m"], len(whole.rows["x"])
    at_ends, bends, lengths = _between(loop, delay, M)
    of_model, bends_of_model = _model_between(whole, M, lengths)
    start = np.eye(len(M))
    ends, models = [start[x], *(end[x] for end in at_ends)], [start[x_m], *of_model]
    differences = [end - model for end, model in zip(ends, models, strict=True)]
    groups = [differences, ends, bends, bends_of_model, [loop.broken(delay)[2]]]
    blocks = [block for group in groups for block in group]
    found = iter(np.split(largest(np.vstack(blocks)), np.cumsum([len(block) for block in blocks])[:-1]))
    away, far, bent, bent_model, (u,) = ([next(found) for _ in group] for group in groups)
    within = (np.abs(reached[x]) @ weights @ d if len(d) else np.zeros(n)) * 2
    held, of_x = away[0], far[0]
    for k, h in enumerate(lengths):
        curved = h**2 / 8 * (grown(loop.A, h) @ bent[k])[x]
        curved_model = h**2 / 8 * (grown(whole.A_m, h) @ bent_model[k])
        held = np.maximum(held, np.maximum(away[k], away[k + 1]) + curved + curved_model)
        of_x = np.maximum(of_x, np.maximum(far[k], far[k + 1]) + curved)
    return Response(*(float(one.max()) * OUTWARD_FACTOR for one in (held + within, of_x + within, u)))


def _whole(problem: Problem, controller: Controller) -> _Whole:
    """By the equations' own exact Jacobians, which of a linear loop are the same everywhere."""
    closed = ClosedLoop.of(problem, controller)
    closed = without_limits(closed)
    if closed.clocked:
        raise InputError("the plant depends on time, and the theorem is of one that does not")
    size, count = closed.size, closed.signal_count
    places, sizes = closed.unpack(np.arange(size)), closed.signals
    held = places.held
    zero, signals = np.zeros(size), np.zeros(count)
    zero[held.started] = 1.0
    start = np.asarray(closed.initial(), dtype=float)
    estimates = rows_of(closed, estimates_of(closed))
    zero[estimates] = start[estimates]
    slopes = np.array(jacobian_function(closed)(zero, signals))
    J = np.array(sampled_jacobian_function(closed)(zero, signals))
    settings = [row for row in estimates if (J[row] == np.eye(size)[row]).all()]  # numbers that it was given: nothing moves them
    q = sizes.commands or 1
    units = np.eye(count)
    N = np.column_stack([np.asarray(closed.sample(zero, units[j])) - np.asarray(closed.sample(zero, signals)) for j in range(q)])
    free = np.asarray(closed.sample(start, signals), dtype=float)
    first = np.column_stack([np.asarray(closed.sample(start, units[j])) - free for j in range(q)])
    acting = range(q, q + sizes.matched + sizes.unmatched)
    B = np.array([np.asarray(closed.derivative(zero, units[j])) - np.asarray(closed.derivative(zero, signals)) for j in acting]).T
    out = [*places.x_m, int(held.started), *np.reshape(held.theta_hat, -1).tolist(), *settings]
    kept = np.setdiff1d(np.arange(size), np.array(out, dtype=int))
    where = np.full(size, -1)
    where[kept] = np.arange(len(kept))
    rows = {"x": where[places.x], "x_m": where[held.x_m], "r": where[np.reshape(held.r, -1)]}
    inputs, between, C = np.reshape(held.u, -1), slopes.copy(), np.eye(size)[np.reshape(held.u, -1)]
    between[:, inputs] = 0.0
    inner = np.ix_(kept, kept)
    assert closed.sample_time is not None
    loop = SampledLoop(between[inner], slopes[np.ix_(kept, inputs)], J[inner], C[:, kept], closed.sample_time)
    A_m, b_r, _ = problem.model.matrices
    return _Whole(loop, N[kept], B.reshape(size, -1)[kept], free[kept], first[kept], rows, A_m, b_r)


def _reached(A: Array, B: Array, T: float) -> tuple[Array, Array]:
    """Columns (s, K) that a disturbance reaches by the end of a sample, and the weights (K, d) of its sizes for them."""
    if B.shape[1] == 0:
        return np.zeros((len(A), 0)), np.zeros((0, 0))
    s, count = B.shape
    starts = [SampledLoop(A, np.zeros((s, 1)), np.eye(s), np.zeros((1, s)), T).over(j * T / PARTS)[0] for j in range(PARTS)]
    off = T * grown(A, T) @ (grown(A, T / PARTS) - np.eye(s)) @ np.abs(B)  # of all parts together
    reached = np.hstack([*(start @ B for start in starts), np.eye(s)])
    weights = np.vstack([T / PARTS * np.tile(np.eye(count), (PARTS, 1)), off])
    return reached, weights


def _between(loop: SampledLoop, delay: float, M: Array) -> tuple[list[Array], list[Array], list[float]]:
    """At the ends of the parts of a sample X as rows of z, in each part A (A X + E v) at its start, and the parts' lengths."""
    s, size = len(loop.A), len(M)
    found = loop.effects(delay)
    whole, part = int(found.whole[0]), float(found.part[0])
    m = loop.inputs
    u = [np.hstack([loop.C, np.zeros((m, size - s))])]  # of this sample, then those before
    u += [np.eye(size)[s + (age - 1) * m : s + age * m] for age in range(1, (size - s) // m + 1)]
    switch = part * loop.T
    times = np.unique(np.concatenate([np.linspace(0, loop.T, PARTS + 1), [switch]]))
    X, ends, bends, lengths = np.eye(s, size), list[Array](), list[Array](), list[float]()
    for begin, end in pairwise(times):
        v = u[whole + 1] if end <= switch else u[whole]
        bends.append(loop.A @ (loop.A @ X + loop.E @ v))
        after, pushed = loop.over(end - begin)
        X = after @ X + pushed @ v
        ends.append(X)
        lengths.append(float(end - begin))
    return ends, bends, lengths


def _model_between(whole: _Whole, M: Array, lengths: list[float]) -> tuple[list[Array], list[Array]]:
    """The same of the model under the held command."""
    n, size = len(whole.A_m), len(M)
    X, R = np.eye(size)[whole.rows["x_m"]], np.eye(size)[whole.rows["r"]]
    model = SampledLoop(whole.A_m, whole.b_r, np.eye(n), np.zeros((1, n)), whole.loop.T)
    ends, bends = list[Array](), list[Array]()
    for h in lengths:
        bends.append(whole.A_m @ (whole.A_m @ X + whole.b_r @ R))
        after, pushed = model.over(h)
        X = after @ X + pushed @ R
        ends.append(X)
    return ends, bends


def missed(A: Array, b: Array, C: Array, r: Signal, T: float, t_end: float) -> float | NotApplicable:
    """At least |C W[r - r_held]| in every component up to t_end, W = (sI - A)^-1 b, r_held that of samples T apart.

    With r of slope at most L between jumps of at most J that are D apart it is at most

        ||C W||_1 L T + J T (||s C W||_1 + ||C W||_1/(D - T)):

    each jump is missed for at most T, and a sum of |h| at points D - T apart is at most its total variation, ||s C W||_1, and
    integral |h|/(D - T).
    """
    if not isinstance(r, SlopedSignal) or not isinstance(r, BoundedSignal):
        return NotApplicable("how far r goes within a sample is not known")
    whole = l1_norm(A, b, C, np.zeros((len(C), b.shape[1]))).upper
    rate = l1_norm(A, b, C @ A, C @ b).upper
    largest, apart = _jumps(r, T, t_end)
    jumping = largest * T * (rate + whole / (apart - T)) if apart > T else np.inf
    found = whole * r.slope * T + (jumping if largest > 0 else 0.0)
    return float(min(found, 2 * r.bound * whole)) * OUTWARD_FACTOR


def _jumps(r: Signal, T: float, t_end: float) -> tuple[float, float]:
    """The largest jump between samples, and how far such jumps are apart at least."""
    at = r.breaks(0.0, t_end) if isinstance(r, BreakingSignal) else np.zeros(0)
    at = at[np.abs(at - T * np.round(at / T)) > rounding_of(at)]
    sizes = np.abs(r(at) - r.before(at))
    at = at[sizes > 0]
    return float(sizes.max(initial=0.0)), float(np.diff(at).min(initial=np.inf))


def bounds_of(signals: tuple[Signal, ...]) -> Array:
    """Their sizes; InputError for one without a bound."""
    for signal in signals:
        if not isinstance(signal, BoundedSignal):
            raise InputError(f"{type(signal).__name__} has no known bound")
    return np.array([signal.bound for signal in signals if isinstance(signal, BoundedSignal)])
