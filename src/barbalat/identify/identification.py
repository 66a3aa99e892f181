"""The plant x' = A x + B u from a recording: by an output-error fit, the set of all plants that explain the data, and
validation."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy import stats

from barbalat import budget, validate
from barbalat.budget import Estimate
from barbalat.identify import validation
from barbalat.identify.alternative import ROUNDING, Alternative, alternative
from barbalat.identify.given import Structure, bounds_by_name, require_slopes
from barbalat.identify.known_set import Enclosure, Windows, enclose, least_factor
from barbalat.identify.output_error import Fit, fit, refit
from barbalat.identify.recording import CONSTANT, LEAST_SAMPLES, Recording, read_csv
from barbalat.identify.result import CONFIDENCE, Identification, Row
from barbalat.identify.windows import LEAST_ROWS, MOST_WINDOWS, blind, first_guess, unexcited, windows_of
from barbalat.validate import Array, InputError

DEFAULT_HELD_OUT = 0.25
WINDOW = Estimate(memory=2e3, seconds=2e-4)
"""The cost of a window, including its part of a linear programme."""
VALUE = Estimate(memory=100.0, seconds=1e-5)
"""The cost of the derivative of a sample with respect to a coefficient, over all steps and dead times of the search."""


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
    offset: bool = False,
    delay: float = 0.0,
    held_out: float = DEFAULT_HELD_OUT,
) -> Identification:
    """Identify x' = A x + B u from samples of all states x, with inputs held between samples.

    data         a CSV file with a header line, whose columns ``inputs``, ``outputs`` and ``time`` name, or a Recording
    noise        keyed by output: a bound on the measurement error. Together with ``slope`` it gives the set of all plants that
                 explain the data
    slope        keyed by output: a bound on |x'| over the recording [unit/s], which bounds the error of the trapezoidal rule
    derivatives  keyed by output: the output that is its exact derivative; the row of that output is not identified
    within       by (state, name): known bounds on the coefficient of ``name`` in the row of ``state``; the nominal row and all
                 ranges lie within them
    offset       whether each unknown row has a constant term; the plant then describes deviations from the
                 ``operating_point``
    delay        dead time of all inputs [s], a multiple of the sample time
    held_out     fraction of the samples, at the end, that are used only for validation

    The bounds of the set are guaranteed for the given noise and slope bounds, known and held inputs, and a linear plant without
    disturbances. Without noise bounds, the ranges are confidence intervals of an output-error fit with independent measurement
    errors. Raises InputError for wrong data, and if no plant explains them within the bounds.
    """
    whole = data if isinstance(data, Recording) else read_csv(data, inputs, outputs, time)
    names = whole.output_names
    noise, slope = bounds_by_name("noise", noise, names), bounds_by_name("slope", slope, names)
    if (noise is None) != (slope is None):
        given, lacking = ("noise", "slope") if slope is None else ("slope", "noise")
        raise InputError.of(lacking, f"is needed with {given}: the known set depends on both")
    share = validate.number("held_out", held_out)
    if not 0 <= share <= 0.9:
        raise InputError.of("held_out", f"must be from 0 to 0.9, got {share:g}")
    delay = validate.number("delay", delay)
    recording = whole.delayed(delay) if delay else whole
    trained = _trained(recording, share)
    structure = Structure.of(whole, derivatives or {}, within or {})
    model, plain, reference = recording, structure, None
    if offset:
        if CONSTANT in (*names, *whole.input_names):
            raise InputError(
                f"with offset, no column may have the name {CONSTANT!r}, because it is the name of the constant term"
            )
        reference = np.column_stack([recording.outputs, recording.inputs])[:trained].mean(axis=0)
        model, structure = recording.about(reference), structure.about(reference)
    p = structure.start.shape[1]
    if trained - 1 < LEAST_ROWS * p:
        raise InputError(
            f"{trained} samples are too few for {p} coefficients per equation: at least {LEAST_ROWS * p + 1} are needed"
        )
    if noise is not None and slope is not None:
        require_slopes(recording, noise, slope)
    _require_affordable(len(names), p, trained)
    train = model.part(0, trained)
    guess = np.array([first_guess(train, i, *row) for i, row in enumerate(zip(structure.start, structure.free, strict=True))])
    fitted = fit(train, guess, structure.free)
    other = alternative(
        whole, plain, fitted, train.outputs - fitted.simulated, offset=offset, delay=delay,
        trained=len(whole.times) - len(recording.times) + trained,
    )  # fmt: skip
    enclosures, windows = [], []
    for i, name in enumerate(names):
        every = None if noise is None else windows_of(train, i, noise, slope or {})
        windows.append(every)
        enclosures.append(None if every is None else _enclosed(name, every, structure, i, other))
    boxes = structure.limits.copy()
    for box, enclosure in zip(boxes, enclosures, strict=True):
        if enclosure is not None:
            box[:] = np.column_stack([enclosure.lower, enclosure.upper])
    nominal = fitted.matrix
    if not _inside(nominal, boxes):
        bounded = np.isfinite(boxes).all(axis=2)
        start = nominal.copy()
        for i in range(len(names)):
            middle = bounded[i] & _blind(train, structure, fitted, i)[1]
            start[i, middle] = boxes[i, middle].mean(axis=1)
        nominal = refit(train, [start], structure.free, fitted.length, bounds=boxes).matrix
    rows = tuple(_row(i, train, structure, fitted, nominal, windows[i], enclosures[i]) for i in range(len(names)))
    return _validated(recording, model, rows, fitted, noise, slope, reference, delay, trained, other)


def _trained(recording: Recording, share: float) -> int:
    """The number of samples for the fit: all of them if too few are left for the validation."""
    N = len(recording.times)
    trained = N - int(share * N)
    return N if N - trained < LEAST_SAMPLES else trained


def _inside(a: Array, box: Array) -> bool:
    return bool(((box[..., 0] <= a) & (a <= box[..., 1])).all())


def _enclosed(name: str, every: Windows, structure: Structure, i: int, other: Alternative | None) -> Enclosure | None:
    """The known set of a row, None for a given row; raises InputError if no row explains the data."""
    hint = "" if other is None else f"; {other.sentence}"
    if structure.given[i]:
        if not every.explained_by(structure.start[i]).all():
            raise InputError(
                f"derivatives: the data contradict the given equation of {name}'; it explains them only with error bounds "
                f"{_up(every.factor(structure.start[i]))} times larger{hint}"
            )
        return None
    limits = structure.limits[i] if np.isfinite(structure.limits[i]).any() else None
    enclosure = enclose(every, limits)
    if enclosure.empty:
        raise InputError(_unexplained(name, every, limits) + hint)
    return enclosure


def _unexplained(name: str, every: Windows, limits: Array | None) -> str:
    """The error that no row explains the data. It states by which factor the error bounds would have to grow for a row to explain
    them."""
    free = least_factor(every)
    if limits is None:
        return (
            f"no parameters explain the data within the stated bounds: an equation of {name}' explains them only with bounds on "
            f"noise "
            f"and slope that are {_up(free)} times larger"
        )
    outside = "some other equation explains them" if free <= 1 else f"the best equation needs them {_up(free)} times larger"
    return (
        f"no parameters explain the data within the stated bounds: an equation of {name}' whose coefficients are limited by "
        f"within explains them only if the bounds on noise and slope are {_up(least_factor(every, limits))} times larger. "
        f"Without "
        f"within, {outside}"
    )


def _up(factor: float) -> str:
    """A factor with three digits, not rounded down."""
    step = 10.0 ** (math.floor(math.log10(factor)) - 2)
    return f"{math.ceil(factor / step) * step:.3g}"


def _row(
    i: int, train: Recording, structure: Structure, fitted: Fit, nominal: Array, every: Windows | None,
    enclosure: Enclosure | None,
) -> Row:  # fmt: skip
    """The result for a row. Its intervals are infinite where the fitted motion does not excite a coefficient."""
    name = train.output_names[i]
    if structure.given[i]:
        return Row(name, structure.start[i])
    directions, hidden = _blind(train, structure, fitted, i)
    reach = np.where(hidden, np.inf, float(stats.t.ppf(0.5 + CONFIDENCE / 2, fitted.freedom)) * fitted.spread[i])
    estimate = fitted.matrix[i]
    if every is not None and enclosure is not None:
        directions = () if np.isfinite([enclosure.lower, enclosure.upper]).all() else unexcited(every)
    interval = np.column_stack([estimate - reach, estimate + reach])
    limits = structure.limits[i] if np.isfinite(structure.limits[i]).any() else None
    return Row(name, nominal[i], estimate, interval, enclosure, directions, limits)


def _blind(train: Recording, structure: Structure, fitted: Fit, i: int) -> tuple[tuple[Array, ...], Array]:
    """The directions (p,) of a row that the fitted motion does not excite, and which coefficients (p,) occur in them."""
    free, hidden = structure.free[i], np.zeros(len(structure.free[i]), bool)
    if not free.any():
        return (), hidden
    still, which = blind(np.column_stack([fitted.simulated, train.inputs])[:, free])
    hidden[np.flatnonzero(free)[which]] = True
    directions = np.zeros((len(still), len(free)))
    for direction, moved in zip(directions, still, strict=True):
        direction[free] = moved
    return tuple(directions), hidden


def _validated(
    recording: Recording, model: Recording, rows: tuple[Row, ...], fitted: Fit, noise: Mapping[str, float] | None,
    slope: Mapping[str, float] | None, reference: Array | None, delay: float, trained: int, other: Alternative | None,
) -> Identification:  # fmt: skip
    """The identification with the results of the nominal plant on the validation samples."""
    names, start = recording.output_names, trained % len(recording.times)
    rest, measured = model.part(start, len(model.times)), recording.part(start, len(model.times))
    matrix = np.array([row.nominal for row in rows])
    restarted = validation.restart_every(matrix, rest)
    predicted = validation.predicted(matrix, rest, restarted)
    held = None
    if restarted is not None:
        last = validation.fits(rest, validation.predicted(np.zeros_like(matrix), rest, restarted))
        held = {name: value for name, value in last.items() if value is not None}
    factor = None
    if noise is not None and slope is not None:
        factor = {row.state: windows_of(rest, i, noise, slope).factor(row.nominal) for i, row in enumerate(rows)}
    left = model.outputs[:trained] - fitted.simulated
    return Identification(
        recording, rows, noise, slope, trained, predicted + (0.0 if reference is None else reference[: len(names)]),
        validation.fits(rest, predicted), factor, restarted, held,
        dict(zip(names, map(float, np.sqrt(np.mean(left**2, axis=0))), strict=True)),
        dict(zip(names, map(_correlation, left.T, np.ptp(measured.outputs, axis=0)), strict=True)),
        reference, delay, other, fitted.converged,
    )  # fmt: skip


def _correlation(values: Array, size: float) -> float:
    """The correlation of residuals from one sample to the next; 0 if they are only rounding."""
    power = float(values @ values)
    return float(values[1:] @ values[:-1]) / power if power > len(values) * (ROUNDING * size) ** 2 else 0.0


def _require_affordable(n: int, p: int, samples: int) -> None:
    """Raise InputError if the fit and the linear programmes for this number of states exceed the budget."""
    each = 2.0 ** min(n, 6) * (2 * p + 1) * MOST_WINDOWS * 8
    budget.require(
        "outputs", n, lambda count: WINDOW.times(each * count / 50) + VALUE.times(samples * count * n * p),
        what="identifying this many states",
    )  # fmt: skip
