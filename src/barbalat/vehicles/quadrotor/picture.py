"""What a picture of a quadrotor's flights shows: its distance from the path, its height, its tilt, a rotor's thrust."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from barbalat.pictures.panel_drawing import draw
from barbalat.pictures.panels import Panel, Series, around, span_of, text_of, width_of
from barbalat.validate import Array
from barbalat.vehicles.f16.picture import thinned
from barbalat.vehicles.quadrotor.flight import TIMING, QuadrotorFlight

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Shown:
    """What one panel shows; ``commanded`` is the record's column of what is wanted of it."""

    title: str
    unit: str
    value: Callable[[QuadrotorFlight], Array]
    commanded: str | None = None


PANELS = (
    Shown("Distance from where it should be", "[m]", lambda flight: flight.error),
    Shown("Height above the ground", "[m]", lambda flight: flight.column("z"), commanded="z_d"),
    Shown("Tilt", "[deg]", lambda flight: flight.tilt),
    Shown("Thrust of the front left rotor", "[N]", lambda flight: flight.column("thrust_1")),
)


def figure_of(flights: Sequence[QuadrotorFlight], *, narrow: bool = False, shown: bool = False) -> Figure:
    """All schemes through one failure; what lost ones do stands as far as the others' ranges reach."""
    flying = [one for one in flights if len(one.record) > 1]
    panels = [_panel(one, flights, flying) for one in PANELS]
    return draw(panels, TIMING.duration, narrow=narrow, shown=shown)


def _panel(of: Shown, flights: Sequence[QuadrotorFlight], flying: Sequence[QuadrotorFlight]) -> Panel:
    series = [
        Series(
            t=thinned(one.column("t")), value=thinned(of.value(one)), label=text_of(one.controller), colour=i,
            width=width_of(i, len(flights)),
        )
        for i, one in enumerate(flights)
        if one in flying
    ]  # fmt: skip
    if of.commanded is not None and flying:
        longest = max(flying, key=lambda one: len(one.record))
        wanted, t = thinned(longest.column(of.commanded)), thinned(longest.column("t"))
        series.append(Series(t=t, value=wanted, label="commanded", colour="ink", dash=1, width=0.9))
    kept = [of.value(one) for one in flying if not one.lost] or [of.value(one) for one in flying]
    return Panel(title=of.title, series=series, limits=around(*span_of(kept)) if kept else None, y=of.unit, whole_row=True)
