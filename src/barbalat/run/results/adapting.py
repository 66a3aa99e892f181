"""Shows whether a controller adapts: excitation of the regressor, path of the estimates, and time on the projection bounds.

Motion between recorded instants is included: the distance is summed over every step, and the fraction of time on the bounds is
enclosed by extrema over every step. Only the excitation is an integral over recorded instants; the output says so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import column, symbols
from barbalat.loop.true_values import estimate_set
from barbalat.problem.known_set import EstimateSet, ParameterBox
from barbalat.roles import Estimating, hatted
from barbalat.run.results.findings import Finding
from barbalat.validate import Array

WINDOWS_OF_A_RUN = 40
"""Number of overlapping windows over a run."""


class Excitation(NamedTuple):
    """Persistent excitation: the smallest eigenvalue of 1/T times the integral of phi phi' over windows of length T.

    level        the smallest value over all windows, in squared units of the regressor
    tail         the value in the last quarter of the run
    conditioning the smallest eigenvalue in the tail when phi is scaled to unit mean square in each component: 0 ... 1
    fading       mean square of phi in the tail, relative to that of the window with the largest value
    window       T [s]
    sampling     effect of the record's decimation: the relative change of ``tail`` when every second instant is omitted, or the
                 mean square change of phi between instants relative to its mean square, whichever is larger
    """

    level: float
    tail: float
    conditioning: float
    fading: float
    window: float
    sampling: float


def excitation(t: Array, phi: Array) -> Excitation | None:
    """The excitation of a regressor (K, p, m) at the instants t (K,), in windows of a quarter of the run; None without a
    regressor."""
    if phi.shape[1] == 0 or len(t) < 16 or not np.isfinite(phi).all():
        return None
    window = float(t[-1] - t[0]) / 4
    starts = np.linspace(t[0], t[-1] - window, WINDOWS_OF_A_RUN)
    spans = [slice(*np.searchsorted(t, (start - 1e-9 * window, start + window * (1 + 1e-9)))) for start in starts]
    grams = [_gram(t[span], phi[span]) for span in spans]
    last = spans[-1]
    scale = np.sqrt(np.diag(grams[-1]))
    tail, half = _least(grams[-1]), _least(_gram(t[last][::2], phi[last][::2]))
    correlation = grams[-1] / np.outer(scale, scale) if (scale > 0).all() else np.zeros_like(grams[-1])
    change = abs(half - tail) / max(tail, half) if max(tail, half) > 0 else 0.0
    square = float(np.mean(phi[last] ** 2))
    rough = float(np.mean(np.diff(phi[last], axis=0) ** 2)) / square if square > 0 else 0.0
    squares = [float(np.trace(gram)) for gram in grams]
    fading = squares[-1] / max(squares) if max(squares) > 0 else 0.0
    return Excitation(min(map(_least, grams)), tail, _least(correlation), fading, window, max(change, rough))


def _gram(t: Array, phi: Array) -> Array:
    """1/T times the integral of phi phi' by the trapezoidal rule."""
    steps = np.diff(t)
    weights = np.concatenate([[0.0], steps]) + np.concatenate([steps, [0.0]])
    # no outer product is formed, because for a network it would fill the memory
    columns = phi.transpose(1, 0, 2).reshape(phi.shape[1], -1)
    return np.asarray((columns * np.repeat(weights, phi.shape[2])) @ columns.T / (2 * (t[-1] - t[0])))


def _least(gram: Array) -> float:
    return max(float(np.linalg.eigvalsh(gram)[0]), 0.0)  # a negative value is rounding


STILL_SHARE = 0.01
"""Fraction of the initial parameter error: estimates with a path shorter than this have not adapted visibly."""
LONG_SHARE = 0.5
SWEPT_SHARE = 0.1
"""Threshold, as a fraction of the time, for recorded intervals within which an estimate reaches both of its bounds."""
UNEXCITED_RATIO = 1e-6
"""Threshold of the smallest eigenvalue of the windowed correlation matrix, which is 1 for orthogonal components, and of a
relative mean square. It corresponds to an amplitude of a thousandth, below which a direction is not excited."""
COARSE_SAMPLING = 0.1
"""Admissible effect of the record's decimation on the excitation; twenty instants per period of the regressor are sufficient."""


class OnBounds(NamedTuple):
    """Fractions of the time, each (p,): lower and upper limit of the time on a bound, and the time in recorded intervals in which
    both bounds are reached.

    first  (p,) [s] the start of the first recorded interval in which a bound is reached; NaN if no bound is reached
    """

    least: Array
    most: Array
    swept: Array
    first: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Adapting:
    """How the estimates of a run move.

    net         (p,) final minus initial theta_hat
    path        (p,) sum of |change of theta_hat| over every step
    tail_path   (p,) path in the last quarter
    on_bounds   time on the bounds of a box, or of the intervals of unknown input gains (then zeros for theta); ``None`` without
                either
    on_sphere   fraction of the recorded instants on the surface of a ball; ``None`` without a ball
    excitation  ``None`` if the scheme has no regressor or the run is too short
    """

    net: Array
    path: Array
    tail_path: Array
    on_bounds: OnBounds | None
    on_sphere: float | None
    excitation: Excitation | None
    findings: tuple[Finding, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings for the user, as sentences."""
        return tuple(finding.sentence for finding in self.findings)

    @property
    def on_bounds_text(self) -> str:
        """The fraction of time on the bounds, a line for each estimate."""
        sphere = [] if self.on_sphere is None else [f"{100 * self.on_sphere:.0f} % of the instants"]
        shares = () if self.on_bounds is None else zip(self.on_bounds.least, self.on_bounds.most, strict=True)
        lines = [*(share_text(*share) for share in shares), *sphere]
        return "\n".join(lines) or "not projected"

    @property
    def excitation_text(self) -> str:
        """Level, window, and uniformity of the excitation over all directions."""
        if self.excitation is None:
            return "-"
        level, tail, conditioning, _, window, _ = self.excitation
        return f"{level:.3g} at least, {tail:.3g} in the tail, over {window:.3g} s; scaled {conditioning:.2g}"

    def as_json(self) -> dict[str, Any]:
        """Plain lists and numbers."""
        bounds, excitation = self.on_bounds, self.excitation

        def listed(values: Array) -> list[float | None]:
            return [None if np.isnan(value) else value for value in values.tolist()]

        return {
            "net": self.net.tolist(),
            "path": self.path.tolist(),
            "tail_path": self.tail_path.tolist(),
            "on_bounds": None if bounds is None else {name: listed(values) for name, values in bounds._asdict().items()},
            "on_sphere": self.on_sphere,
            "excitation": None if excitation is None else excitation._asdict(),
            "warnings": list(self.warnings),
        }


def adapting(
    loop: ClosedLoop,
    names: Sequence[str],
    t: Array,
    theta_hat: Array,
    extrema: tuple[Array, Array],
    moved: Array,
    phi: Array,
    theta: Array | None,
) -> Adapting:
    """Examine a record of K instants t [s] with theta_hat (K, p), its extrema and its path over the intervals, both (K - 1, p).

    The arguments are the names (p,) of the estimates without a hat, phi (K, p, m) from ``regressor_along``, and the true
    parameters theta (p,), or None
    """
    known_set = estimate_set(loop)
    tail = t[:-1] >= t[-1] - (t[-1] - t[0]) / 4 if len(t) > 1 else np.zeros(0, bool)
    path = moved.sum(axis=0)
    bounds, sphere = _at_the_edge(known_set, t, theta_hat, extrema)
    found = excitation(t, phi)
    return Adapting(
        net=theta_hat[-1] - theta_hat[0],
        path=path,
        tail_path=moved[tail].sum(axis=0),
        on_bounds=bounds,
        on_sphere=sphere,
        excitation=found,
        findings=tuple(
            _findings(
                [*map(hatted, names)],
                path,
                0.0 if theta is None else float(np.linalg.norm(theta_hat[0] - theta)),
                bounds,
                sphere,
                found,
            )
        ),
    )


def _at_the_edge(
    known_set: EstimateSet | None, t: Array, theta_hat: Array, extrema: tuple[Array, Array]
) -> tuple[OnBounds | None, float | None]:
    """The time on the faces of a box, and on a sphere; with a ball or no set, the input gains have separate faces."""
    bounds, sphere = None, None
    if known_set is not None and known_set.intervals is not None and len(t) > 1:
        first = theta_hat.shape[1] - known_set.intervals.size
        own = on_bounds(known_set.intervals, t, *(side[:, first:] for side in extrema))
        of_theta = (np.zeros(first), np.zeros(first), np.zeros(first), np.full(first, np.nan))
        bounds = OnBounds(*(np.concatenate(both) for both in zip(of_theta, own, strict=True)))
    if known_set is not None and (ball := known_set.sphere) is not None:
        away = np.linalg.norm(theta_hat[:, : ball.size] - ball.center, axis=1)
        sphere = float(np.mean(away >= ball.radius * (1 - 1e-9)))  # the projection's roundings
    return bounds, sphere


def regressor_along(loop: ClosedLoop, states: Array, measured: Array, u: Array) -> Array:
    """(K, p, m) the regressor at K recorded states (K, size); (K, 0, 0) for a scheme that provides none.

    ``measured`` (K, n) or, for an output, (K,), and the controls u at the same instants.
    """
    equations = loop.continuous  # a sampled scheme has the regressor of the continuous scheme
    if not isinstance(equations, Estimating):
        return np.zeros((len(states), 0, 0))
    import casadi as ca

    state_column, flat = symbols("state", loop.size)
    input_column, v = symbols("u", loop.inputs)
    output_column, y = symbols("measured", measured.size // len(states))
    state = loop.unpack(flat)
    received = loop.received(state, y if measured.ndim > 1 else y[0])
    phi = equations.regressor_at(state.controller, received, v[0] if loop.inputs == 1 else v)
    function = ca.Function("regressor", [state_column, output_column, input_column], [column(phi.reshape(-1))])
    values = np.asarray(function(states.T, measured.reshape(len(states), -1).T, u.reshape(len(states), -1).T)).T
    return values.reshape(len(states), phi.shape[0], -1)


def observed_along(loop: ClosedLoop, states: Array, measured: Array) -> Array | None:
    """(K, n) an observer's estimate of the state at K recorded states (K, size), from the noise-free measurements ``measured``
    (K, n); for a sampled controller, from its last sample including noise. None without an observer."""
    if loop.observer is None:
        return None
    import casadi as ca

    state_column, flat = symbols("state", loop.size)
    output_column, x = symbols("measured", measured.shape[1])
    seen = loop.received(loop.unpack(flat), x)[: measured.shape[1]]
    function = ca.Function("observed", [state_column, output_column], [column(seen.reshape(-1))])
    return np.asarray(function(states.T, measured.T)).T


def on_bounds(box: ParameterBox, t: Array, low: Array, high: Array) -> OnBounds:
    """The time on bounds, from the estimates' extrema (K - 1, p) over the intervals between the instants t (K,).

    The estimate is on a bound throughout an interval if its minimum there is the upper bound or its maximum is the lower bound.
    It may be on a bound at some instants if an extremum touches a bound.
    """
    weights = np.diff(t) / (t[-1] - t[0])
    at_upper, at_lower = high >= box.upper, low <= box.lower
    throughout = (low >= box.upper) | (high <= box.lower)
    fixed = box.lower == box.upper  # the bounds coincide: nothing is estimated
    met = at_upper | at_lower
    shares = (throughout, met, at_upper & at_lower & ~throughout)
    first = np.where(met.any(axis=0) & ~fixed, t[met.argmax(axis=0)], np.nan)
    # the rounding errors of the weights add up
    least, most, swept = (np.where(fixed, 0.0, np.minimum(weights @ share, 1.0)) for share in shares)
    return OnBounds(least, most, swept, first)


def _findings(
    names: Sequence[str], path: Array, error: float, bounds: OnBounds | None, sphere: float | None, found: Excitation | None
) -> list[Finding]:
    """One finding for each warning to the user."""
    findings = []
    if error > 0 and np.linalg.norm(path) < STILL_SHARE * error:
        share = f"{np.linalg.norm(path) / error:.1g}"
        findings.append(Finding("still", f"it hardly adapts: the estimates' total path is {share} of their initial error"))
    if bounds is not None:
        for name, least, most, swept, _ in zip(names, *bounds, strict=True):
            if swept > SWEPT_SHARE:
                often = f"within single recorded intervals {100 * swept:.0f} % of the time"
                findings.append(Finding("between bounds", f"{name} reaches both of its bounds {often}"))
            elif least > LONG_SHARE:
                often = f"{share_text(least, most)} of the time"
                findings.append(Finding("on bounds", f"{name} is at its projection bounds {often}"))
    if sphere is not None and sphere > LONG_SHARE:
        often = f"at {100 * sphere:.0f} % of the recorded instants"
        findings.append(Finding("on bounds", f"the estimates are on the surface of the known set {often}"))
    said = None if found is None else _said_of(found)
    return findings if said is None else [*findings, said]


def _said_of(found: Excitation) -> Finding | None:
    """The warning about the excitation, if any."""
    if found.fading < UNEXCITED_RATIO:
        faded = f"its mean square in the tail is {found.fading:.1g} of its largest value"
        return Finding("excitation", f"the regressor has died out: {faded}")
    if found.conditioning < UNEXCITED_RATIO:
        return Finding(
            "excitation",
            f"in the tail the regressor does not excite every direction (scaled level {found.conditioning:.1g})"
            ": the estimates need not converge to the true values",
        )
    if found.sampling > COARSE_SAMPLING:
        coarse = (
            "the record is too coarse for the regressor, so the excitation level is uncertain. Increase simulation.record_points"
        )
        return Finding("coarse record", coarse)
    return None


def share_text(least: float, most: float) -> str:
    """The text for a fraction of time that is known to lie between two numbers, rounded outward."""
    low, high = math.floor(100 * least), math.ceil(100 * most)
    return f"{low} %" if low == high else f"{low} to {high} %"
