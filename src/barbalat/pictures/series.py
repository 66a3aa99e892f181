"""Reduces a long series to what a plot can show: a line where the eye can follow the series, and an envelope where it oscillates
too fast."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.validate import Array

COLUMNS_PER_INCH = 55
"""Columns per inch of a panel's width. A column has about two pixels, both on a page and on a phone."""
FASTEST_SWING_COLUMNS = 1.7
"""Largest width in columns of a swing between extrema that is too fast to see. It corresponds to seven pixels per period."""
FEWEST_FAST_SWINGS = 6
"""Smallest number of successive fast swings that make an envelope: three periods. Fewer are a transient, which a line shows."""
SHORTEST_ENVELOPE_PERIODS = 10
"""Smallest length of an envelope, in periods of the slowest oscillation that is too fast: about seventy pixels. A shorter
envelope has no visible shape."""
VISIBLE_SWING_SHARE = 0.02
"""Fraction of the whole height below which a swing is ignored, because it is hardly larger than the line's width."""
LEVEL_SHARE = 1e-3
"""Fraction of the whole height below which two points of an envelope count as level."""
PIECES_PER_COLUMN = 8
"""Number of pieces of a column that are examined. A longer series is condensed."""


@dataclass(frozen=True)
class Outline:
    """A line without gaps, (2, N), which runs in the middle of each envelope, and the envelopes, each (3, M): t, low, high."""

    line: Array
    envelopes: tuple[Array, ...]


def outline(
    t: Array,
    value: Array,
    low: Array | None = None,
    high: Array | None = None,
    *,
    inches: float = 4.0,
    height: float | None = None,
) -> Outline:
    """Return the outline of a series from instants t (K,), the values there, and the extrema (K - 1,) in between, if known.

    inches  width of the panel from t[0] to t[-1]
    height  height of the panel, in the values' unit; by default the range of the series
    """
    if len(t) < 3:
        return Outline(np.array([t, value]), ())
    columns = max(int(COLUMNS_PER_INCH * inches), 1)
    path = _path(t, value, low, high, PIECES_PER_COLUMN * columns)
    duration = float(t[-1] - t[0])
    height = float(np.ptp(path[1])) if height is None else height
    turns = turning_points(path[1], VISIBLE_SWING_SHARE * height)
    period = 2 * FASTEST_SWING_COLUMNS * duration / columns
    runs = [turns[a:b] for a, b in _runs(np.diff(path[0, turns]) / (period / 2))]
    runs = [run for run in runs if path[0, run[-1]] - path[0, run[0]] >= SHORTEST_ENVELOPE_PERIODS * period]
    bands, middles = [], []
    inside = np.zeros(path.shape[1], dtype=bool)
    for run in runs:
        band = _envelope(path, run, period, LEVEL_SHARE * height)
        until = run[-1]
        if _stays_in(path[:, until:], band[1:, -1], period):  # the end of the series is part of the envelope too
            band, until = np.column_stack([band, [path[0, -1], *band[1:, -1]]]), path.shape[1]
        inside[run[0] + 1 : until] = True
        bands.append(band)
        middles.append(np.array([band[0], (band[1] + band[2]) / 2])[:, 1 : None if until == path.shape[1] else -1])
    joined = np.concatenate([_thinned(path[:, ~inside], columns, duration), *middles], axis=1)
    return Outline(joined[:, np.argsort(joined[0], kind="stable")], tuple(bands))


def _stays_in(rest: Array, sides: Array, period: float) -> bool:
    """Whether the rest of a series is shorter than two periods and never leaves the envelope."""
    return bool(np.ptp(rest[0]) <= 2 * period and sides[0] <= rest[1].min() and rest[1].max() <= sides[1])


def windows(t: Array, value: Array, low: Array | None, high: Array | None, most: int) -> tuple[Array, Array, Array, Array]:
    """Return at most ``most`` windows of a series: their ends, the values there, and the extrema within each."""
    start, end = value[:-1], value[1:]
    low = np.minimum(start, end) if low is None else np.minimum(low, np.minimum(start, end))
    high = np.maximum(start, end) if high is None else np.maximum(high, np.maximum(start, end))
    edges = np.unique(np.linspace(0, len(low), min(len(low), most) + 1).astype(int))
    return t[edges], value[edges], np.minimum.reduceat(low, edges[:-1]), np.maximum.reduceat(high, edges[:-1])


def _path(t: Array, value: Array, low: Array | None, high: Array | None, most: int) -> Array:
    """Return the path (2, N) of the series over at most ``most`` intervals, through the extrema of each in a likely order."""
    t, value, low, high = windows(t, value, low, high, most)
    ends = np.array([np.minimum(value[:-1], value[1:]), np.maximum(value[:-1], value[1:])])
    rising = value[1:] >= value[:-1]
    between = np.array([value[:-1], np.where(rising, low, high), np.where(rising, high, low)])
    beyond = np.array([low < ends[0], high > ends[1]])
    kept = np.array([np.ones(len(rising), dtype=bool), np.where(rising, *beyond), np.where(rising, *beyond[::-1])])
    times = np.array([t[:-1] + share * np.diff(t) for share in (0, 1 / 3, 2 / 3)])
    path = np.array([times.T.ravel(), between.T.ravel()])[:, kept.T.ravel()]
    return np.concatenate([path, [[t[-1]], [value[-1]]]], axis=1)


def turning_points(values: Array, least: float) -> Array:
    """Return the indices at which the values turn by more than ``least``. Maxima and minima alternate."""
    turns: list[int] = []
    extreme, rising = 0, True
    entries = values.tolist()
    for i, value in enumerate(entries):
        beyond = value > entries[extreme] if rising else value < entries[extreme]
        if beyond:
            extreme = i
        elif abs(value - entries[extreme]) > least:
            turns.append(extreme)
            extreme, rising = i, not rising
    return np.array([*turns, extreme])


def _runs(swings: Array) -> list[tuple[int, int]]:
    """Return the pairs of turning points between which all swings are fast.

    ``swings`` are durations in units of the longest fast one; within such an interval a swing may take up to 1.5 units. The first
    and the last swing are omitted, because they lead into the interval and out of it.
    """
    marked = np.concatenate([[False], swings <= 1.5, [False]])
    changes = np.flatnonzero(np.diff(marked.astype(int))).reshape(-1, 2)
    return [(int(a) + 1, int(b)) for a, b in changes if (swings[a:b] <= 1).sum() >= FEWEST_FAST_SWINGS]


def _envelope(path: Array, turns: Array, width: float, level: float) -> Array:
    """Return the envelope (3, M): lines through the maxima and through the minima, using the outermost of each ``width``."""
    values = path[1, turns]
    first = 0 if values[0] < values[1] else 1
    lower, upper = (_outermost(path[:, turns[k::2]], width, level, sign) for k, sign in ((first, -1), (1 - first, 1)))
    t = np.unique(np.concatenate([path[0, turns[[0, -1]]], lower[0], upper[0]]))
    return np.array([t, np.interp(t, *lower), np.interp(t, *upper)])


def _outermost(points: Array, width: float, level: float, sign: int) -> Array:
    """Return points (2, M): in each interval of the given width, the highest point, or the lowest for ``sign`` -1. Of level
    points, the first and the last are kept."""
    stretch = ((points[0] - points[0, 0]) / width).astype(int) if width > 0 else np.arange(points.shape[1])
    starts = np.flatnonzero(np.diff(stretch, prepend=-1))
    best = [a + int((sign * points[1, a:b]).argmax()) for a, b in zip(starts, [*starts[1:], points.shape[1]], strict=True)]
    kept = points[:, best]
    steps = np.abs(np.diff(kept[1])) > level
    return kept[:, np.concatenate([[True], steps[:-1] | steps[1:], [True]])] if kept.shape[1] > 2 else kept


def _thinned(path: Array, columns: int, duration: float) -> Array:
    """Return points (2, N): the first, the lowest, the highest and the last point of each column, in the order of time."""
    if path.shape[1] <= 4 * columns or duration == 0:
        return path
    column = ((path[0] - path[0, 0]) / duration * columns).astype(int)
    starts = np.flatnonzero(np.diff(column, prepend=-1))
    kept: set[int] = set()
    for a, b in zip(starts.tolist(), [*starts[1:].tolist(), path.shape[1]], strict=True):
        piece = path[1, a:b]
        kept |= {a, b - 1, a + int(piece.argmin()), a + int(piece.argmax())}
    return path[:, sorted(kept)]
