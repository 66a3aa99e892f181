"""Colours, and figures as this package makes them: on white, on dark, for colour-blind readers and on a grey print."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Literal

from matplotlib import rcParams
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from barbalat.pictures.panels import SHARING

Layout = Literal["constrained"]

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#B5609A", "#A87500", "#3391CE")
"""Okabe and Ito's palette, its last three darkened until they have three times the contrast with white that a line needs."""
ON_DARK = ("#4BA6EA", "#FF8B3D", "#2FC79B", "#E39BCB", "#E6B23C", "#9AD1F5")
"""The same, light enough for a dark ground."""
Dash = Literal["-"] | tuple[float, tuple[float, ...]]
DASHES: tuple[Dash, ...] = ("-", (0, (5, 1.6)), (0, (1.2, 1.4)), (0, (6, 1.6, 1.2, 1.6)))
"""Of components of one colour, and of compared things by threes."""
Mark = Literal["", "o", "s", "^", "D"]
MARKS: tuple[Mark, ...] = ("", "o", "s", "^", "D")
"""On lines that have a colour and a dash in common."""
INK, GROUND = "#1a1a1a", "#ffffff"
QUIET_INK = "#6b6b6b"
DARK_INK, DARK_GROUND, DARK_QUIET_INK = "#e8e8e8", "#14171a", "#a3a3a3"

WIDE, NARROW = 10.0, 4.1
"""Width of a figure [in]: for a page and print, and for a phone of 390 pixels, where 8 points are then some 10 pixels."""


@dataclass(frozen=True)
class Theme:
    """What a figure is drawn with; ``current`` follows Matplotlib's own style, such as ``"dark_background"``."""

    colours: tuple[str, ...] = COLOURS
    ink: str = INK
    quiet: str = QUIET_INK

    @classmethod
    def current(cls) -> Theme:
        """For the ground on which Matplotlib draws now."""
        ground = rcParams["figure.facecolor"]
        dark = ground != "none" and sum(to_rgb(ground)) < 1.5  # half of white
        return cls(ON_DARK, DARK_INK, DARK_QUIET_INK) if dark else cls()

    def colour(self, k: int) -> str:
        """Return the colour of the k-th thing compared; ``dash_of`` and ``mark_of`` tell it apart from others of this colour."""
        return self.colours[k % len(self.colours)]


def dash_of(k: int) -> Dash:
    """Return the dash of the k-th thing compared: with its colour it tells ``len(DASHES) * SHARING`` lines apart."""
    return DASHES[k // SHARING % len(DASHES)]


def mark_of(k: int) -> Mark:
    """Return the marker of the k-th thing compared: none unless its colour and dash have been used before."""
    return MARKS[k // (SHARING * len(DASHES)) % len(MARKS)]


class Picture(Figure):
    """A Matplotlib figure that notebooks show, also where nothing of Matplotlib's was imported in them."""

    def _repr_png_(self) -> bytes:
        from barbalat.pictures.render import render

        return render(self, "png")


def new_figure(width: float, height: float, *, shown: bool, layout: Layout | None = None) -> Figure:
    """An empty figure [in]. One to be ``shown`` belongs to pyplot, where that is in use: ``plt.show()`` opens it."""
    pyplot = sys.modules.get("matplotlib.pyplot")
    if shown and pyplot is not None and "inline" not in pyplot.get_backend():  # a notebook shows what a cell returns, once
        managed: Figure = pyplot.figure(figsize=(width, height), layout=layout, FigureClass=Picture)
        return managed
    figure = Picture(figsize=(width, height), layout=layout)
    FigureCanvasAgg(figure)
    return figure
