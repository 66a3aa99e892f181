"""The picture of Theorem 2's trade-off: the smallest tau that is borne over the modelling error, and what each tau costs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from barbalat.pictures.theme import WIDE, Theme, dash_of, new_figure

if TYPE_CHECKING:
    from barbalat.study.tau_limit import TauLimits

FIGURE_HEIGHT = 3.8
"""Of the figure [in]."""
MOST_CURVES = 6
"""Sizes of the modelling error whose curves can be told apart."""


def draw(found: TauLimits, *, shown: bool = False) -> Figure:
    """Two panels beside one another; ``shown`` as of ``new_figure``."""
    figure = new_figure(WIDE, FIGURE_HEIGHT, shown=shown, layout="constrained")
    limits, errors = figure.subplots(1, 2)
    _limits(limits, found)
    _errors(errors, found)
    return figure


def _limits(axes: Axes, found: TauLimits) -> None:
    theme, lost = Theme.current(), found.loses > 0
    axes.plot(found.sizes, found.bears, "o-", color=theme.colour(0), markersize=4, label="smallest tau borne")
    axes.plot(found.sizes[lost], found.loses[lost], "x", color=theme.colour(1), markersize=6, label="largest tau lost below it")
    _axes(axes, "Lower limit of tau", "size of the modelling error", "tau")


def _errors(axes: Axes, found: TauLimits) -> None:
    theme = Theme.current()
    chosen = np.unique(np.linspace(0, len(found.sizes) - 1, min(len(found.sizes), MOST_CURVES)).round().astype(int))
    for k, i in enumerate(chosen):
        axes.plot(
            found.taus,
            found.tail[i],
            linestyle=dash_of(k),
            marker="o",
            color=theme.colour(k),
            markersize=3,
            label=f"size {found.sizes[i]:.3g}",
        )
    _axes(axes, "Error where tau is borne", "tau", "largest |e| in the tail")


def _axes(axes: Axes, title: str, x: str, y: str) -> None:
    axes.set(xscale="log", yscale="log")
    axes.set_xlabel(x, fontsize=9)
    axes.set_ylabel(y, fontsize=9)
    axes.tick_params(labelsize=9)
    axes.grid(visible=True, linewidth=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(title=title, loc="lower left", bbox_to_anchor=(-0.01, 1.0), ncols=3, frameon=False, fontsize=9, alignment="left")
