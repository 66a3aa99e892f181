"""Panels over time: what each shows as data, and one way to draw them, wide for a page or narrow for a phone."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from barbalat.pictures.series import Outline, outline
from barbalat.pictures.theme import DASHES, NARROW, WIDE, Theme, new_figure
from barbalat.validate import Array

LONGEST_LABEL = 40
"""Characters of a name in a picture: a legend has room for no more."""
INKS = ("ink", "quiet")
"""Names of the colours that belong to no compared thing: of the model and of the command."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Series:
    """A quantity over time.

    colour     a compared thing's number, or one of ``INKS``
    low, high  (K - 1,) extrema between the instants, where they are known
    """

    t: Array
    value: Array
    label: str
    colour: int | str = 0
    dash: int = 0
    low: Array | None = None
    high: Array | None = None
    width: float = 1.1


@dataclass(frozen=True, kw_only=True)
class Level:
    """A horizontal line, such as a limit or a true value; one for each label stands in the legend.

    of  the number of the series that it belongs to; ``None`` for all
    """

    value: float
    colour: int | str = "quiet"
    dash: int = 2
    label: str = ""
    of: int | None = None


COVERED = 0.15
"""Share of the time in which two envelopes may lie over one another before each series gets axes of its own."""
MOST_APART = 4
"""Axes in the place of one panel."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Panel:
    """One pair of axes over time.

    limits      what of the values is shown; all by default
    scale       "linear", "log" or "symlog"
    note        a line below the title
    whole_row   whether it has a page's whole width
    may_part    whether series whose envelopes would cover one another get axes of their own
    """

    title: str
    series: Sequence[Series]
    levels: Sequence[Level] = ()
    limits: tuple[float, float] | None = None
    scale: str = "linear"
    note: str = ""
    whole_row: bool = False
    may_part: bool = False


ENVELOPE = "shaded: from the least to the greatest value of what oscillates too fast to be drawn; the line in it is their middle"


def draw(panels: Sequence[Panel], t_end: float, *, narrow: bool = False, shown: bool = False) -> Figure:
    """All panels, two in a row on a page, one on a phone; ``shown`` as of ``new_figure``."""
    rows = _rows(panels, narrow=narrow)
    heights = [3.0 if narrow else 2.9 if len(row) == 1 and row[0].whole_row else 2.6 for row in rows]
    figure = new_figure(NARROW if narrow else WIDE, sum(heights) + 0.3, shown=shown)
    grid, theme = figure.add_gridspec(len(rows), 2, height_ratios=heights), Theme.current()
    banded = False
    for i, row in enumerate(rows):
        for j, panel in enumerate(row):
            place = grid[i, :] if narrow or panel.whole_row else grid[i, j]
            banded |= _draw(figure.add_subplot(place), panel, t_end, theme, narrow=narrow)
    if banded:
        text = _folded(ENVELOPE, 62) if narrow else ENVELOPE
        patch = Patch(facecolor=theme.quiet, alpha=0.4, linewidth=0)
        figure.legend([patch], [text], loc="outside lower left", frameon=False, fontsize=7.5 if narrow else 8.5)
    return figure


def text_of(name: str) -> str:
    """A name as Matplotlib shows it as it is: no mathematics, no label that legends leave out, none that pushes the axes away."""
    short = name if len(name) <= LONGEST_LABEL else name[: LONGEST_LABEL - 1] + "…"
    return ("\u200b" if short.startswith("_") else "") + short.replace("$", r"\$")


def _rows(panels: Sequence[Panel], *, narrow: bool) -> list[list[Panel]]:
    rows: list[list[Panel]] = []
    for panel in panels:
        beside = rows and len(rows[-1]) == 1 and not (narrow or panel.whole_row or rows[-1][0].whole_row)
        if beside:
            rows[-1].append(panel)
        else:
            rows.append([panel])
    return rows


def _draw(axes: Axes, panel: Panel, t_end: float, theme: Theme, *, narrow: bool) -> bool:
    """Draw one panel; whether there is an envelope in it."""
    inches = NARROW if narrow else WIDE if panel.whole_row else WIDE / 2
    outlines = [_outline(one, panel, 0.85 * inches / t_end) for one in panel.series]
    apart = _apart(axes, panel, outlines, t_end)
    for i, (series, found) in enumerate(zip(panel.series, outlines, strict=True)):
        _series(apart[i % len(apart)], series, found, theme)
    for level in panel.levels:
        for i, one in enumerate(apart):
            if level.of is None or len(apart) == 1 or level.of == i:
                one.axhline(level.value, **_style(theme, level.colour, level.dash), linewidth=0.9)
    size = 8.0 if narrow else 9.0
    for one in apart:
        one.set_yscale(panel.scale, **({"linthresh": 1.0} if panel.scale == "symlog" else {}))
        if panel.limits is not None:
            one.set_ylim(*panel.limits)
        one.set_xlim(0, t_end)
        one.tick_params(labelsize=size, labelbottom=one is apart[-1])
        one.grid(visible=True, linewidth=0.3)
        one.spines[["top", "right"]].set_visible(False)
    apart[-1].set_xlabel("time t [s]", fontsize=size)
    _title_and_legend(axes, panel, theme, size, narrow=narrow)
    return any(found.envelopes for found in outlines)


def _apart(axes: Axes, panel: Panel, outlines: Sequence[Outline], t_end: float) -> list[Axes]:
    """Axes for each series where envelopes would cover one another; else the one pair of axes."""
    bands = [_covered(found, t_end) for found in outlines]
    over = [((a[0] < b[1]) & (b[0] < a[1])).mean() for a, b in combinations(bands, 2)]  # false for NaN
    if not panel.may_part or len(outlines) > MOST_APART or max(over, default=0.0) < COVERED:
        return [axes]
    axes.set_axis_off()
    height = 1 / len(outlines)
    return [axes.inset_axes((0.0, 1 - (i + 1) * height, 1.0, 0.9 * height)) for i in range(len(outlines))]


def _covered(found: Outline, t_end: float) -> tuple[Array, Array]:
    """Both sides of the envelopes at a few hundred instants; NaN where there is none."""
    t = np.linspace(0, t_end, 400)
    sides = np.full((2, len(t)), np.nan)
    for band in found.envelopes:
        within = (t >= band[0, 0]) & (t <= band[0, -1])
        for side, values in zip(sides, band[1:], strict=True):
            side[within] = np.interp(t[within], band[0], values)
    return sides[0], sides[1]


def _outline(series: Series, panel: Panel, inches_per_second: float) -> Outline:
    """In the axes' own scale: what is seen there decides."""
    there, back = SCALES[panel.scale]
    height = None if panel.limits is None else float(np.ptp(there(np.array(panel.limits))))
    low, high = (None if side is None else there(side) for side in (series.low, series.high))
    inches = inches_per_second * float(series.t[-1] - series.t[0])
    found = outline(series.t, there(series.value), low, high, inches=inches, height=height)
    line = np.array([found.line[0], back(found.line[1])])
    return Outline(line, tuple(np.array([band[0], *map(back, band[1:])]) for band in found.envelopes))


SCALES: dict[str, tuple[Callable[[Array], Array], Callable[[Array], Array]]] = {
    "linear": (np.asarray, np.asarray),
    "log": (np.log10, lambda v: 10.0**v),
    "symlog": (lambda v: np.sign(v) * np.log10(1 + np.abs(v)), lambda v: np.sign(v) * (10.0 ** np.abs(v) - 1)),
}
"""To what is even on the axes, and back."""


def _series(axes: Axes, series: Series, found: Outline, theme: Theme) -> None:
    style = _style(theme, series.colour, series.dash)
    for band in found.envelopes:
        axes.fill_between(*band, color=style["color"], alpha=0.4, linewidth=0)
    axes.plot(*found.line, linewidth=series.width, **style)


def _title_and_legend(axes: Axes, panel: Panel, theme: Theme, size: float, *, narrow: bool) -> None:
    """Both above the axes, at their left edge, where they cover nothing."""
    handles = [Line2D([], [], label=s.label, **_style(theme, s.colour, s.dash)) for s in panel.series]
    labels = {level.label: level for level in panel.levels if level.label}
    handles += [Line2D([], [], label=text, **_style(theme, "quiet", level.dash)) for text, level in labels.items()]
    lines = [panel.title, *([panel.note] if panel.note else [])]
    across = 50 if narrow else 130 if panel.whole_row else 62
    title = "\n".join(_folded(line, across) for line in lines)
    longest = max((_length(str(handle.get_label())) for handle in handles), default=1)
    columns = max(min(across // (longest + 6), len(handles)), 1)
    legend = axes.legend(
        handles=handles, title=title, title_fontsize=size + 0.5, alignment="left", loc="lower left", bbox_to_anchor=(-0.01, 0.99),
        ncols=columns, frameon=False, fontsize=size, borderpad=0.1, handlelength=2.0, columnspacing=1.2, labelspacing=0.25,
    )  # fmt: skip
    legend.get_title().set_multialignment("left")


def _length(label: str) -> int:
    """Characters that are seen of a label with mathematics in it."""
    return len(re.sub(r"\\hat|[{}$_]", "", re.sub(r"\\[a-gi-z]\w*", "x", label)))


def _style(theme: Theme, colour: int | str, dash: int) -> dict[str, Any]:
    return {"color": _colour(theme, colour), "linestyle": DASHES[dash % len(DASHES)]}


def _colour(theme: Theme, colour: int | str) -> str:
    if isinstance(colour, int):
        return theme.colour(colour)
    return {"ink": theme.ink, "quiet": theme.quiet}[colour]


def _folded(text: str, width: int) -> str:
    return "\n".join(textwrap.wrap(text, width))


def span_of(values: Sequence[Array]) -> tuple[float, float]:
    """The least and the greatest finite value of all; (0, 0) where there is none."""
    finite = [part[np.isfinite(part)] for part in map(np.asarray, values)]
    flat = np.concatenate([part.ravel() for part in finite]) if finite else np.zeros(0)
    return (float(flat.min()), float(flat.max())) if len(flat) else (0.0, 0.0)


def around(low: float, high: float) -> tuple[float, float]:
    """Limits of axes with a little room around."""
    room = 0.06 * (high - low) or 0.1 * max(abs(high), 1e-3)
    return low - room, high + room
