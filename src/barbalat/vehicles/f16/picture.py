"""What a picture of flights shows, in aircraft units: pitch rate, angle of attack, load factor, elevator."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from barbalat.pictures.panel_drawing import draw
from barbalat.pictures.panels import Panel, Series, around, span_of, text_of, width_of
from barbalat.validate import Array
from barbalat.vehicles.f16.axis import Followed
from barbalat.vehicles.f16.flight import TIMING, Flight

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DRAWN_STRIDE = 10
"""Samples from one drawn point to the next: a tenth of a second is three pixels of a page."""


def panels_of(followed: Followed) -> dict[str, tuple[str, str]]:
    """Titles and units of what is shown, by columns."""
    rate, surface = followed.rate, followed.surface
    beside = {"alpha": (r"Angle of attack $\alpha$", "[deg]"), "n_z": ("Load factor $n_z$", "[g]")}
    if followed.attitude == "phi":
        beside = {"bank": (r"Bank angle $\phi$", "[deg]"), "beta": (r"Angle of sideslip $\beta$", "[deg]")}
    return {
        rate: (f"{RATES[rate]} ${rate}$", "[deg/s]"),
        **beside,
        surface: (f"{surface.capitalize()}, the surface itself", "[deg]"),
    }


RATES = {"p": "Roll rate", "q": "Pitch rate"}


def figure_of(flights: Sequence[Flight], *, narrow: bool = False, shown: bool = False) -> Figure:
    """All controllers through one failure; what lost ones do stands as far as the others' ranges reach.

    narrow, shown  as of a run's picture
    """
    titles = panels_of(flights[0].followed)
    return draw([_panel(name, *title, flights) for name, title in titles.items()], TIMING.duration, narrow=narrow, shown=shown)


def _panel(name: str, title: str, unit: str, flights: Sequence[Flight]) -> Panel:
    flying = [one for one in flights if len(one.record) > 1]
    series = [_series(i, len(flights), name, one) for i, one in enumerate(flights) if len(one.record) > 1]
    kept = [one.column(name) for one in flying if not one.lost] or [one.column(name) for one in flying]
    if name in RATES and flying:
        longest = max(flying, key=lambda one: len(one.record))
        line = partial(Series, t=thinned(longest.column("t")), width=0.9)
        series.append(line(value=thinned(longest.column(f"{name}_m")), label="model", colour="ink", dash=1))
        series.append(line(value=thinned(longest.column(f"{name}_c")), label="command", colour="quiet", dash=2))
    limits = around(*span_of(kept)) if kept else None
    return Panel(title=title, series=series, limits=limits, y=unit, whole_row=True)


def _series(i: int, count: int, name: str, flight: Flight) -> Series:
    value, t = thinned(flight.column(name)), thinned(flight.column("t"))
    return Series(t=t, value=value, label=text_of(flight.controller), colour=i, width=width_of(i, count))


def thinned(values: Array) -> Array:
    """Every so many rows of a record, and its last one."""
    rows = np.unique([*range(0, len(values), DRAWN_STRIDE), len(values) - 1])
    return np.asarray(values[rows])
