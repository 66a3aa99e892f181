"""Distributions: the fraction of many runs whose value is at most, or at least, a given value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from barbalat.pictures.panels import width_of
from barbalat.pictures.theme import NARROW, WIDE, Theme, dash_of, new_figure
from barbalat.validate import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Shares:
    """A panel with the values of all runs for each name. A value that is not finite counts as larger than any other.

    at_least  whether the fraction counts runs with at least a value; otherwise it counts those with at most that value
    """

    title: str
    axis: str
    values: dict[str, Array]
    at_least: bool = False


def draw(panels: Sequence[Shares], note: str, *, shown: bool = False) -> Figure:
    """Draw the panels side by side. For ``shown``, see ``new_figure``."""
    figure = new_figure(WIDE if len(panels) > 1 else 1.4 * NARROW, 3.6, shown=shown, layout="constrained")
    theme = Theme.current()
    for axes, panel in zip(np.ravel(figure.subplots(1, len(panels), squeeze=False)), panels, strict=True):
        drawn = [_curve(values, at_least=panel.at_least) for values in panel.values.values()]
        for k, (label, (x, share)) in enumerate(zip(panel.values, drawn, strict=True)):
            axes.step(
                x,
                share,
                where="post",
                color=theme.colour(k),
                linestyle=dash_of(k),
                linewidth=width_of(k, len(drawn)),
                label=label,
            )
        finite = np.concatenate([x for x, _ in drawn])
        if len(finite) and finite.min() > 0 and finite.max() > 20 * finite.min():
            axes.set_xscale("log")
        axes.set_ylim(-0.02, 1.02)
        axes.set_xlabel(panel.axis, fontsize=9)
        axes.set_ylabel(
            "fraction of the runs with at least this" if panel.at_least else "fraction of the runs with at most this", fontsize=9
        )
        axes.tick_params(labelsize=9)
        axes.grid(visible=True, linewidth=0.3)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(
            title=panel.title, loc="lower left", bbox_to_anchor=(-0.01, 1.0), ncols=4, frameon=False, fontsize=9, alignment="left"
        )
    if note:
        figure.supxlabel(note, fontsize=8.5, x=0.01, ha="left")
    return figure


def _curve(values: Array, *, at_least: bool) -> tuple[Array, Array]:
    """Return the sorted finite values and, for each, the fraction of runs with at most, or at least, this value."""
    finite = np.sort(values[np.isfinite(values)])
    count = np.arange(1, len(finite) + 1) / max(len(values), 1)
    return finite, 1 - count + 1 / max(len(values), 1) if at_least else count
