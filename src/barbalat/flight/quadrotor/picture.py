"""What a picture of a quadrotor's flights shows: its distance from the path, its height, its tilt, a rotor's thrust."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from barbalat.flight.picture import thinned
from barbalat.flight.quadrotor.flight import DURATION, QuadrotorFlight
from barbalat.pictures.panel_drawing import draw
from barbalat.pictures.panels import Panel, Series, around, span_of, text_of
from barbalat.pictures.theme import COLOURS
from barbalat.validate import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PANELS: dict[tuple[str, str], Callable[[QuadrotorFlight], Array]] = {
    ("Distance from where it should be", "[m]"): lambda flight: flight.error,
    ("Height above the ground", "[m]"): lambda flight: flight.column("z"),
    ("Tilt", "[deg]"): lambda flight: flight.tilt,
    ("Thrust of the front left rotor", "[N]"): lambda flight: flight.column("thrust_1"),
}


def figure_of(flights: Sequence[QuadrotorFlight], *, narrow: bool = False, shown: bool = False) -> Figure:
    """All schemes through one failure; what lost ones do stands as far as the others' ranges reach."""
    flying = [one for one in flights if len(one.record) > 1]
    panels = [_panel(title, unit, value, flights, flying) for (title, unit), value in PANELS.items()]
    return draw(panels, DURATION, narrow=narrow, shown=shown)


def _panel(
    title: str,
    unit: str,
    value: Callable[[QuadrotorFlight], Array],
    flights: Sequence[QuadrotorFlight],
    flying: Sequence[QuadrotorFlight],
) -> Panel:
    series = [
        Series(
            t=thinned(one.column("t")), value=thinned(value(one)), label=text_of(one.controller), colour=i % len(COLOURS),
            dash=i // len(COLOURS),
        )
        for i, one in enumerate(flights)
        if one in flying
    ]  # fmt: skip
    if title.startswith("Height") and flying:
        longest = max(flying, key=lambda one: len(one.record))
        wanted, t = thinned(longest.column("z_d")), thinned(longest.column("t"))
        series.append(Series(t=t, value=wanted, label="commanded", colour="ink", dash=1, width=0.9))
    kept = [value(one) for one in flying if not one.lost] or [value(one) for one in flying]
    return Panel(title=title, series=series, limits=around(*span_of(kept)) if kept else None, y=unit, whole_row=True)
