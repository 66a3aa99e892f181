"""Panels and responses in the form that the charts of a page need, in single precision and with as many points as a screen can
show."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from barbalat.pictures.panels import SHARING, Panel, Series, span_of
from barbalat.pictures.response import NYQUIST_WINDOW, Response
from barbalat.pictures.series import windows
from barbalat.pictures.symbols import in_symbols, without_mathtext
from barbalat.validate import Array

DASHES = (None, (6, 4), (2, 3), (8, 3, 2, 3))
"""Lengths of strokes and gaps [px], in the order of ``theme.DASHES``."""
MOST_WINDOWS, FEWEST_WINDOWS = 800, 100
"""Number of windows of a run for which a page contains the extrema: about one per pixel."""
LARGEST_DATA_BYTES = 300_000
"""Largest size in bytes of the panels of a page, so that the page can be mailed. ``FEWEST_WINDOWS`` may need more."""
UNSEEN_SHARE = 0.004
"""Fraction of a panel's height, less than a pixel, by which a line through the ends of the windows may miss the values between
them."""
LARGEST, SMALLEST = 3e38, 1e-37
"""Largest number in single precision, and smallest number on a logarithmic axis."""


class Arrays:
    """The arrays of a page, each stored once."""

    def __init__(self) -> None:
        """No array yet."""
        self.texts: list[str] = []
        self._known: dict[bytes, int] = {}

    def add(self, values: Array) -> int:
        """Store the array if it is new. Return its number."""
        packed = np.clip(values, -LARGEST, LARGEST).astype("<f4").tobytes()
        if packed not in self._known:
            self._known[packed] = len(self.texts)
            self.texts.append(b64encode(packed).decode("ascii"))
        return self._known[packed]


def panels_data(panels: Sequence[Panel], t_end: float) -> dict[str, Any]:
    """Return the panels in groups with a common interval, first the whole run and then the close-ups."""
    arrays = Arrays()
    lines = sum(len(panel.series) for panel in panels)
    bytes_each_window = 2 * 4 * 4 / 3  # smallest and largest value, four bytes each, in Base64
    most = min(MOST_WINDOWS, max(FEWEST_WINDOWS, int(LARGEST_DATA_BYTES / (bytes_each_window * max(lines, 1)))))
    groups: dict[tuple[float, float] | None, list[dict[str, Any]]] = {None: []}
    for panel in panels:
        groups.setdefault(panel.times, []).append(_panel(panel, t_end, most, arrays))
    return {"groups": list(groups.values()), "arrays": arrays.texts}


def _panel(panel: Panel, t_end: float, most: int, arrays: Arrays) -> dict[str, Any]:
    start, end = panel.times or (0.0, t_end)
    shown = [one if panel.times is None else one.within(start, end) for one in panel.series]
    if panel.scale == "log":
        shown = [replace(one, value=np.maximum(one.value, SMALLEST)) for one in shown]
    height = np.ptp(panel.limits or span_of([one.value for one in shown])) if panel.scale == "linear" else 0.0
    series = [_series(one, UNSEEN_SHARE * float(height), most, arrays) for one in shown if len(one.t) > 1]
    ends = arrays.add(np.array([start, end]))
    told: set[str] = set()
    for level in panel.levels:
        label = "" if level.label in told else level.label
        told.add(level.label)
        value = arrays.add(np.full(2, level.value))
        series.append({"t": ends, "low": value, "label": label, **_look(level.colour, level.dash, 1.0)})
    return {
        "title": without_mathtext(panel.title),
        "note": without_mathtext(panel.note),
        "x": "time t [s]",
        "y": without_mathtext(panel.y).strip(),
        "log": panel.scale == "log",
        "signed": panel.scale == "symlog",
        "limits": None if panel.limits is None else list(panel.limits),
        "whole": panel.whole_row,
        "series": series,
    }


def _series(series: Series, room: float, most: int, arrays: Arrays) -> dict[str, Any]:
    """Return a series as a line through the ends of the windows if it is within ``room`` of all values, otherwise as the extrema
    of each window."""
    finite = np.isfinite(series.value)
    kept = len(finite) if finite.all() else int(finite.argmin())
    below, above = (None if side is None else side[: max(kept - 1, 0)] for side in (series.low, series.high))
    t, value, low, high = windows(series.t[:kept], series.value[:kept], below, above, most)
    look = {"label": without_mathtext(series.label), **_look(series.colour, series.dash, series.width)}
    between = (low >= np.minimum(value[:-1], value[1:]) - room) & (high <= np.maximum(value[:-1], value[1:]) + room)
    if between.all():
        return {"t": arrays.add(t), "low": arrays.add(value), **look}
    middles = np.concatenate([t[:1], (t[:-1] + t[1:]) / 2, t[-1:]])
    low, high = (arrays.add(np.concatenate([value[:1], side, value[-1:]])) for side in (low, high))
    return {"t": arrays.add(middles), "low": low, "high": high, **look}


def _look(colour: int | str, dash: int | None, width: float) -> dict[str, Any]:
    """Return colour, dash and width [px]. The default dash is the one that distinguishes the compared object."""
    if dash is None:
        dash = int(colour) // SHARING if isinstance(colour, int) else 0
    return {"colour": colour, "dash": DASHES[dash % len(DASHES)], "width": width}


def responses_data(responses: Sequence[Response]) -> dict[str, Any]:
    """Return |L| and phase of loops over frequency, from which a page computes L, S and T, and the positions of their margins."""
    arrays = Arrays()
    loops = [
        {
            "caption": in_symbols(one.caption),
            "w": arrays.add(one.w),
            "size": arrays.add(np.abs(one.L)),
            "phase": arrays.add(one.phase),
            "marks": [None if w is None else int(np.abs(one.w - w).argmin()) for w in (one.at_phase, one.at_gain)],
            **_look(k, None, 1.4),
        }
        for k, one in enumerate(responses)
    ]
    return {"loops": loops, "window": NYQUIST_WINDOW, "arrays": arrays.texts}
