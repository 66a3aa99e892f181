"""Panels over time as data: series, levels and limits. ``panel_drawing`` draws them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from barbalat.pictures.symbols import in_symbols
from barbalat.validate import Array, InputError, hint, show

LONGEST_LABEL = 40
"""Largest number of characters of a name in a plot. A legend has no room for more."""
PAGE_WIDTH, PAGE_LEFT, PAGE_RIGHT = 10.0, 0.84, 0.22
"""Width of a figure for a page or for print, and of the margins to the left and right of its axes [in]."""
SHARING = 3
"""Number of neighbouring colours of the palette that have the same dash. The last three colours are close to the first three: sky
blue is close to blue for everybody (a distance of 12 in CIELAB), and ochre to vermilion for the red-green blind (3 to 5). Six
colours would therefore be only four hues."""


def width_of(k: int, count: int) -> float:
    """Return the k-th line's width.

    Each line is wider than those drawn after it. This shows where lines coincide and distinguishes them in a grey print. Dashed
    lines all have the same width, because lines below them are visible through the gaps, and wide dashes would not fit into a
    legend's line.
    """
    return 1.1 + 0.5 * max(min(count - 1, SHARING) - k, 0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Series:
    """A quantity over time.

    colour     the index of a compared object, or "ink" or "quiet" for the model and the command, which are not compared
    dash       from ``DASHES``; None for the dash that belongs to the index of the compared object (see ``dash_of``)
    low, high  (K - 1,) extrema between the instants, if they are known
    """

    t: Array
    value: Array
    label: str
    colour: int | str = 0
    dash: int | None = None
    low: Array | None = None
    high: Array | None = None
    width: float = 1.1

    def within(self, start: float, end: float) -> Series:
        """Return the part from the last instant at or before ``start`` to the first instant at or after ``end``; at least two
        instants."""
        first = max(min(int(np.searchsorted(self.t, start, side="right")) - 1, len(self.t) - 2), 0)
        last = max(int(np.searchsorted(self.t, end)), first + 1)
        low, high = (None if side is None else side[first:last] for side in (self.low, self.high))
        return replace(self, t=self.t[first : last + 1], value=self.value[first : last + 1], low=low, high=high)


@dataclass(frozen=True, kw_only=True)
class Level:
    """A horizontal line, such as a limit or a true value; each label appears once in the legend.

    of  the index of the series to which it belongs; ``None`` for all series
    """

    value: float
    colour: int | str = "quiet"
    dash: int = 2
    label: str = ""
    of: int | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Panel:
    """One pair of axes over time.

    limits      the displayed range of values; all by default
    scale       "linear", "log" or "symlog"
    note        a line below the title
    whole_row   whether the panel has a page's whole width
    may_part    whether series whose envelopes would overlap get separate axes
    y           the label of the vertical axis
    times       the displayed interval of time; the whole run by default
    names       names by which users select the panel
    """

    title: str
    series: Sequence[Series]
    levels: Sequence[Level] = ()
    limits: tuple[float, float] | None = None
    scale: str = "linear"
    note: str = ""
    whole_row: bool = False
    may_part: bool = False
    y: str = ""
    times: tuple[float, float] | None = None
    names: tuple[str, ...] = ()


def chosen(panels: Sequence[Panel], names: str | Iterable[str]) -> list[Panel]:
    """Return the panels that have one of these names, in the order of the names. Raises InputError for an unknown name."""
    known = list(dict.fromkeys(name for panel in panels for name in panel.names))
    found: list[Panel] = []
    for name in [names] if isinstance(names, str) else names:
        if name not in known:
            raise InputError.of("panels", f"must be one of {', '.join(known)}, got {show(name)}{hint(name, known)}")
        found += [panel for panel in panels if name in panel.names and panel not in found]
    if not found:
        raise InputError.of("panels", f"must name at least one of {', '.join(known)}, got none")
    return found


def text_of(name: str) -> str:
    """Return a name as a plot shows it: γ 10⁶ for gamma 1e6, without Matplotlib's math markup and short enough for a label."""
    name = in_symbols(name)
    short = name if len(name) <= LONGEST_LABEL else name[: LONGEST_LABEL - 1] + "…"
    return as_typed(short)


def as_typed(text: str) -> str:
    """Return the text in a form that Matplotlib shows literally: without mathematics, and not as a label that legends omit."""
    return ("\u200b" if text.startswith("_") else "") + text.replace("$", r"\$")


def span_of(values: Sequence[Array]) -> tuple[float, float]:
    """Return the smallest and the largest finite value of all; (0, 0) if there is none."""
    finite = [part[np.isfinite(part)] for part in map(np.asarray, values)]
    flat = np.concatenate([part.ravel() for part in finite]) if finite else np.zeros(0)
    return (float(flat.min()), float(flat.max())) if len(flat) else (0.0, 0.0)


def around(low: float, high: float) -> tuple[float, float]:
    """Return limits of axes with a little room around the values."""
    room = 0.06 * (high - low) or 0.1 * max(abs(high), 1e-3)
    return low - room, high + room
