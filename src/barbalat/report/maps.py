"""Drawings of maps, which show a quantity in colour over two settings. Lost runs are hatched in grey, and predicted boundaries
are lines."""

from __future__ import annotations

import textwrap

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import Normal, withStroke

from barbalat.papers.claim import Chart, ChartAxis, Curve, Map
from barbalat.pictures.palette import COLOURS
from barbalat.pictures.theme import NARROW, dash_of
from barbalat.validate import Array

COLOUR_MAP = "viridis"
"""A colour map of uniform lightness, readable in grey and with common forms of colour blindness."""
DASHES = ("-", "--", ":", "-.")
MARKS = ("o", "s", "^", "D", "v")


def draw(shown: Map, *, narrow: bool = False) -> Figure:
    """Draw the map as a figure for a page, or, with ``narrow``, for a phone."""
    figure = Figure(figsize=(NARROW, 3.9) if narrow else (7, 4.8), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.patch.set(facecolor="0.85", edgecolor="0.45", hatch="////", linewidth=0)  # visible wherever the map has no colour
    x, y = _edges(shown.x), _edges(shown.y)
    lost = np.isnan(shown.values)
    handles: list[Artist] = []
    if not lost.all():
        found = shown.values[~lost]
        scale = (LogNorm if shown.logarithmic else Normalize)(found.min(), found.max())
        mesh = axes.pcolormesh(x, y, np.ma.masked_array(shown.values, lost), cmap=COLOUR_MAP, norm=scale)
        mesh.set_rasterized(True)  # as vectors, the cells would show hairlines between them
        figure.colorbar(mesh, ax=axes, label=shown.quantity)
    if lost.any():
        handles.append(Patch(facecolor="0.85", edgecolor="0.45", hatch="////", linewidth=0, label=shown.lost))
    handles += [_curve(axes, k, curve) for k, curve in enumerate(shown.curves)]
    for name, axis, edges in (("x", shown.x, x), ("y", shown.y, y)):
        axes.set(**{f"{name}scale": "log" if axis.logarithmic else "linear", f"{name}label": axis.label})
        axes.set(**{f"{name}lim": (edges[0], edges[-1])})
    axes.set_title(textwrap.fill(shown.title, 44) if narrow else shown.title, fontsize="medium")
    if handles:
        figure.legend(
            handles=handles,
            loc="outside lower center",
            fontsize="small",
            frameon=False,
            ncols=1 if narrow else min(len(handles), 3),
        )
    return figure


def _curve(axes: Axes, k: int, curve: Curve) -> Artist:
    """Draw a line, or marks for a set of points. Both have a white outline, which makes them visible on dark cells."""
    style = MARKS[k % len(MARKS)] if curve.marks else DASHES[k % len(DASHES)]
    rim = [withStroke(linewidth=3, foreground="white"), Normal()]
    (line,) = axes.plot(curve.x, curve.y, style, color="black", linewidth=1.4, label=curve.label, path_effects=rim)
    return line


def _edges(axis: ChartAxis) -> Array:
    """Return the borders of the cells around the values of an axis."""
    values = np.log(axis.values) if axis.logarithmic else axis.values
    middle = (values[1:] + values[:-1]) / 2
    edges = np.concatenate([[2 * values[0] - middle[0]], middle, [2 * values[-1] - middle[-1]]])
    return np.exp(edges) if axis.logarithmic else edges


PALETTE = (*COLOURS, "black")


def draw_chart(shown: Chart, *, narrow: bool = False) -> Figure:
    """Draw the chart as a figure for a page, or, with ``narrow``, for a phone."""
    figure = Figure(figsize=(NARROW, 4.8) if narrow else (7, 5.2), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    end = shown.x.values[-1]
    any_lost = False
    for k, curve in enumerate(shown.curves):
        colour = PALETTE[k % len(PALETTE)]
        mark = MARKS[k % len(MARKS)]
        axes.plot(
            curve.x, curve.y, marker=mark, markersize=3.5, color=colour, linewidth=1.2, linestyle=dash_of(k), label=curve.label
        )
        if len(curve.x) and curve.x[-1] < end:
            axes.plot(curve.x[-1], curve.y[-1], "x", color=colour, markersize=10, markeredgewidth=2)
            any_lost = True
    for level in shown.levels:
        axes.plot(level.x, level.y, color="0.5", linewidth=1, linestyle="--", label=level.label)
    axes.set(xscale="log", yscale="log", xlabel=shown.x.label, ylabel=shown.quantity)
    axes.set_xlim(shown.x.values[0], end)
    axes.grid(visible=True, which="major", linewidth=0.3)
    axes.set_title(textwrap.fill(shown.title, 44) if narrow else shown.title, fontsize="medium")
    handles, _ = axes.get_legend_handles_labels()
    if any_lost:
        handles.append(Line2D([], [], color="0.3", marker="x", markersize=8, markeredgewidth=2, linestyle="", label=shown.lost))
    figure.legend(handles=handles, loc="outside lower center", fontsize="small", frameon=False, ncols=1 if narrow else 3)
    return figure
