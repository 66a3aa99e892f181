"""What flights look like over time: the panels that their vehicle declares, all controllers through one failure in each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from barbalat.pictures.panel_drawing import draw
from barbalat.pictures.panels import Panel, Series, around, span_of, text_of, width_of
from barbalat.validate import Array
from barbalat.vehicles.flight import Flight
from barbalat.vehicles.vehicle import Shown, Vehicle

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DRAWN_STRIDE = 10
"""Samples from one drawn point to the next: a tenth of a second at 100 Hz is three pixels of a page."""


def figure_of(vehicle: Vehicle[Any, Any, Any], flights: Sequence[Flight], *, narrow: bool = False, shown: bool = False) -> Figure:
    """All controllers through one failure; what lost ones do stands as far as the others' ranges reach.

    narrow, shown  as of a run's picture
    """
    return draw([_panel(one, flights) for one in vehicle.panels], vehicle.timing.duration, narrow=narrow, shown=shown)


def _panel(of: Shown[Any], flights: Sequence[Flight]) -> Panel:
    flying = [one for one in flights if len(one.record) > 1]
    series = [
        Series(
            t=thinned(one.column("t")), value=thinned(of.value(one)), label=text_of(one.controller), colour=i,
            width=width_of(i, len(flights)),
        )
        for i, one in enumerate(flights)
        if len(one.record) > 1
    ]  # fmt: skip
    if flying:
        longest = max(flying, key=lambda one: len(one.record))
        t = thinned(longest.column("t"))
        for column, label, colour, dash in of.beside:
            series.append(Series(t=t, value=thinned(longest.column(column)), label=label, colour=colour, dash=dash, width=0.9))
    kept = [of.value(one) for one in flying if not one.lost] or [of.value(one) for one in flying]
    return Panel(title=of.title, series=series, limits=around(*span_of(kept)) if kept else None, y=of.unit, whole_row=True)


def thinned(values: Array) -> Array:
    """Every so many rows of a record, and its last one."""
    rows = np.unique([*range(0, len(values), DRAWN_STRIDE), len(values) - 1])
    return np.asarray(values[rows])
