"""The plant x' = A x + B u from a recording: least squares, the set of all explanations, evidence on validation samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import optimize, stats

from barbalat import budget, validate
from barbalat.budget import Estimate
from barbalat.identify.known_set import EPS, Enclosure, Windows, enclose
from barbalat.identify.recording import LEAST_SAMPLES, Recording, read_csv
from barbalat.linear.zero_order_hold import HeldSystem
from barbalat.validate import Array, InputError

DEFAULT_HELD_OUT = 0.25
CONFIDENCE = 0.95
MOST_WINDOWS = 400
"""Of each length: more windows hardly narrow the set, and the linear programmes grow with them."""
LEAST_ROWS = 4
"""Rows of least squares for each coefficient."""
BLIND = 1e-6
"""Share of a direction that the regressors do not excite above which a coefficient belongs to it; the rest is rounding."""
WINDOW = Estimate(memory=2e3, seconds=2e-4)
"""The cost of a window and its share of a linear programme."""


@dataclass(frozen=True, eq=False)
class Row:
    """The result for one state's row: its coefficients are those of the states, then of the inputs.

    estimate, interval (p,), (p, 2)  of least squares, with the confidence of ``CONFIDENCE``, infinite for a coefficient that the
                                     data do not excite; None for a given row
    nominal (p,)                     least squares, within the set's box or else ``limits`` if the free least squares lie outside
    limits (p, 2)                    the bounds given by ``within``, infinite if there are none; None without ``within``
    enclosure                        contains every row that explains the data; None without noise bounds
    unexcited                        directions of coefficients, (p,) each, that the data do not distinguish
    """

    state: str
    nominal: Array
    estimate: Array | None = None
    interval: Array | None = None
    enclosure: Enclosure | None = None
    unexcited: tuple[Array, ...] = ()
    limits: Array | None = None

    @property
    def ranges(self) -> Array:
        """(p, 2): the set's box, or else the confidence intervals within ``limits`` with the nominal row, or a given row."""
        if self.enclosure is not None:
            return np.column_stack([self.enclosure.lower, self.enclosure.upper])
        if self.interval is None:
            return np.column_stack([self.nominal] * 2)
        if self.limits is None:
            return self.interval
        inside = np.clip(self.interval, self.limits[:, :1], self.limits[:, 1:])
        return np.column_stack([np.minimum(inside[:, 0], self.nominal), np.maximum(inside[:, 1], self.nominal)])


@dataclass(frozen=True, eq=False)
class Identification:
    """The result of ``identify``; ``case_text`` writes it as a case file.

    fit         by state, on the validation samples: 1 - |y - simulated| / |y - mean|, with the nominal plant simulated from their
                start; None if it diverged
    restarted   an unstable nominal plant is simulated for at most this number of samples and then restarted from the measured
                state: an error at the start grows by a factor of e at most; None if the simulation is never restarted
    held_fit    with restarts, the fit of a prediction that holds the measured state from each restart to the next
    predicted   (N, n), the nominal plant's states over the validation samples; at a restart the end of the earlier prediction
    by states: the factor by which the error bounds would have to grow for the nominal plant to explain the validation windows
    """

    recording: Recording
    rows: tuple[Row, ...]
    noise: Mapping[str, float] | None
    slope: Mapping[str, float] | None
    trained: int
    predicted: Array
    fit: Mapping[str, float | None]
    held_factor: Mapping[str, float] | None
    restarted: int | None = None
    held_fit: Mapping[str, float] | None = None

    @property
    def horizon(self) -> float | None:
        """The longest prediction between restarts [s], for the mean sampling interval; None without restarts."""
        return None if self.restarted is None else self.restarted * _mean_interval(self.recording)

    @property
    def A(self) -> Array:
        """(n, n), nominal."""
        return np.array([row.nominal[: len(self.rows)] for row in self.rows])

    @property
    def B(self) -> Array:
        """(n, m), nominal."""
        return np.array([row.nominal[len(self.rows) :] for row in self.rows])

    @property
    def residuals(self) -> Array:
        """(N, n), measured minus simulated, over the validation samples; not finite if the nominal plant diverged."""
        with np.errstate(invalid="ignore", over="ignore"):
            return self.recording.outputs[len(self.recording.times) - len(self.predicted) :] - self.predicted

    @property
    def guaranteed(self) -> bool:
        """Whether the ranges contain every plant that explains the data: there are error bounds, and the set is bounded."""
        return self.noise is not None and all(np.isfinite(row.ranges).all() for row in self.rows)

    @property
    def coefficient_names(self) -> tuple[str, ...]:
        return (*self.recording.output_names, *self.recording.input_names)

    @property
    def findings(self) -> list[str]:
        """Findings to be known before the numbers are used."""
        said = []
        for row in self.rows:
            for direction in row.unexcited:
                terms = [
                    f"{value:+.2g} {name}"
                    for value, name in zip(direction, self.coefficient_names, strict=True)
                    if abs(value) > 0.05
                ]
                said.append(
                    f"the data do not excite {' '.join(terms)} in the row of {row.state}'"
                    ": that combination stays within its error in every window, so it cannot be bounded; excite it, or give "
                    "bounds by within"
                )
            if row.estimate is not None and not np.array_equal(row.nominal, row.estimate):
                outside = "the known set" if row.enclosure is not None else "the bounds of within"
                said.append(f"the least squares of {row.state}' lie outside {outside}: its nominal row is the best one inside")
            if row.enclosure is not None and not row.enclosure.exact:
                said.append(f"the set of {row.state}' is a convex outer set: more noisy regressors than are searched by orthants")
        where = "held-out samples" if self.trained < len(self.recording.times) else "samples"
        said += self._poor_predictions(where)
        for name, factor in (self.held_factor or {}).items():
            if factor > 1:
                said.append(f"the nominal row of {name}' explains the {where} only with error bounds {factor:.3g} times larger")
        if self.noise is None:
            cut = "" if all(row.limits is None for row in self.rows) else " within the bounds of within"
            said.append(
                f"no noise bound was given: the ranges are {CONFIDENCE:.0%} confidence intervals{cut}, which are not guaranteed"
            )
        return said

    def _poor_predictions(self, where: str) -> list[str]:
        """The states that the nominal plant predicts worse than their mean, or with restarts than their value at the restart."""
        least = self.held_fit or dict.fromkeys(self.fit, 0.0)
        poor = ", ".join(name for name, fit in self.fit.items() if fit is None or fit < least.get(name, 0.0))
        states = "the outputs may not be the whole state (to encoders' angles add their rates), the plant may not be linear, or "
        if not poor:
            return []
        if self.horizon is None:
            return [
                f"simulated over the {where}, the nominal plant predicts {poor} worse than their mean does: {states}it may "
                "accumulate errors as an integrator does"
            ]
        return [
            f"over {self.horizon:.3g} s of the {where}, the nominal plant predicts {poor} worse than a state that is held from "
            f"the last restart: {states}the noise may exceed the motion over this time"
        ]

    def as_json(self) -> dict[str, Any]:
        """The document of ``identify --json``."""
        rows = {}
        for row in self.rows:
            ranges = [_ends(pair) for pair in row.ranges]
            rows[row.state] = {
                "nominal": dict(zip(self.coefficient_names, map(float, row.nominal), strict=True)),
                "known_set": dict(zip(self.coefficient_names, ranges, strict=True)) if self.noise is not None else None,
                "least_squares": None
                if row.estimate is None or row.interval is None
                else {
                    name: {"value": float(value), "interval": _ends(pair), "confidence": CONFIDENCE}
                    for name, value, pair in zip(self.coefficient_names, row.estimate, row.interval, strict=True)
                },
                "exact_set": None if row.enclosure is None else row.enclosure.exact,
                "given": row.estimate is None,
            }
        return {
            "samples": len(self.recording.times), "trained": self.trained, "rows": rows, "guaranteed": self.guaranteed,
            "noise": self.noise and dict(self.noise), "slope": self.slope and dict(self.slope),
            "held_out": {
                "fit": dict(self.fit), "error_factor": self.held_factor and dict(self.held_factor),
                "restart_every": self.restarted, "horizon": self.horizon,
                "fit_of_held_state": self.held_fit and dict(self.held_fit),
            },
            "residuals": self._residuals_as_json(),
            "findings": self.findings,
        }  # fmt: skip

    def _residuals_as_json(self) -> dict[str, Any]:
        """Measured minus simulated over the validation samples, with their RMS and largest value."""
        found: dict[str, Any] = {"t": self.recording.times[len(self.recording.times) - len(self.predicted) :].tolist()}
        for name, values in zip(self.recording.output_names, self.residuals.T, strict=True):
            bounded = bool(np.isfinite(values).all())
            found[name] = {
                "rms": float(np.sqrt(np.mean(values**2))) if bounded else None,
                "max_abs": float(np.abs(values).max()) if bounded else None,
                "values": [float(value) if np.isfinite(value) else None for value in values],
            }
        return found


def _ends(pair: Array) -> list[float | None]:
    """The ends of a range, None where it has no bound."""
    return [float(value) if np.isfinite(value) else None for value in pair]


def identify(
    data: str | Path | Recording,
    inputs: Sequence[str] = (),
    outputs: Sequence[str] = (),
    *,
    time: str | None = None,
    noise: Mapping[str, float] | None = None,
    slope: Mapping[str, float] | None = None,
    derivatives: Mapping[str, str] | None = None,
    within: Mapping[tuple[str, str], tuple[float, float]] | None = None,
    held_out: float = DEFAULT_HELD_OUT,
) -> Identification:
    """Identify x' = A x + B u from samples of all states x, with inputs held from sample to sample.

    data         a CSV file with a line of names, of which ``inputs``, ``outputs`` and ``time`` name columns, or a Recording
    noise        by output: a bound of the measurement error. With ``slope`` it gives the set of all plants that explain the data
    slope        by output: a bound of |x'| over the recording [unit/s]; it bounds the error of the trapezoidal rule
    derivatives  by output: the output that is its exact derivative; that row is not identified
    within       by (state, name): known bounds of the coefficient of ``name`` in the row of ``state``; the nominal row and
                 all ranges lie within them
    held_out     share of the samples, the last ones, that serve only for validation

    The set's bounds are guaranteed for the given noise and slope, known and held inputs, and a linear plant without disturbance.
    Raises InputError for wrong data, and if no plant explains them within the bounds.
    """
    recording = data if isinstance(data, Recording) else read_csv(data, inputs, outputs, time)
    names = recording.output_names
    noise, slope = _bounds("noise", noise, names), _bounds("slope", slope, names)
    if (noise is None) != (slope is None):
        given, lacking = ("noise", "slope") if slope is None else ("slope", "noise")
        raise InputError.of(lacking, f"is needed beside {given}: the known set depends on both")
    share = validate.number("held_out", held_out)
    if not 0 <= share <= 0.9:
        raise InputError.of("held_out", f"must be from 0 to 0.9, got {share:g}")
    p = len(names) + len(recording.input_names)
    trained = len(recording.times) - int(share * len(recording.times))
    if len(recording.times) - trained < LEAST_SAMPLES:  # too few for validation
        trained = len(recording.times)
    if trained - 1 < LEAST_ROWS * p:
        raise InputError(f"{trained} samples are too few for {p} coefficients in a row: give at least {LEAST_ROWS * p + 1}")
    train = recording.part(0, trained)
    if noise is not None and slope is not None:
        _require_slopes(recording, noise, slope)
    _require_affordable(len(names), p)
    fixed = _given_rows(derivatives or {}, names, p)
    limits = _within(within or {}, recording)
    rows = tuple(_row(train, i, noise, slope, fixed.get(name), limits.get(name)) for i, name in enumerate(names))
    return _validated(recording, rows, noise, slope, trained)


def _row(train: Recording, i: int, noise: Any, slope: Any, fixed: Array | None, limits: Array | None) -> Row:
    name = train.output_names[i]
    every = None if noise is None else windows_of(train, i, noise, slope)
    if fixed is not None:
        if every is not None and not every.explained_by(fixed).all():
            raise InputError(
                f"derivatives: the data contradict the given row of {name}'; it explains them only with error bounds "
                f"{every.factor(fixed):.3g} times larger"
            )
        return Row(name, fixed)
    known = np.full(train.outputs.shape[1] + train.inputs.shape[1], np.nan)
    if limits is not None:
        known = np.where(limits[:, 0] == limits[:, 1], limits[:, 0], np.nan)
    estimate, interval, regressors, left = _least_squares(train, i, known)
    if every is None:
        nominal = estimate if limits is None or _inside(estimate, limits) else _best_inside(limits, regressors, left)
        return Row(name, nominal, estimate, interval, None, _blind(regressors), limits)
    enclosure = enclose(every, limits)
    if enclosure.empty:
        raise InputError(_unexplained(name, every, estimate, limits, regressors, left))
    box = np.column_stack([enclosure.lower, enclosure.upper])
    nominal = estimate if _inside(estimate, box) else _best_inside(box, regressors, left)
    return Row(name, nominal, estimate, interval, enclosure, _unexcited(every, np.isfinite(box).all(axis=1)), limits)


def _inside(a: Array, box: Array) -> bool:
    return bool(((box[:, 0] <= a) & (a <= box[:, 1])).all())


def _best_inside(box: Array, Q: Array, left: Array) -> Array:
    """The least squares of left - Q a over a box (p, 2)."""
    (lower, upper), scale = box.T, np.maximum(np.abs(Q).max(axis=0), 1e-300)
    free = lower < upper
    a = lower.copy()
    bounds = (lower[free] * scale[free], upper[free] * scale[free])
    found = optimize.lsq_linear(Q[:, free] / scale[free], left - Q[:, ~free] @ a[~free], bounds).x
    a[free] = np.clip(found / scale[free], lower[free], upper[free])
    return a


def _unexplained(name: str, every: Windows, estimate: Array, limits: Array | None, Q: Array, left: Array) -> str:
    """Why no row explains the data, and the factor of the error bounds with which the best row would."""
    free = every.factor(estimate)
    if limits is None:
        return (
            f"no row of {name}' explains the data within the bounds of noise and slope; that of least squares needs them "
            f"{free:.3g} times larger"
        )
    best = every.factor(_best_inside(limits, Q, left))
    outside = (
        " without within, that of least squares explains the data"
        if free <= 1
        else (f" without within, that of least squares needs them {free:.3g} times larger")
    )
    return (
        f"no row of {name}' that lies within the bounds of within explains the data; the best one by least squares needs the "
        f"bounds of noise and slope {best:.3g} times larger;{outside}"
    )


def windows_of(recording: Recording, i: int, noise: Mapping[str, float], slope: Mapping[str, float]) -> Windows:
    """Windows of 1, 2, 4, ... steps of the row of state i, with their errors."""
    names = recording.output_names
    nu, L = (np.array([bounds[name] for name in names]) for bounds in (noise, slope))
    t, x, u = recording.times, recording.outputs, recording.inputs
    h = np.diff(t)[:, None]
    terms = np.column_stack([h * (x[:-1] / 2 + x[1:] / 2), h * u[:-1]])
    errors = np.column_stack([h * nu + L * h**2 / 4, np.zeros_like(u[:-1])])
    sums, error_sums = (np.vstack([np.zeros(part.shape[1]), np.cumsum(part, axis=0)]) for part in (terms, errors))
    N = len(h)
    size = np.abs(np.column_stack([x, u])).max(axis=0)
    rounding = (N + 16) * EPS * (np.abs(terms) + errors).sum(axis=0) + 4 * EPS * float(np.abs(t).max()) * N * size
    left, Q, Q_error = [], [], []
    for steps in _lengths(N):
        start = np.unique(np.linspace(0, N - steps, min(MOST_WINDOWS, N - steps + 1)).astype(int))
        left.append(x[start + steps, i] - x[start, i])
        Q.append(sums[start + steps] - sums[start])
        Q_error.append(error_sums[start + steps] - error_sums[start] + rounding)
    whole = np.concatenate(left)
    left_error = np.full(len(whole), 2 * nu[i] * (1 + 4 * EPS) + 4 * EPS * float(np.abs(x[:, i]).max()))
    return Windows(whole, np.vstack(Q), left_error, np.vstack(Q_error))


def _lengths(steps: int) -> list[int]:
    return [2**k for k in range(max(steps // 2, 1).bit_length())]


def _least_squares(train: Recording, i: int, known: Array) -> tuple[Array, Array, Array, Array]:
    """Coefficients, their intervals, the regressors and the left sides, over consecutive windows of the length with the narrowest
    intervals. Coefficients that are ``known`` (not NaN) keep their value."""
    t, x, u = train.times, train.outputs, train.inputs
    h = np.diff(t)[:, None]
    terms = np.column_stack([h * (x[:-1] + x[1:]) / 2, h * u[:-1]])
    sums = np.vstack([np.zeros(terms.shape[1]), np.cumsum(terms, axis=0)])
    p, best, free = terms.shape[1], None, np.isnan(known)
    given, count = np.where(free, 0.0, known), int(free.sum())
    for steps in _lengths(len(h)):
        ends = np.arange(0, len(t), steps)
        Q, left = np.diff(sums[ends], axis=0), np.diff(x[ends, i])
        if len(Q) < LEAST_ROWS * p:
            break
        a, spread = given.copy(), np.zeros(p)
        a[free] = np.linalg.lstsq(Q[:, free], left - Q @ given, rcond=None)[0]
        variance = float(np.sum((left - Q @ a) ** 2)) / (len(Q) - count)
        spread[free] = np.sqrt(np.maximum(np.diag(np.linalg.pinv(Q[:, free].T @ Q[:, free])), 0.0) * variance)
        width = float(np.linalg.norm(spread * np.abs(np.column_stack([x, u])).max(axis=0)))
        if best is None or width < best[0]:
            reach = stats.t.ppf(0.5 + CONFIDENCE / 2, len(Q) - count) * spread
            for direction in _blind(Q[:, free]):
                share = np.abs(direction) * np.abs(Q[:, free]).max(axis=0)
                reach[np.flatnonzero(free)[share > BLIND * share.max()]] = np.inf
            best = (width, a, np.column_stack([a - reach, a + reach]), Q, left)
    assert best is not None  # one-step windows give enough rows: see identify
    return best[1:]


def _blind(Q: Array) -> tuple[Array, ...]:
    """Directions in which the regressors do not move at all, up to rounding."""
    size = np.maximum(np.abs(Q).max(axis=0), 1e-300)
    _, values, directions = np.linalg.svd(Q / size, full_matrices=False)
    return tuple(
        row / size / np.abs(row / size).max() for value, row in zip(values, directions, strict=True) if value <= 1e-10 * values[0]
    )


def _unexcited(windows: Windows, bounded: Array) -> tuple[Array, ...]:
    """Directions whose regressor stays within its error in every window; used if the set is unbounded."""
    if bounded.all():
        return ()
    size = np.maximum(np.abs(windows.Q).max(axis=0), 1e-300)
    _, _, directions = np.linalg.svd(windows.Q / size, full_matrices=False)
    found = [row / size / np.abs(row / size).max() for row in directions]
    blind = [row for row in found if (np.abs(windows.Q @ row) <= windows.Q_error @ np.abs(row) + EPS).all()]
    return tuple(blind or [found[-1]])


def _validated(recording: Recording, rows: tuple[Row, ...], noise: Any, slope: Any, trained: int) -> Identification:
    """The identification with the nominal plant's results on the validation samples."""
    n = len(rows)
    rest = recording if trained == len(recording.times) else recording.part(trained, len(recording.times))
    A, B = np.array([row.nominal[:n] for row in rows]), np.array([row.nominal[n:] for row in rows])
    growth, duration = float(np.linalg.eigvals(A).real.max()), float(rest.times[-1] - rest.times[0])
    restarted = max(1, int(1 / (growth * _mean_interval(recording)))) if growth * duration > 1 else None
    predicted = _predicted(A, B, rest, restarted)
    fit = _fits(rest, predicted)
    held = None
    if restarted is not None:
        last = _fits(rest, _predicted(np.zeros_like(A), np.zeros_like(B), rest, restarted))
        held = {name: value for name, value in last.items() if value is not None}
    factor = None
    if noise is not None:
        factor = {row.state: windows_of(rest, i, noise, slope).factor(row.nominal) for i, row in enumerate(rows)}
    return Identification(recording, rows, noise, slope, trained, predicted, fit, factor, restarted, held)


def _mean_interval(recording: Recording) -> float:
    """The mean sampling interval [s]."""
    return float(recording.times[-1] - recording.times[0]) / (len(recording.times) - 1)


def _predicted(A: Array, B: Array, rest: Recording, restarted: int | None) -> Array:
    """(N, n) simulated states from the first measured one; after each ``restarted`` samples from the measured state there."""
    found = [rest.outputs[0]]
    with np.errstate(all="ignore"):
        for k, (h, u) in enumerate(zip(np.diff(rest.times), rest.inputs[:-1], strict=True)):
            start = rest.outputs[k] if restarted is not None and k % restarted == 0 else found[-1]
            found.append(HeldSystem.of(A, B, float(h)).following(start, u))
    return np.array(found)


def _fits(rest: Recording, predicted: Array) -> dict[str, float | None]:
    """By state: 1 - |y - predicted| / |y - mean|; None if a state did not move or its prediction diverged."""
    with np.errstate(all="ignore"):
        spread = np.linalg.norm(rest.outputs - rest.outputs.mean(axis=0), axis=0)
        missed = np.linalg.norm(rest.outputs - predicted, axis=0)
    told = [float(1 - m / s) if s > 0 and np.isfinite(m) else None for m, s in zip(missed, spread, strict=True)]
    return dict(zip(rest.output_names, told, strict=True))


def _bounds(field: str, given: Mapping[str, float] | None, names: Sequence[str]) -> dict[str, float] | None:
    """A positive number for each output."""
    if given is None:
        return None
    if unknown := [name for name in given if name not in names]:
        raise InputError.of(field, f"names {validate.show(unknown[0])}, which is not an output{validate.hint(unknown[0], names)}")
    found = {}
    for name in names:
        if name not in given:
            raise InputError.of(field, f"must have a bound for every output, and has none for {validate.show(name)}")
        found[name] = validate.number(f"{field} of {name}", given[name])
        if found[name] < 0 or (field == "slope" and found[name] == 0):
            raise InputError.of(f"{field} of {name}", f"must be positive, got {found[name]:g}")
    return found


def _require_slopes(recording: Recording, noise: Mapping[str, float], slope: Mapping[str, float]) -> None:
    """InputError if two samples differ by more than noise and slope allow."""
    for i, name in enumerate(recording.output_names):
        moved, h = np.abs(np.diff(recording.outputs[:, i])), np.diff(recording.times)
        allowed = (slope[name] * h + 2 * noise[name]) * (1 + 1e-9) + 1e-12 * np.abs(recording.outputs[:-1, i])
        if (moved > allowed).any():
            k = int(np.argmax(moved - allowed))
            least, at = (moved[k] - 2 * noise[name]) / h[k], f"at t = {recording.times[k]:g} s"
            raise InputError.of(
                f"slope of {name}",
                f"is {slope[name]:g}, but with its noise the data move at least {least:.4g} per second {at}",
            )


def _given_rows(derivatives: Mapping[str, str], names: Sequence[str], p: int) -> dict[str, Array]:
    rows = {}
    for state, rate in derivatives.items():
        for name in (state, rate):
            if name not in names:
                raise InputError.of(
                    "derivatives", f"names {validate.show(name)}, which is not an output{validate.hint(name, names)}"
                )
        rows[state] = np.zeros(p)
        rows[state][list(names).index(rate)] = 1.0
    return rows


def _within(given: Mapping[tuple[str, str], tuple[float, float]], recording: Recording) -> dict[str, Array]:
    names = (*recording.output_names, *recording.input_names)
    found: dict[str, Array] = {}
    for (state, name), ends in given.items():
        if state not in recording.output_names or name not in names:
            raise InputError.of("within", f"names {validate.show(f'{state}.{name}')}, which is not a coefficient")
        low, high = validate.vector(f"within of {state}.{name}", ends, 2)
        if low > high:
            raise InputError.of(f"within of {state}.{name}", f"must begin with its lower end, got {low:g} and {high:g}")
        rows = found.setdefault(state, np.column_stack([np.full(len(names), -np.inf), np.full(len(names), np.inf)]))
        rows[names.index(name)] = low, high
    return found


def _require_affordable(n: int, p: int) -> None:
    """InputError if the linear programmes for this number of states exceed the budget."""
    each = 2.0 ** min(n, 6) * (2 * p + 1) * n * MOST_WINDOWS * 8
    budget.require("outputs", n, lambda count: WINDOW.times(each * count / n / 50), what="identifying so many states")
