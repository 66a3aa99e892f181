"""Colours and new figures. They are designed for light and dark backgrounds, colour-blind readers and grey print."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Literal

from matplotlib import rcParams
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from barbalat.pictures.palette import COLOURS, ON_DARK
from barbalat.pictures.panels import PAGE_WIDTH, SHARING

Layout = Literal["constrained"]

Dash = Literal["-"] | tuple[float, tuple[float, ...]]
DASHES: tuple[Dash, ...] = ("-", (0, (5, 1.6)), (0, (1.2, 1.4)), (0, (6, 1.6, 1.2, 1.6)))
"""Dashes that distinguish components of one colour, and each group of three compared objects from the next."""
Mark = Literal["", "o", "s", "^", "D"]
MARKS: tuple[Mark, ...] = ("", "o", "s", "^", "D")
"""Markers of lines that share a colour and a dash."""
INK, GROUND = "#1a1a1a", "#ffffff"
QUIET_INK = "#6b6b6b"
DARK_INK, DARK_GROUND, DARK_QUIET_INK = "#e8e8e8", "#14171a", "#a3a3a3"

WIDE, NARROW = PAGE_WIDTH, 4.1
"""Width of a figure [in]: for a page and print, and for a phone of 390 pixels, on which 8 points are about 10 pixels."""


@dataclass(frozen=True)
class Theme:
    """The colours of a figure. ``current`` follows Matplotlib's style, such as ``"dark_background"``."""

    colours: tuple[str, ...] = COLOURS
    ink: str = INK
    quiet: str = QUIET_INK

    @classmethod
    def current(cls) -> Theme:
        """Return the theme for the background that Matplotlib currently uses."""
        ground = rcParams["figure.facecolor"]
        dark = ground != "none" and sum(to_rgb(ground)) < 1.5  # half of white
        return cls(ON_DARK, DARK_INK, DARK_QUIET_INK) if dark else cls()

    def colour(self, k: int) -> str:
        """Return the colour of the k-th compared object; ``dash_of`` and ``mark_of`` distinguish it from others of this
        colour."""
        return self.colours[k % len(self.colours)]


def dash_of(k: int) -> Dash:
    """Return the dash of the k-th compared object. Colour and dash together distinguish ``len(DASHES) * SHARING`` lines."""
    return DASHES[k // SHARING % len(DASHES)]


def mark_of(k: int) -> Mark:
    """Return the marker of the k-th compared object. It has a marker only if its colour and dash are already in use."""
    return MARKS[k // (SHARING * len(DASHES)) % len(MARKS)]


class Picture(Figure):
    """A Matplotlib figure that a notebook shows even if it has not imported Matplotlib."""

    def _repr_png_(self) -> bytes:
        from barbalat.pictures.render import render

        return render(self, "png")


def new_figure(width: float, height: float, *, shown: bool, layout: Layout | None = None) -> Figure:
    """Return an empty figure of this size [in]. If ``shown`` and pyplot is in use, pyplot owns it and ``plt.show()`` opens it."""
    pyplot = sys.modules.get("matplotlib.pyplot")
    if shown and pyplot is not None and "inline" not in pyplot.get_backend():  # a notebook shows the result of a cell once
        managed: Figure = pyplot.figure(figsize=(width, height), layout=layout, FigureClass=Picture)
        return managed
    figure = Picture(figsize=(width, height), layout=layout)
    FigureCanvasAgg(figure)
    return figure
