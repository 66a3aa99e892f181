"""Draws a tuning: the front of each controller, with the objective against the quantity of the first constraint."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.axes import Axes

from barbalat.pictures.theme import NARROW, WIDE, Theme, dash_of, mark_of, new_figure
from barbalat.validate import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from barbalat.comparison.tune.result import Point, Tuned, Tuning

FACTOR_FOR_LOG = 20.0
"""Ratio of the largest to the smallest value above which an axis is logarithmic."""


def draw(found: Tuning, *, narrow: bool = False, shown: bool = False) -> Figure:
    """Draw one panel with the admissible side of the first constraint's limit, the chosen points and the points of the case."""
    if not found.aim.constraints:
        raise InputError("a tuning without a constraint has no front to plot")
    first, theme = found.aim.constraints[0], Theme.current()
    figure = new_figure(NARROW if narrow else WIDE, 4.4, shown=shown, layout="constrained")
    axes = figure.add_subplot()
    for k, (name, one) in enumerate(found.controllers.items()):
        _curve(axes, found, one, name, k)
    axes.axvline(first.requirement.limit, color=theme.quiet, linewidth=1.0, linestyle=":")
    for scale, values in ((axes.set_xscale, _values(found, 0)), (axes.set_yscale, _values(found, 1))):
        positive = [value for value in values if value > 0]
        if positive and min(values) >= 0 and max(positive) > FACTOR_FOR_LOG * min(positive):  # zeros are then omitted
            scale("log")
    axes.set_xlabel(f"{first.quantity.name} (dotted: {first.requirement})", fontsize=9)
    axes.set_ylabel(found.aim.quantity.name, fontsize=9)
    axes.grid(visible=True, linewidth=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="lower left", bbox_to_anchor=(-0.01, 1.0), ncols=1 if narrow else 3, frameon=False, fontsize=9)
    else:
        axes.set_title("no tuning has a value on every plant", loc="left", fontsize=9)
    return figure


def _curve(axes: Axes, found: Tuning, one: Tuned, name: str, k: int) -> None:
    colour = Theme.current().colour(k)
    points = [place for place in (_place(found, point) for point in one.front) if place]
    if points:
        axes.plot(
            *zip(*points, strict=True), color=colour, linestyle=dash_of(k), marker=mark_of(k) or "o", markersize=3, label=name
        )
    for point, mark in ((one.start, "x"), (one.chosen, "*")):
        place = None if point is None else _place(found, point)
        if place:
            axes.plot(*place, color=colour, marker=mark, markersize=11 if mark == "*" else 7, linestyle="none")


def _place(found: Tuning, point: Point) -> tuple[float, float] | None:
    x = point.as_json()["constraints"].get(str(found.aim.constraints[0].requirement))
    y = point.as_json()["value"]
    return None if x is None or y is None else (float(x), float(y))


def _values(found: Tuning, side: int) -> list[float]:
    points = [p for one in found.controllers.values() for p in (*one.front, one.start, *([one.chosen] if one.chosen else []))]
    return [place[side] for place in (_place(found, point) for point in points) if place]
