"""Responses over frequency: Bode, Nyquist and sensitivity plots of loops with marked margins."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from barbalat.pictures.panels import SHARING, as_typed
from barbalat.pictures.render import power_of_ten
from barbalat.pictures.response import NYQUIST_WINDOW, Response
from barbalat.pictures.symbols import in_symbols
from barbalat.pictures.theme import DASHES, NARROW, WIDE, Dash, Theme, new_figure

DASHES_OF_LOOPS = (DASHES[0], DASHES[2], DASHES[3])
"""Dashes of loops with the same colour. Broken lines are |T|."""
MOST_DECADES = 9
"""Largest number of labels of a logarithmic axis, so that they do not overlap on a phone."""


def draw(responses: Sequence[Response], title: str, *, narrow: bool = False, shown: bool = False) -> Figure:
    """Draw four panels. For ``shown``, see ``new_figure``."""
    figure = new_figure(NARROW if narrow else WIDE, 11.5 if narrow else 7.6, shown=shown, layout="constrained")
    theme = Theme.current()
    places = [(0, 0), (1, 0), (0, 1), (1, 1)]
    grid = figure.add_gridspec(4 if narrow else 2, 1 if narrow else 2)
    magnitude, phase, nyquist, peaks = (
        figure.add_subplot(grid[k, 0] if narrow else grid[place]) for k, place in enumerate(places)
    )
    _axes(magnitude, "Bode: magnitude", "frequency [rad/s]", "|L|", log="both")
    _axes(phase, "Bode: phase", "frequency [rad/s]", "phase of L [degrees]", log="x")
    _axes(nyquist, "Nyquist, around -1", "Re L", "Im L", log="")
    _axes(peaks, "Sensitivity |S| (solid) and |T| (dashed)", "frequency [rad/s]", "", log="both")
    for k, response in enumerate(responses):
        colour = theme.colour(k)
        width, dash = _width(k, len(responses)), _dash(k)
        _bode(magnitude, phase, response, colour, width, dash)
        _nyquist(nyquist, response, colour, width, dash)
        with np.errstate(divide="ignore", invalid="ignore"):
            peaks.plot(response.w, np.abs(1 / (1 + response.L)), color=colour, linewidth=width, linestyle=dash)
            peaks.plot(response.w, np.abs(response.L / (1 + response.L)), color=colour, linewidth=width, linestyle=DASHES[1])
    for axes, level in ((magnitude, 1.0), (phase, -180.0), (peaks, 1.0)):
        axes.axhline(level, color=theme.quiet, linewidth=0.9, linestyle=DASHES[2])
        axes.set_xlim(min(r.w[0] for r in responses), max(r.w[-1] for r in responses))
    lowest, highest = (pick(pick(r.phase) for r in responses) for pick in (min, max))
    phase.set_ylim(max(lowest, -720) - 15, min(highest, 360) + 15)
    peaks.set_ylim(bottom=1e-3)
    _around_minus_one(nyquist, theme)
    _legend(figure, responses, theme, narrow=narrow)
    figure.suptitle(title, fontsize=9.5 if narrow else 11, x=0.01, ha="left")
    return figure


MOST_WIDTHS = 6
"""Number of line widths, equal to the number of colours. With more, lines would hide one another."""
MARKS = {"o": "phase margin: |L| = 1", "s": "gain margin: L real and negative"}


def _width(k: int, count: int) -> float:
    """Return the k-th line's width [points]. Each line is wider than those drawn after it, which shows where they coincide,
    even without colours."""
    return 1.2 + 0.9 * (min(count, MOST_WIDTHS) - 1 - k % MOST_WIDTHS)


def _dash(k: int) -> Dash:
    return DASHES_OF_LOOPS[k // SHARING % len(DASHES_OF_LOOPS)]


def _legend(figure: Figure, responses: Sequence[Response], theme: Theme, *, narrow: bool) -> None:
    width = 60 if narrow else 150
    captions = [as_typed(textwrap.fill(in_symbols(response.caption), width)) for response in responses]
    lines = [
        Line2D([], [], color=theme.colour(k), label=caption, linewidth=_width(k, len(captions)), linestyle=_dash(k))
        for k, caption in enumerate(captions)
    ]
    marks = [Line2D([], [], color=theme.quiet, marker=m, linestyle="", label=t) for m, t in MARKS.items()]
    small = 7.5 if narrow else 8.5
    figure.legend(handles=[*lines, *marks], loc="outside lower left", frameon=False, fontsize=small, alignment="left")


def _axes(axes: Axes, title: str, x: str, y: str, *, log: str) -> None:
    axes.set_title(title, loc="left", fontsize=9.5)
    axes.set_xlabel(x, fontsize=8.5)
    axes.set_ylabel(y, fontsize=8.5)
    axes.tick_params(labelsize=8.5)
    axes.grid(visible=True, linewidth=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    if log:
        axes.set_xscale("log")
        _in_decades(axes.xaxis)
    if log == "both":
        axes.set_yscale("log")
        _in_decades(axes.yaxis)


def _in_decades(axis: Axis) -> None:
    """Label only whole powers of ten, as plain text. Ticks between them and mathtext would take most of a plot's time."""
    axis.set_major_locator(LogLocator(numticks=MOST_DECADES))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: power_of_ten(value)))


def _bode(magnitude: Axes, phase: Axes, response: Response, colour: str, width: float, dash: Dash) -> None:
    size = np.abs(response.L)
    magnitude.plot(response.w, size, color=colour, linewidth=width, linestyle=dash)
    phase.plot(response.w, response.phase, color=colour, linewidth=width, linestyle=dash)
    for mark, w in zip(MARKS, (response.at_phase, response.at_gain), strict=True):
        if w is None:
            continue
        at = int(np.abs(response.w - w).argmin())
        for axes, values, level in ((magnitude, size, 1.0), (phase, response.phase, -180.0)):
            axes.plot(w, values[at], mark, color=colour, markersize=5)
            turned = level if axes is magnitude else level - 360 * np.round((level - values[at]) / 360)
            axes.plot([w, w], [values[at], turned], color=colour, linewidth=2.2, alpha=0.5)  # the margin itself


def _nyquist(axes: Axes, response: Response, colour: str, width: float, dash: Dash) -> None:
    axes.plot(response.L.real, response.L.imag, color=colour, linewidth=width, linestyle=dash)
    axes.plot(response.L.real, -response.L.imag, color=colour, linewidth=0.8, linestyle=DASHES[2])
    for mark, w in zip(MARKS, (response.at_phase, response.at_gain), strict=True):
        if w is not None:
            value = response.value(w)
            axes.plot(value.real, value.imag, mark, color=colour, markersize=5)


def _around_minus_one(axes: Axes, theme: Theme) -> None:
    axes.add_patch(Circle((0, 0), 1.0, fill=False, edgecolor=theme.quiet, linewidth=0.9, linestyle=":"))
    axes.plot(-1, 0, "+", color=theme.ink, markersize=10, markeredgewidth=1.6)
    left, right, low, high = NYQUIST_WINDOW
    axes.set_xlim(left, right)
    axes.set_ylim(low, high)
    axes.set_aspect("equal")
