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


OVERLAP_SHARE = 0.15
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


@dataclass(frozen=True)
class Sizes:
    """Of everything on a page or on a phone [in], [points]; fixed, for Matplotlib's own layouts take longer than the drawing."""

    width: float
    left: float
    right: float
    axes: float
    below: float
    font: float
    columns: int

    def across(self, panel: Panel) -> float:
        """Width of a panel's axes [in]."""
        return self.width / (1 if panel.whole_row else self.columns) - self.left - self.right

    def characters(self, panel: Panel) -> int:
        """About as many fit above a panel."""
        return int(self.across(panel) * 72 / (0.56 * self.font))  # DejaVu Sans is 0.56 of its size wide on average

    def above(self, panel: Panel) -> float:
        """Height of title, note and legend [in]."""
        lines = len(_heading(panel, self).splitlines()) + -(-len(_entries(panel)) // _legend_columns(panel, self))
        return 1.42 * self.font * lines / 72 + 0.12


PAGE = Sizes(WIDE, left=0.72, right=0.12, axes=1.75, below=0.5, font=9.0, columns=2)
PHONE = Sizes(NARROW, left=0.62, right=0.1, axes=1.8, below=0.48, font=8.0, columns=1)


def draw(panels: Sequence[Panel], t_end: float, *, narrow: bool = False, shown: bool = False) -> Figure:
    """All panels, two in a row on a page, one on a phone; ``shown`` as of ``new_figure``."""
    sizes = PHONE if narrow else PAGE
    rows, theme = _rows(panels, narrow=narrow), Theme.current()
    outlines = {panel: [_outline(one, panel, sizes.across(panel) / t_end) for one in panel.series] for panel in panels}
    banded = any(found.envelopes for several in outlines.values() for found in several)
    footer = textwrap.wrap(ENVELOPE, 68 if narrow else 200) if banded else []
    heights = [max(map(sizes.above, row)) + sizes.axes + sizes.below for row in rows]
    height = sum(heights) + 1.5 * sizes.font * len(footer) / 72 + 0.05
    figure = new_figure(sizes.width, height, shown=shown)
    top = height
    for row, needed in zip(rows, heights, strict=True):
        top -= needed
        for j, panel in enumerate(row):
            left = sizes.left + j * sizes.width / 2
            place = (left / sizes.width, (top + sizes.below) / height, sizes.across(panel) / sizes.width, sizes.axes / height)
            _draw(figure.add_axes(place), panel, outlines[panel], t_end, theme, sizes)
    if footer:
        patch = Patch(facecolor=theme.quiet, alpha=0.4, linewidth=0)
        figure.legend([patch], ["\n".join(footer)], loc="lower left", frameon=False, fontsize=sizes.font - 0.5, borderaxespad=0)
    return figure


def text_of(name: str) -> str:
    """A name as Matplotlib shows it as it is: no mathematics, no label that legends leave out, none that pushes the axes away."""
    short = name if len(name) <= LONGEST_LABEL else name[: LONGEST_LABEL - 1] + "…"
    return as_typed(short)


def as_typed(text: str) -> str:
    """The same without a limit of its length."""
    return ("\u200b" if text.startswith("_") else "") + text.replace("$", r"\$")


def _rows(panels: Sequence[Panel], *, narrow: bool) -> list[list[Panel]]:
    rows: list[list[Panel]] = []
    for panel in panels:
        beside = rows and len(rows[-1]) == 1 and not (narrow or panel.whole_row or rows[-1][0].whole_row)
        if beside:
            rows[-1].append(panel)
        else:
            rows.append([panel])
    return rows


def _draw(axes: Axes, panel: Panel, outlines: Sequence[Outline], t_end: float, theme: Theme, sizes: Sizes) -> None:
    apart = _apart(axes, panel, outlines, t_end)
    for i, (series, found) in enumerate(zip(panel.series, outlines, strict=True)):
        _series(apart[i % len(apart)], series, found, theme)
    for level in panel.levels:
        for i, one in enumerate(apart):
            if level.of is None or len(apart) == 1 or level.of == i:
                one.axhline(level.value, **_style(theme, level.colour, level.dash), linewidth=0.9)
    for one in apart:
        one.set_yscale(panel.scale, **({"linthresh": 1.0} if panel.scale == "symlog" else {}))
        if panel.limits is not None:
            one.set_ylim(*panel.limits)
        one.set_xlim(0, t_end)
        one.tick_params(labelsize=sizes.font, labelbottom=one is apart[-1])
        one.grid(visible=True, linewidth=0.3)
        one.spines[["top", "right"]].set_visible(False)
    apart[-1].set_xlabel("time t [s]", fontsize=sizes.font)
    _title_and_legend(axes, panel, theme, sizes)


def _apart(axes: Axes, panel: Panel, outlines: Sequence[Outline], t_end: float) -> list[Axes]:
    """Axes for each series where envelopes would cover one another; else the one pair of axes."""
    bands = [_covered(found, t_end) for found in outlines]
    over = [((a[0] < b[1]) & (b[0] < a[1])).mean() for a, b in combinations(bands, 2)]  # false for NaN
    if not panel.may_part or len(outlines) > MOST_APART or max(over, default=0.0) < OVERLAP_SHARE:
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


def _title_and_legend(axes: Axes, panel: Panel, theme: Theme, sizes: Sizes) -> None:
    """Both above the axes, at their left edge, where they cover nothing."""
    handles = [Line2D([], [], label=text, **_style(theme, colour, dash)) for text, colour, dash in _entries(panel)]
    legend = axes.legend(
        handles=handles, title=_heading(panel, sizes), title_fontsize=sizes.font + 0.5, alignment="left", loc="lower left",
        bbox_to_anchor=(-0.01, 0.99), ncols=_legend_columns(panel, sizes), frameon=False, fontsize=sizes.font, borderpad=0.1,
        handlelength=2.0, columnspacing=1.2, labelspacing=0.25,
    )  # fmt: skip
    legend.get_title().set_multialignment("left")


def _heading(panel: Panel, sizes: Sizes) -> str:
    lines = [panel.title, *([panel.note] if panel.note else [])]
    return "\n".join(textwrap.fill(line, sizes.characters(panel)) for line in lines)


def _entries(panel: Panel) -> list[tuple[str, int | str, int]]:
    """Of the legend: text, colour, dash."""
    levels = {level.label: level.dash for level in panel.levels if level.label}
    return [*((one.label, one.colour, one.dash) for one in panel.series), *((text, "quiet", k) for text, k in levels.items())]


def _legend_columns(panel: Panel, sizes: Sizes) -> int:
    entries = _entries(panel)
    longest = max((_length(text) for text, _, _ in entries), default=1)
    return max(min(sizes.characters(panel) // (longest + 7), len(entries)), 1)  # 7: the line before it, the gap behind


def _length(label: str) -> int:
    """Characters that are seen of a label with mathematics in it."""
    return len(re.sub(r"\\hat|[{}$_]", "", re.sub(r"\\[a-gi-z]\w*", "x", label)))


def _style(theme: Theme, colour: int | str, dash: int) -> dict[str, Any]:
    return {"color": _colour(theme, colour), "linestyle": DASHES[dash % len(DASHES)]}


def _colour(theme: Theme, colour: int | str) -> str:
    if isinstance(colour, int):
        return theme.colour(colour)
    return {"ink": theme.ink, "quiet": theme.quiet}[colour]


def span_of(values: Sequence[Array]) -> tuple[float, float]:
    """The least and the greatest finite value of all; (0, 0) where there is none."""
    finite = [part[np.isfinite(part)] for part in map(np.asarray, values)]
    flat = np.concatenate([part.ravel() for part in finite]) if finite else np.zeros(0)
    return (float(flat.min()), float(flat.max())) if len(flat) else (0.0, 0.0)


def around(low: float, high: float) -> tuple[float, float]:
    """Limits of axes with a little room around."""
    room = 0.06 * (high - low) or 0.1 * max(abs(high), 1e-3)
    return low - room, high + room
