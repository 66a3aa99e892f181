"""Bounds, valid at all times, on the response of a sampled linear loop to commands and disturbances of known sizes, from sums of
impulse responses.

Plant, actuator, sensor lag, delay, controller and the model under the sampled command are one linear system from sample to
sample. With z the state of the loop just after a sample, including the held command and the values of u in the delay,

    z[k+1] = M z[k] + N r[k+1] + J integral_0^T e^(A (T - s)) B d(t_k + s) ds.

The largest effect of r on a row C z is the sum of |C M^i N|, for every sequence within its size, plus the largest |C M^i (z_1 -
N)| if the first command has the effect z_1 instead of N. For d, only its bound is used.
Over a part of the sample of length T/P, e^(A s) B differs from its value at the start of the part by at most e^(|A| T) (e^(|A|
T/P) - I) |B|.

Between samples the motion under the held inputs is known at the ends of the parts and where the delayed input switches. Within a
part of length h it differs from the straight line between its ends by at most h^2/8 times |x''| <= e^(|A| h) |A (A x + E v)|. The
contribution of d within a sample is at most its effect on a row at the end of the sample or of the part.

The model also follows r between the samples; ``missed`` bounds this difference.

An error of the measurement at a sample, from a quantised sensor or from noise with a bound, enters as W w[k+1], and as W_0 w[0]
at the first sample. Its effect on a row C z is at most sum |C M^i W| + max |C M^i (W_0 - W)| times its size; without W_0 the sum
alone. A converter adds at most half its step to u, as a disturbance does.

Noise whose samples are independent enters in the same way. After k samples a row C z then has the variance
sum_(i < k) |C M^i W|^2 + |C M^k W_0|^2; the triangle inequality holds for standard deviations as well, so the argument covers the
time between samples.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from barbalat.certificates.entry import NotApplicable
from barbalat.certificates.linear_loops.at_rest import estimates_of, rows_of, without_limits
from barbalat.linear.enclosure import OUTWARD_FACTOR
from barbalat.linear.l1_norms import l1_norm
from barbalat.linear.sampled_loop import SampledLoop
from barbalat.linear.sampled_norms import BLOCK_SAMPLES, MOST_PROVEN, SampledNorms, contraction_witness, grown
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import jacobian_function, sampled_jacobian_function
from barbalat.problem.measurement import Sensor
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import BoundedSignal, BreakingSignal, Controller, Signal, SlopedSignal
from barbalat.signals.piecewise import rounding_of
from barbalat.validate import Array, InputError

PARTS = 16
"""Number of parts of a sample; the motion is exact at their ends."""
BENDS = PARTS, 4, 1
"""Numbers of parts that share a bound on x'' in a proof; the fewer bounds there are, the faster the proof is checked."""
MORE_SAMPLES = 1.0, 1.25, 1.6, 2.0, 3.0
"""Numbers of samples that a proof may follow, as multiples of the number that the bound needs."""
ROUNDINGS, ROOM = 1 + 1e-9, 1 + 5e-10
"""Factors that cover the rounding errors of the sums in a bound, and those of the check whether a proof shows it."""
TRAPEZOIDS = 4
"""Number of parts into which a proof divides a sample to bound the effect of a disturbance."""


class Response(NamedTuple):
    """Bounds on every component at all times.

    held     |x - x_m|, where x_m is the state of the model under the sampled command
    x        |x|
    u        |u|, before any limit
    """

    held: float
    x: float
    u: float


class Deviation(NamedTuple):
    """Standard deviations due to measurement noise, at all times.

    x  (n,) standard deviation of x, and so of x - x_m, because the model has no noise
    u  (m,) standard deviation of u, before any limit
    """

    x: Array
    u: Array


@dataclass(frozen=True, eq=False)
class _Whole:
    """The loop with its model and the held command; ``rows`` names the entries of z."""

    loop: SampledLoop
    N: Array  # (z, q) effect of a command in a sample
    B: Array  # (z, d) directions of the disturbances, and of the errors of converters
    W: Array  # (z, p) effect of an error of the measurement at a sample, of size 1 in each measured quantity
    first_W: Array  # (z, p) the same at the first sample
    free: Array  # (z,) state after the first sample without a command
    first: Array  # (z, q) effect of the first command on that state
    rows: dict[str, Array]
    A_m: Array
    b_r: Array  # (n, q)

    @property
    def apart(self) -> Array:
        """(z, p) the difference that the first sample makes to the effect of an error of the measurement."""
        return self.first_W - self.W if self.first_W.any() else self.first_W


class Sizes(NamedTuple):
    """The largest values of what acts on the loop.

    r  (q,) commands
    d  (d,) disturbances, and errors of the converters at the inputs that have one
    w  (p,) errors of the measurement at a sample
    """

    r: Array
    d: Array
    w: Array

    @classmethod
    def of(cls, problem: Problem, *, noisy: bool = True) -> Sizes:
        """The sizes in a case, without noise that has no bound; without any noise unless ``noisy``. Raises InputError if a signal
        has no bound."""
        sensor = problem.sensor or Sensor()
        if not noisy or (sensor.noise is not None and sensor.noise.bound is None):
            sensor = replace(sensor, noise=None)
        w = sensor.largest_error(problem.measured)
        assert w is not None
        rounded = [path.quantization / 2 for path in problem.plant.paths if path.quantization is not None]
        return cls(bounds_of(problem.commands), np.array([*bounds_of(disturbances(problem)), *rounded]), w)


def response(problem: Problem, controller: Controller, sizes: Sizes) -> Response:
    """Bounds for signals of these sizes. Raises InputError if the loop decays too slowly."""
    return _response(problem, _whole(problem, controller), sizes)


def _response(problem: Problem, whole: _Whole, sizes: Sizes, bends: int | None = None, proven: int | None = None) -> Response:
    """The bounds; with ``bends``, those that ``barbalat-check`` finds if this number of parts share a bound on x'' and it follows
    ``proven`` samples."""
    loop, M, (r, d, w) = whole.loop, whole.loop.closed(problem.delay), sizes
    reached, weights = (_reached if bends is None else _trapezoids)(loop.A, whole.B, loop.T)

    def largest(C: Array) -> Array:
        norms, free = SampledNorms(M, C, proven), _padded(whole.free[:, None], M)
        of_r = norms.summed(_padded(whole.N, M)) + norms.largest(_padded(whole.first - whole.N, M))
        found = of_r @ r + norms.largest(free)[:, 0]
        if len(d):
            found = found + norms.summed(_padded(loop.J @ reached, M)) @ (weights @ d)
        if w.any():
            found = found + (norms.summed(_padded(whole.W, M)) + norms.largest(_padded(whole.apart, M))) @ w
        return np.asarray(found * OUTWARD_FACTOR)

    within = np.abs(reached[whole.rows["x"]]) @ weights @ d if len(d) else np.zeros(len(whole.A_m))
    held, x, u = _at_all_times(whole, problem.delay, M, largest, bends or 1)
    outward = ROUNDINGS if bends is None else OUTWARD_FACTOR
    return Response(*(float(one.max()) * outward for one in (held + within, x + within, u)))


def noise_deviation(problem: Problem, controller: Controller) -> Deviation:
    """Bounds on the effect of the measurement noise of the case, if its samples are independent.

    Without the first sample, whose effect differs, the covariance of the response would grow from zero to the covariance of
    sum_k M^k W w. Raises InputError if the loop decays too slowly.
    """
    whole, noise = _whole(problem, controller), problem.noise
    assert noise is not None
    M, std = whole.loop.closed(problem.delay), noise.std * np.ones(problem.measured)

    def deviation(C: Array) -> Array:
        found = SampledNorms(M, C).deviation(*(_padded(one * std, M) for one in (whole.W, whole.first_W)))
        return np.asarray(np.linalg.norm(found, axis=1) * OUTWARD_FACTOR)

    _, x, u = _at_all_times(whole, problem.delay, M, deviation)
    return Deviation(x * OUTWARD_FACTOR, u * OUTWARD_FACTOR)


def _padded(part: Array, M: Array) -> Array:
    """Columns of the loop's state, with zeros for the inputs in the delay."""
    return np.vstack([part, np.zeros((len(M) - len(part), part.shape[1]))])


def _at_all_times(
    whole: _Whole, delay: float, M: Array, size_of: Callable[[Array], Array], shared: int = 1
) -> tuple[Array, Array, Array]:
    """Bounds on x - x_m, x (n,) and u (m,), including the time between samples, from the sizes (p,) of rows C (p, z) of the state
    at samples.

    A size is a norm of the response of a row, so the norm of a sum is at most the sum of the norms. ``shared`` parts of a sample
    have one bound on x'', whose growth is at most e^(|A| t).
    """
    x, x_m = whole.rows["x"], whole.rows["x_m"]
    at_ends, bends, lengths, switched = _between(whole.loop, delay, M)
    firsts = [max(k - k % shared, switched if k >= switched else 0) for k in range(len(lengths))]
    of_model, bends_of_model = _model_between(whole, M, lengths)
    start = np.eye(len(M))
    ends, models = [start[x], *(end[x] for end in at_ends)], [start[x_m], *of_model]
    differences = [end - model for end, model in zip(ends, models, strict=True)]
    groups = [differences, ends, bends, bends_of_model, [whole.loop.broken(delay)[2]]]
    blocks = [block for group in groups for block in group]
    found = iter(np.split(size_of(np.vstack(blocks)), np.cumsum([len(block) for block in blocks])[:-1]))
    away, far, bent, bent_model, (u,) = ([next(found) for _ in group] for group in groups)
    held, of_x = away[0], far[0]
    for k, h in enumerate(lengths):
        first = firsts[k]
        since = sum(lengths[first : k + 1])
        curved = h**2 / 8 * (grown(whole.loop.A, since) @ bent[first])[x]
        curved_model = h**2 / 8 * (grown(whole.A_m, since) @ bent_model[first])
        held = np.maximum(held, np.maximum(away[k], away[k + 1]) + curved + curved_model)
        of_x = np.maximum(of_x, np.maximum(far[k], far[k + 1]) + curved)
    return held, of_x, u


def _whole(problem: Problem, controller: Controller) -> _Whole:
    """The loop from the exact Jacobians of the equations, which are constant for a linear loop."""
    closed = ClosedLoop.of(problem, controller)
    closed = replace(without_limits(closed), noise_std=np.ones(problem.measured), noise_bound=None)
    if closed.clocked:
        raise InputError("the plant depends on time, but the theorem holds only for time-invariant plants")
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
    settings = [row for row in estimates if (J[row] == np.eye(size)[row]).all()]  # given numbers that stay constant
    q = sizes.commands or 1
    units = np.eye(count)
    N = np.column_stack([np.asarray(closed.sample(zero, units[j])) - np.asarray(closed.sample(zero, signals)) for j in range(q)])
    free = np.asarray(closed.sample(start, signals), dtype=float)
    first = np.column_stack([np.asarray(closed.sample(start, units[j])) - free for j in range(q)])
    acting = range(q, q + sizes.matched + sizes.unmatched)
    B = np.array([np.asarray(closed.derivative(zero, units[j])) - np.asarray(closed.derivative(zero, signals)) for j in acting]).T
    noisy = range(sizes.timed, sizes.timed + sizes.noise)
    W = np.array([np.asarray(closed.sample(zero, units[j])) - np.asarray(closed.sample(zero, signals)) for j in noisy]).T
    first_W = np.array([np.asarray(closed.sample(start, units[j])) - free for j in noisy]).T
    out = [*places.x_m, int(held.started), *np.reshape(held.theta_hat, -1).tolist(), *settings]
    kept = np.setdiff1d(np.arange(size), np.array(out, dtype=int))
    where = np.full(size, -1)
    where[kept] = np.arange(len(kept))
    rows = {"x": where[places.x], "x_m": where[held.x_m], "r": where[np.reshape(held.r, -1)], "sensor": where[places.sensor]}
    inputs, between, C = np.reshape(held.u, -1), slopes.copy(), np.eye(size)[np.reshape(held.u, -1)]
    between[:, inputs] = 0.0
    inner = np.ix_(kept, kept)
    assert closed.sample_time is not None
    loop = SampledLoop(between[inner], slopes[np.ix_(kept, inputs)], J[inner], C[:, kept], closed.sample_time)
    A_m, b_r, _ = problem.model.matrices
    converted = [i for i, path in enumerate(problem.plant.paths) if path.quantization is not None]
    B = np.hstack([B.reshape(size, -1)[kept], loop.E[:, converted]])
    return _Whole(loop, N[kept], B, W[kept], first_W[kept], free[kept], first[kept], rows, A_m, b_r)


def _reached(A: Array, B: Array, T: float) -> tuple[Array, Array]:
    """Columns (s, K) that a disturbance reaches by the end of a sample, and the weights (K, d) of its sizes for these columns."""
    if B.shape[1] == 0:
        return np.zeros((len(A), 0)), np.zeros((0, 0))
    s, count = B.shape
    starts = [SampledLoop(A, np.zeros((s, 1)), np.eye(s), np.zeros((1, s)), T).over(j * T / PARTS)[0] for j in range(PARTS)]
    off = T * grown(A, T) @ (grown(A, T / PARTS) - np.eye(s)) @ np.abs(B)  # states of all parts together
    reached = np.hstack([*(start @ B for start in starts), np.eye(s)])
    weights = np.vstack([T / PARTS * np.tile(np.eye(count), (PARTS, 1)), off])
    return reached, weights


def _trapezoids(A: Array, B: Array, T: float) -> tuple[Array, Array]:
    """The same with fewer columns: by the trapezoidal rule for |e^(A s) B|, and h^2/12 times a bound on |e^(A s) A^2 B|."""
    if B.shape[1] == 0:
        return np.zeros((len(A), 0)), np.zeros((0, 0))
    s, count = B.shape
    system = SampledLoop(A, np.zeros((s, 1)), np.eye(s), np.zeros((1, s)), T)
    reached = [*(system.over(j * T / TRAPEZOIDS)[0] @ B for j in range(TRAPEZOIDS + 1)), np.eye(s)]
    each = [T / TRAPEZOIDS * (0.5 if j in (0, TRAPEZOIDS) else 1.0) * np.eye(count) for j in range(TRAPEZOIDS + 1)]
    return np.hstack(reached), np.vstack([*each, T**3 / (12 * TRAPEZOIDS**2) * grown(A, T) @ np.abs(A @ A @ B)])


def _between(loop: SampledLoop, delay: float, M: Array) -> tuple[list[Array], list[Array], list[float], int]:
    """X at the ends of the parts of a sample, as rows of z; A (A X + E v) at the start of each part, the lengths of the parts,
    and the first part after the delayed input has switched."""
    s, size = len(loop.A), len(M)
    found = loop.effects(delay)
    whole, part = int(found.whole[0]), float(found.part[0])
    m = loop.inputs
    u = [np.hstack([loop.C, np.zeros((m, size - s))])]  # controls of this sample, followed by the previous ones
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
    return ends, bends, lengths, int(np.searchsorted(times, switch))


def _model_between(whole: _Whole, M: Array, lengths: list[float]) -> tuple[list[Array], list[Array]]:
    """The motion between samples for the model under the held command."""
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
    """A bound on |C W[r - r_held]| in every component up to t_end, with W = (sI - A)^-1 b and r_held held for samples T apart.

    If r has at most the slope L between jumps of at most J that are D apart, it is at most

        ||C W||_1 L T + J T (||s C W||_1 + ||C W||_1/(D - T)):

    because each jump is missed for at most T, and a sum of |h| at points D - T apart is at most its total variation, ||s C W||_1,
    plus integral |h|/(D - T).
    """
    if not isinstance(r, SlopedSignal) or not isinstance(r, BoundedSignal):
        return NotApplicable("the variation of r within a sample is not known")
    whole = l1_norm(A, b, C, np.zeros((len(C), b.shape[1]))).upper
    rate = l1_norm(A, b, C @ A, C @ b).upper
    largest, apart = _jumps(r, T, t_end)
    jumping = largest * T * (rate + whole / (apart - T)) if apart > T else np.inf
    found = whole * r.slope * T + (jumping if largest > 0 else 0.0)
    return float(min(found, 2 * r.bound * whole)) * OUTWARD_FACTOR


def _jumps(r: Signal, T: float, t_end: float) -> tuple[float, float]:
    """The largest jump between samples, and the smallest distance between such jumps."""
    at = r.breaks(0.0, t_end) if isinstance(r, BreakingSignal) else np.zeros(0)
    at = at[np.abs(at - T * np.round(at / T)) > rounding_of(at)]
    sizes = np.abs(r(at) - r.before(at))
    at = at[sizes > 0]
    return float(sizes.max(initial=0.0)), float(np.diff(at).min(initial=np.inf))


def bounds_of(signals: tuple[Signal, ...]) -> Array:
    """The bounds of the signals; raises InputError if the signal has no bound."""
    for signal in signals:
        if not isinstance(signal, BoundedSignal):
            raise InputError(f"{type(signal).__name__} has no known bound")
    return np.array([signal.bound for signal in signals if isinstance(signal, BoundedSignal)])


def grounds(problem: Problem, controller: Controller, t_end: float) -> dict[str, Any]:
    """The data of the loop for ``barbalat-check``: its matrices, and the motion of the commands between samples."""
    whole, T = _whole(problem, controller), float(controller.sample_time)  # type: ignore[attr-defined]
    loop, effects = whole.loop, whole.loop.effects(problem.delay)
    parts = {
        "A": loop.A,
        "E": loop.E,
        "J": loop.J,
        "C": loop.C,
        "N": whole.N,
        "first": whole.first,
        "B": whole.B,
        "W": whole.W,
        "first_W": whole.first_W,
        "b_r": whole.b_r,
    }
    between = [
        {"slope": one.slope, "jump": jump, "apart": apart if math.isfinite(apart) else None}
        if isinstance(one, SlopedSignal) and math.isfinite(one.slope) and (apart > T or jump == 0)
        else None
        for one in problem.commands
        for jump, apart in (_jumps(one, T, t_end),)
    ]
    facts: dict[str, Any] = {name: np.asarray(part, dtype=float).tolist() for name, part in parts.items()}
    facts |= {"free": whole.free[:, None].tolist(), "T": T, "whole": int(effects.whole[0]), "part": float(effects.part[0])}
    rows = {name: np.asarray(row).tolist() for name, row in whole.rows.items()}
    return {"scheme": "sampled", "sampled": facts | {"rows": rows}, "between": between}


def witness(problem: Problem, controller: Controller) -> dict[str, Any]:
    """P, the number of samples that bound the remainder of a sum, and the number of parts of a sample that share a bound on x''.

    Raises InputError if the loop decays too slowly, or if the bounds do not follow.
    """
    whole = _whole(problem, controller)
    M, counts = whole.loop.closed(problem.delay), list[int]()
    reached = whole.loop.J @ _trapezoids(whole.loop.A, whole.B, whole.loop.T)[0]
    sizes = Sizes.of(problem)
    starts = [whole.free[:, None], whole.first - whole.N, whole.N, *([reached] if reached.size else [])]
    starts += [whole.W, whole.apart] if sizes.w.any() else []

    def followed(C: Array) -> Array:
        counts.extend(SampledNorms(M, C).samples(_padded(one, M)) for one in starts)
        return np.zeros(len(C))

    _at_all_times(whole, problem.delay, M, followed)
    needed = max(counts)
    if needed > MOST_PROVEN:
        raise InputError(f"a proof would need {needed} samples, more than the limit of {MOST_PROVEN}")
    claimed = np.array(_response(problem, whole, sizes))
    found = contraction_witness(M)
    blocks = [min(math.ceil(needed * more / BLOCK_SAMPLES), MOST_PROVEN // BLOCK_SAMPLES) for more in MORE_SAMPLES]

    def follows(bends: int, samples: int) -> bool:
        return bool((np.array(_response(problem, whole, sizes, bends, samples)) * ROOM <= claimed).all())

    for bends in BENDS:
        if follows(bends, blocks[-1] * BLOCK_SAMPLES):  # the more samples are followed, the lower the bounds
            samples = next(one * BLOCK_SAMPLES for one in blocks if follows(bends, one * BLOCK_SAMPLES))
            return found | {"samples": samples, "bends": bends}
    raise InputError("no witness of this form was found that shows its bounds")


def disturbances(problem: Problem) -> tuple[Signal, ...]:
    """The disturbances in the loop's order of signals."""
    return (*(() if problem.disturbance is None else (problem.disturbance,)), *(one.signal for one in problem.unmatched))
