"""Draws panels over time, wide for a page or narrow for a phone."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from barbalat.pictures.panels import PAGE_LEFT, PAGE_RIGHT, SHARING, Panel, Series
from barbalat.pictures.series import Outline, outline
from barbalat.pictures.symbols import HELD_BLANK
from barbalat.pictures.theme import DASHES, MARKS, NARROW, WIDE, Theme, dash_of, mark_of, new_figure
from barbalat.validate import Array

OVERLAP_SHARE = 0.15
"""Fraction of the time in which two envelopes may overlap before they get separate axes or edges."""
MOST_APART = 4
"""Largest number of axes in place of one panel."""
ENVELOPE = (
    "shaded, between thin lines: the range from the smallest to the largest value of signals that oscillate too fast to be drawn"
)
MARKED_SHARE, MARK_SIZE = 0.12, 3.5
"""Distance between marks on a line, as a fraction of the diagonal of the axes, and size of a mark [points]."""
SHADE, SHADE_AMONG_OTHERS = 0.25, 0.06
"""Opacity of a single envelope, and of overlapping ones, which are distinguished by their edges."""


def draw(panels: Sequence[Panel], t_end: float, *, narrow: bool = False, shown: bool = False) -> Figure:
    """Draw all panels, two in a row on a page and one on a phone. For ``shown``, see ``new_figure``."""
    sizes = PHONE if narrow else PAGE
    rows, theme = _rows(panels, narrow=narrow), Theme.current()
    panels = [panel for row in rows for panel in row]
    outlines = {panel: [_outline(one, panel, t_end, sizes.across(panel)) for one in panel.series] for panel in panels}
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
        patch = Patch(facecolor=to_rgba(theme.quiet, SHADE), edgecolor=theme.quiet, linewidth=0.5)
        figure.legend([patch], ["\n".join(footer)], loc="lower left", frameon=False, fontsize=sizes.font - 0.5, borderaxespad=0)
    return figure


def draw_into(axes: Sequence[Axes], panels: Sequence[Panel], t_end: float) -> None:
    """Draw each panel into axes of a different figure, whose sizes stay unchanged."""
    theme = Theme.current()
    for one, panel in zip(axes, panels, strict=True):
        figure = one.get_figure(root=True)
        assert figure is not None  # the user's axes are already in a figure
        inches = one.get_window_extent().width / figure.dpi
        sizes = replace(PAGE, width=inches + PAGE.left + PAGE.right, columns=1)
        _draw(one, panel, [_outline(series, panel, t_end, inches) for series in panel.series], t_end, theme, sizes)


def _rows(panels: Sequence[Panel], *, narrow: bool) -> list[list[Panel]]:
    rows: list[list[Panel]] = []
    for panel in panels:
        beside = rows and len(rows[-1]) == 1 and not (narrow or panel.whole_row or rows[-1][0].whole_row)
        if beside:
            rows[-1].append(panel)
        else:
            rows.append([panel])
    return [[replace(row[0], whole_row=True)] if len(row) == 1 else row for row in rows]  # leaves no quarter of a page empty


def _draw(axes: Axes, panel: Panel, outlines: Sequence[Outline], t_end: float, theme: Theme, sizes: Sizes) -> None:
    start, end = panel.times or (0.0, t_end)
    over = _overlap(outlines, start, end) >= OVERLAP_SHARE
    apart = _apart(axes, len(outlines)) if over and panel.may_part and len(outlines) <= MOST_APART else [axes]
    for i, (series, found) in enumerate(zip(panel.series, outlines, strict=True)):
        _series(apart[i % len(apart)], series, found, theme, among_others=over and len(apart) == 1)
    for level in panel.levels:
        for i, one in enumerate(apart):
            if level.of is None or len(apart) == 1 or level.of == i:
                one.axhline(level.value, **_style(theme, level.colour, level.dash), linewidth=LEVEL_WIDTH)
    for one in apart:
        one.set_yscale(panel.scale, **({"linthresh": 1.0} if panel.scale == "symlog" else {}))
        if panel.limits is not None:
            one.set_ylim(*panel.limits)
        if panel.scale == "log":
            _plain_ticks(one)
        if panel.scale == "linear":
            one.ticklabel_format(axis="y", useOffset=False)  # an offset would overlap the legend
        one.set_xlim(start, end)
        one.tick_params(labelsize=sizes.font, labelbottom=one is apart[-1])
        one.grid(visible=True, linewidth=0.3)
        one.spines[["top", "right"]].set_visible(False)
    apart[-1].set_xlabel("time t [s]", fontsize=sizes.font)
    apart[len(apart) // 2].set_ylabel(panel.y, fontsize=sizes.font)
    _title_and_legend(axes, panel, theme, sizes)


def _plain_ticks(axes: Axes) -> None:
    """Label the ticks in plain notation, such as 0.2 and 0.5, if the axes span at most three decades."""
    low, high = axes.get_ylim()
    if high <= 1e3 * low:
        several = high > 5 * low
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if several else range(1, 10)))
        axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())


def _overlap(outlines: Sequence[Outline], start: float, end: float) -> float:
    """Return the fraction of the time in which two envelopes overlap, the largest over all pairs."""
    bands = [_covered(found, start, end) for found in outlines]
    return max((float(((a[0] < b[1]) & (b[0] < a[1])).mean()) for a, b in combinations(bands, 2)), default=0.0)  # false for NaN


def _apart(axes: Axes, count: int) -> list[Axes]:
    """Replace the axes with separate axes for each series."""
    axes.set_axis_off()
    height = 1 / count
    return [axes.inset_axes((0.0, 1 - (i + 1) * height, 1.0, 0.9 * height)) for i in range(count)]


def _covered(found: Outline, start: float, end: float) -> tuple[Array, Array]:
    """Return both sides of the envelopes at a few hundred instants, with NaN where there is no envelope."""
    t = np.linspace(start, end, 400)
    sides = np.full((2, len(t)), np.nan)
    for band in found.envelopes:
        within = (t >= band[0, 0]) & (t <= band[0, -1])
        for side, values in zip(sides, band[1:], strict=True):
            side[within] = np.interp(t[within], band[0], values)
    return sides[0], sides[1]


def _outline(series: Series, panel: Panel, t_end: float, inches: float) -> Outline:
    """Return the outline in the scale of the axes, which determines what is visible."""
    there, back = SCALES[panel.scale]
    height = None if panel.limits is None else float(np.ptp(there(np.array(panel.limits))))
    start, end = panel.times or (0.0, t_end)
    series = series if panel.times is None else series.within(start, end)
    low, high = (None if side is None else there(side) for side in (series.low, series.high))
    inches *= float(series.t[-1] - series.t[0]) / (end - start)
    found = outline(series.t, there(series.value), low, high, inches=inches, height=height)
    line = np.array([found.line[0], back(found.line[1])])
    return Outline(line, tuple(np.array([band[0], *map(back, band[1:])]) for band in found.envelopes))


SCALES: dict[str, tuple[Callable[[Array], Array], Callable[[Array], Array]]] = {
    "linear": (np.asarray, np.asarray),
    "log": (np.log10, lambda v: 10.0**v),
    "symlog": (lambda v: np.sign(v) * np.log10(1 + np.abs(v)), lambda v: np.sign(v) * (10.0 ** np.abs(v) - 1)),
}
"""The transformation to the axes' linear scale, and its inverse."""


def _series(axes: Axes, series: Series, found: Outline, theme: Theme, *, among_others: bool) -> None:
    """Draw a series. Overlapping envelopes have edges with different dashes and no middle lines, which would be close
    together."""
    style, mark = _style(theme, series.colour, series.dash), _mark(series.colour, series.dash)
    t, value = found.line
    for band in found.envelopes:
        axes.fill_between(*band, color=style["color"], alpha=SHADE_AMONG_OTHERS if among_others else SHADE, linewidth=0)
        for side in band[1:]:
            axes.plot(band[0], side, linewidth=series.width if among_others else 0.5, **style)
        if among_others:
            value = np.where((t > band[0, 0]) & (t < band[0, -1]), np.nan, value)
    every = (0.02 * (1 + int(series.colour) % 5), MARKED_SHARE) if mark else None
    axes.plot(t, value, linewidth=series.width, marker=mark, markevery=every, markersize=MARK_SIZE, **style)


def _title_and_legend(axes: Axes, panel: Panel, theme: Theme, sizes: Sizes) -> None:
    """Draw title and legend above the axes, at the left edge, where they cover nothing."""
    marks = entries(panel)
    handles = [
        Line2D(
            [], [], label=one.text, linewidth=one.width, marker=_mark(one.colour, one.dash), markersize=MARK_SIZE,
            **_style(theme, one.colour, one.dash),
        )
        for one in marks
    ]  # fmt: skip
    legend = axes.legend(
        handles=handles, title=heading(panel, sizes), title_fontsize=sizes.font + 0.5, alignment="left", loc="lower left",
        bbox_to_anchor=(-0.01, 0.99), ncols=legend_columns(panel, sizes), frameon=False, fontsize=sizes.font, borderpad=0.1,
        handlelength=2.0, columnspacing=1.2, labelspacing=0.25,
    )  # fmt: skip
    legend.get_title().set_multialignment("left")


def _style(theme: Theme, colour: int | str, dash: int | None) -> dict[str, Any]:
    own = dash_of(colour) if dash is None and isinstance(colour, int) else DASHES[(dash or 0) % len(DASHES)]
    return {"color": _colour(theme, colour), "linestyle": own}


def _mark(colour: int | str, dash: int | None) -> str:
    """Return the marker of a compared series whose dash has a different meaning; empty for other series."""
    if not isinstance(colour, int):
        return ""
    return mark_of(colour) if dash is None else MARKS[colour // SHARING % len(MARKS)]


def _colour(theme: Theme, colour: int | str) -> str:
    if isinstance(colour, int):
        return theme.colour(colour)
    return {"ink": theme.ink, "quiet": theme.quiet}[colour]


LEVEL_WIDTH = 0.9
"""Width of a level's line [points]."""


@dataclass(frozen=True)
class Sizes:
    """All sizes on a page or a phone [in] or [points]. They are fixed, because the layouts of Matplotlib take longer than the
    drawing."""

    width: float
    left: float
    right: float
    axes: float
    below: float
    font: float
    columns: int

    def across(self, panel: Panel) -> float:
        """The width of a panel's axes [in]."""
        return self.width / (1 if panel.whole_row else self.columns) - self.left - self.right

    def characters(self, panel: Panel) -> int:
        """The approximate number of characters that fit above a panel."""
        return int(self.across(panel) * 72 / (0.56 * self.font))  # DejaVu Sans is 0.56 of its size wide on average

    def above(self, panel: Panel) -> float:
        """The height of title, note and legend [in]."""
        lines = len(heading(panel, self).splitlines()) + -(-len(entries(panel)) // legend_columns(panel, self))
        return 1.42 * self.font * lines / 72 + 0.12


PAGE = Sizes(WIDE, left=PAGE_LEFT, right=PAGE_RIGHT, axes=1.75, below=0.5, font=9.0, columns=2)
PHONE = Sizes(NARROW, left=0.74, right=0.18, axes=1.8, below=0.48, font=8.0, columns=1)


def heading(panel: Panel, sizes: Sizes) -> str:
    """Return title and note in lines that fit above the panel."""
    lines = [panel.title, *([panel.note] if panel.note else [])]
    return "\n".join(_filled(line, sizes.characters(panel)) for line in lines)


def _filled(text: str, width: int) -> str:
    """Break the text into lines, but not within a formula, because half a formula would show its dollar sign."""
    held = re.sub(r"\$[^$]*\$", lambda formula: formula[0].replace(" ", HELD_BLANK), text)
    return textwrap.fill(held, width).replace(HELD_BLANK, " ")


class Mark(NamedTuple):
    """An entry of a legend. It is drawn like its line, so that its width distinguishes it in grey print."""

    text: str
    colour: int | str
    dash: int | None
    width: float


def entries(panel: Panel) -> list[Mark]:
    """The legend's entries."""
    levels = {level.label: level.dash for level in panel.levels if level.label}
    lines = [Mark(one.label, one.colour, one.dash, one.width) for one in panel.series]
    return [*lines, *(Mark(text, "quiet", dash, LEVEL_WIDTH) for text, dash in levels.items())]


def legend_columns(panel: Panel, sizes: Sizes) -> int:
    """Return how many of the legend's columns fit above the panel."""
    labels = [one.text for one in entries(panel)]
    longest = max(map(_length, labels), default=1)
    return max(min(sizes.characters(panel) // (longest + 7), len(labels)), 1)  # 7: the line before a label and the gap after it


def _length(label: str) -> int:
    """Return the visible length of a label that may contain mathematics."""
    return len(re.sub(r"\\hat|[{}$_]", "", re.sub(r"\\[a-gi-z]\w*", "x", label)))
