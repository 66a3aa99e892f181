"""Close-ups of a panel in which series oscillate too fast to be shown over the whole run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from barbalat.pictures.panels import PAGE_LEFT, PAGE_RIGHT, PAGE_WIDTH, Panel, Series, around, span_of
from barbalat.pictures.series import COLUMNS_PER_INCH, FASTEST_SWING_COLUMNS, VISIBLE_SWING_SHARE, turning_points

PERIODS = 10
"""Number of periods in half a page's width, about an eighth of what the eye can still count. Each has twenty columns."""


def close_ups(panel: Panel, followed: Sequence[Series], t_end: float) -> list[Panel]:
    """Return two close-up panels if the ``followed`` series, the model and its command, oscillate too fast for a panel of the
    whole run; otherwise none."""
    columns = COLUMNS_PER_INCH * (PAGE_WIDTH - PAGE_LEFT - PAGE_RIGHT)
    swings = [swing for swing in map(_usual_swing, followed) if swing < FASTEST_SWING_COLUMNS * t_end / columns]
    if not swings:
        return []
    shown = 2 * PERIODS * max(swings)
    spans = {f"first {shown:.2g} s": (0.0, shown), f"last {shown:.2g} s": (t_end - shown, t_end)}
    return [_part(panel, f"{panel.title}: {name}", times) for name, times in spans.items()]


def _part(panel: Panel, title: str, times: tuple[float, float]) -> Panel:
    """Return a part of a panel, with the axis limits of the panel of the whole run, if any. A run that ends earlier is
    omitted."""
    series = [one for one in panel.series if one.t[-1] > times[0]]
    limits = panel.limits or around(*span_of([one.within(*times).value for one in series]))
    return replace(panel, title=title, series=series, times=times, limits=limits, note="", whole_row=False)


def _usual_swing(series: Series) -> float:
    """Return the median time between successive extrema, or infinity if the series has hardly any."""
    turns = turning_points(series.value, VISIBLE_SWING_SHARE * float(np.ptp(series.value)))
    return float(np.median(np.diff(series.t[turns]))) if len(turns) > 2 * PERIODS else float("inf")
