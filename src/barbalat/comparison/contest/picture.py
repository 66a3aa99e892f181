"""Draws a contest, with a line for each entrant from its best validation run to its worst, and its failures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from barbalat.pictures.theme import NARROW, WIDE, Theme, new_figure
from barbalat.validate import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from barbalat.comparison.contest.result import Contest
    from barbalat.comparison.contest.validation import Validation

EACH_HEIGHT = 0.42
"""Height of an entrant's line with its name above it [in]."""


def draw(found: Contest, *, narrow: bool = False, shown: bool = False) -> Figure:
    """Draw the errors of all validation runs of the entrants that meet the rule, the first entrant at the top. A cross marks the
    error on the worst tuning plant."""
    if not found.held_out:
        raise InputError("no entrant satisfies the rule, so there are no validation runs to draw")
    theme, names = Theme.current(), [one.name for one in found.entrants if one.name in found.held_out]
    figure = new_figure(NARROW if narrow else WIDE, 1.3 + EACH_HEIGHT * len(names), shown=shown, layout="constrained")
    axes = figure.add_subplot()
    axes.set_xscale("log")
    for k, name in enumerate(names):
        _line(axes, found.held_out[name], name, -k, theme)
        axes.plot(
            found[name].error / found.motion, -k, marker="x", color=theme.colour(1), markersize=7, linestyle="none", zorder=4
        )
    axes.set_yticks([])
    axes.set_ylim(-len(names) + 0.4, 0.8)
    axes.set_xlabel("RMS |e| / RMS |x$_m$| (× on the worst tuning plant)" if narrow else
                    "RMS |e| over RMS |x$_m$| of each validation run (× on the worst tuning plant)",
                    fontsize=9)  # fmt: skip
    axes.tick_params(labelsize=9)
    axes.grid(visible=True, axis="x", linewidth=0.3)
    axes.spines[["top", "right", "left"]].set_visible(False)
    return figure


def _line(axes: Axes, held: Validation, name: str, y: float, theme: Theme) -> None:
    errors, failed = held.error[np.isfinite(held.error)], int(np.isinf(held.error).sum())
    colour = theme.colour(0)
    said = f"{name}: {failed} of {len(held.error)} failed" if failed else name
    axes.annotate(said, (0.0, y + 0.16), xycoords=("axes fraction", "data"), fontsize=9, color=theme.ink, va="bottom")
    if not len(errors):
        return
    axes.plot(errors, np.full(len(errors), y), marker="|", color=colour, markersize=7, linestyle="none", alpha=0.35)
    middle = held.quantiles["median"]
    if np.isfinite(middle):
        axes.plot(middle, y, marker="o", color=theme.ink, markersize=5, linestyle="none", zorder=3)  # above the strokes
