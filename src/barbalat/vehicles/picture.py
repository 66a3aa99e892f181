"""Draws flights over time and in space; each picture shows all controllers with one failure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from barbalat.pictures.panel_drawing import draw
from barbalat.pictures.panels import Panel, Series, around, span_of, text_of, width_of
from barbalat.pictures.theme import DASHES, NARROW, Theme, dash_of, mark_of, new_figure
from barbalat.validate import Array
from barbalat.vehicles.flight import Flight
from barbalat.vehicles.scene import Scene
from barbalat.vehicles.vehicle import Shown, Vehicle

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

DRAWN_STRIDE = 10
"""Number of samples from one drawn point to the next. At 100 Hz this is 0.1 s, or three pixels on a page."""


def figure_of(vehicle: Vehicle[Any, Any, Any], flights: Sequence[Flight], *, narrow: bool = False, shown: bool = False) -> Figure:
    """Draw the vehicle's panels for the flights of all controllers with one failure. Lost flights are drawn within the ranges of
    the others.

    narrow, shown  as for the picture of a run
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
    """Return every n-th row of a record, and the last row."""
    rows = np.unique([*range(0, len(values), DRAWN_STRIDE), len(values) - 1])
    return np.asarray(values[rows])


PATH_POINTS = 250
"""Number of points of a drawn path. Successive points are a pixel and a half apart on a phone."""
MARKED_EVERY = 25
"""Number of path points from one mark to the next, if the line has marks."""
ELEVATION, AZIMUTH = 24.0, -58.0
"""The viewing direction [deg]."""
PAD = 0.1
"""Space around a picture, and between its legend and its box [in]."""
WIRE_SHARE = 0.05
"""Size of a vehicle's frame, as a fraction of the box's longest side. The frame is drawn larger than to scale."""


def paths_figure(scene: Scene, *, narrow: bool = False, shown: bool = False) -> Figure:
    """Draw all paths, with each vehicle at the end of its path and a cross where a vehicle was lost."""
    width, height = (NARROW, 4.2) if narrow else (8.0, 4.6)
    figure = new_figure(width, height, shown=shown)
    axes = box_of(figure, scene, font=8.0 if narrow else 9.0)
    theme = Theme.current()
    if scene.target is not None:
        axes.plot(*thinned_path(scene.target).T, color=theme.quiet, linewidth=0.9, linestyle=DASHES[1], label="commanded path")
    for k, mover in enumerate(scene.movers):
        colour, width = theme.colour(mover.colour), width_of(k, len(scene.movers))
        label, path = f"{text_of(mover.label)}{', lost' if mover.lost else ''}", inside(scene, thinned_path(mover.path))
        style = {"linestyle": dash_of(mover.colour), "marker": mark_of(mover.colour), "markevery": MARKED_EVERY, "markersize": 4}
        axes.plot(*path.T, color=colour, linewidth=width, label=label, **style)
        if mover.lost:
            axes.plot(*np.clip(mover.path[-1:], *scene.box).T, color=colour, marker="x", markersize=8)
            continue
        for line in frame(scene, mover.path[-1], mover.attitude[-1]):
            axes.plot(*line.T, color=colour, linewidth=1.4)
    columns = 1 if narrow and len(scene.movers) > 6 else 2 if narrow else 3
    figure.legend(loc="upper center", ncols=columns, frameon=False, fontsize=7.5 if narrow else 8.5, columnspacing=1.2)
    _fill(figure, axes, scene)
    return figure


def _fill(figure: Figure, axes: Axes3D, scene: Scene) -> None:
    """Make the box as large as fits below the legend, and the figure only as high as both need. The flight determines the shape
    of the box."""
    width, height = figure.get_size_inches()
    (legend,) = figure.legends
    top = height - legend.get_window_extent().y0 / figure.dpi
    room = np.array([width - 2 * PAD, height - top - PAD])
    side = height
    for _ in range(3):  # repeated, because numbers and labels keep their size
        axes.set_position((0, 0, side / width, side / height))
        low, high = _drawn(figure, axes, scene)
        side *= float((room / (high - low)).min())
    axes.set_position((0, 0, side / width, side / height))
    low, high = _drawn(figure, axes, scene)
    new = float(high[1] - low[1]) + top + PAD
    left, bottom = (width - low[0] - high[0]) / 2, PAD - low[1]
    figure.set_size_inches(width, new)
    axes.set_position((left / width, bottom / new, side / width, side / new))


def _drawn(figure: Figure, axes: Axes3D, scene: Scene) -> tuple[Array, Array]:
    """Return the smallest and largest coordinates of the box with its numbers and labels, from the lower left corner of the
    figure [in]."""
    from mpl_toolkits.mplot3d.proj3d import proj_transform

    figure.draw_without_rendering()
    low, high = scene.box
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1)
    x, y, _ = proj_transform(*corners, axes.get_proj())
    told = [one.get_tightbbox() for one in (axes.xaxis, axes.yaxis, axes.zaxis)]
    ends = [(one.min, one.max) for one in told if one is not None]
    points = np.vstack([axes.transData.transform(np.column_stack([x, y])), *ends]) / figure.dpi
    return points.min(axis=0), points.max(axis=0)


def box_of(figure: Figure, scene: Scene, font: float) -> Axes3D:
    """Return empty axes around everything that is drawn in a scene."""
    from mpl_toolkits.mplot3d import Axes3D

    low, high = scene.box
    axes = Axes3D(figure, rect=(-0.09, -0.03, 1.05, 0.93), elev=ELEVATION, azim=AZIMUTH)
    figure.add_axes(axes)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(tuple(sides(scene)), zoom=0.93)
    for name, direction in zip("xyz", ("forward", "left", "height"), strict=True):
        getattr(axes, f"set_{name}label")(f"{direction} [{scene.unit}]", fontsize=font, labelpad=4)
        axes.locator_params(axis=name, nbins=5)
        axes.tick_params(axis=name, labelsize=font, pad=3 if name == "z" else -1)
    if all(np.ptp(mover.path[:, 1]) == 0 for mover in scene.movers):  # a flight in one plane
        axes.set(yticks=[], ylabel="")
    for side in (axes.xaxis, axes.yaxis, axes.zaxis):
        side.set_pane_color((1.0, 1.0, 1.0, 0.0))  # leaves enough colours of the palette for the lines
    return axes


def sides(scene: Scene) -> Array:
    """Return the drawn length of the box along each axis."""
    low, high = scene.box
    return np.asarray((high - low) / (high - low).max()) if scene.equal else np.array([1.0, 0.5, 0.5])


def frame(scene: Scene, place: Array, attitude: Array) -> list[Array]:
    """Return the lines of a vehicle at a place, undistorted even if the axes' scales differ."""
    low, high = scene.box
    scale = WIRE_SHARE * (high - low) / sides(scene)
    return [place + (line @ attitude.T) * scale for line in scene.wire]


def inside(scene: Scene, points: Array) -> Array:
    """Return the points inside the box; Matplotlib would draw the others beside it."""
    low, high = scene.box
    return np.where(((points >= low) & (points <= high)).all(axis=1)[:, None], points, np.nan)


def thinned_path(points: Array) -> Array:
    """Return about ``PATH_POINTS`` of the points, including the last."""
    every = max(1, len(points) // PATH_POINTS)
    return np.asarray(np.vstack([points[:-1:every], points[-1:]]))
