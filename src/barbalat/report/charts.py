"""Drawings of charts: one line for each thing compared, its end marked where it was lost."""

from __future__ import annotations

import textwrap

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from barbalat.papers.claim import Chart
from barbalat.pictures.theme import COLOURS, NARROW, dash_of
from barbalat.report.maps import MARKS

PALETTE = (*COLOURS, "black")


def draw(shown: Chart, *, narrow: bool = False) -> Figure:
    """The chart as a figure, for a page or for a phone."""
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
