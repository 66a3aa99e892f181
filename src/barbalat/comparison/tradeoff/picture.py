"""Draws a trade-off: tracking error against the tolerated delay by two criteria, as a cloud and a front for each scheme."""

from __future__ import annotations

import textwrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from barbalat.comparison.tradeoff.tradeoff import Cloud, TradeOff
from barbalat.pictures.labels import LabelPlaces
from barbalat.pictures.symbols import in_symbols
from barbalat.pictures.theme import NARROW, Theme, dash_of, new_figure
from barbalat.validate import Array

MARKS = ("o", "s", "^", "D")
TITLES = {"plant": "the plant of the case", "worst": "worst of the plants in the sample"}
SYMBOLS = {"gamma": "Γ", "kappa": "κ", "slope_ratio": "κ₂/κ", "tau": "τ", "covariance0": "P(0)"}


def criteria(found: TradeOff) -> dict[str, str]:
    """Return one line on each criterion."""
    return {
        "onset": "onset: until the run is lost or in a limit cycle",
        "loss": f"loss: error grown by less than {found.by.lost.share:g} max |x$_m$|, with or without oscillation",
    }


def panels(found: TradeOff) -> list[str]:
    """Return the names of the panels: the case's plant and, if there is a sample, the worst plant in it."""
    return ["plant", "worst"] if len(found.thetas) > 1 else ["plant"]


def draw(found: TradeOff, *, narrow: bool = False, shown: bool = False) -> Figure:
    """Draw a row of panels for each criterion, or, on a phone, stack the panels.

    shown  whether to display the figure at once, if pyplot is in use
    """
    columns = panels(found)
    size = (NARROW, 7.2 * len(columns) + 0.8) if narrow else (6.4 * len(columns), 10.4)
    figure = new_figure(*size, shown=shown, layout="constrained")
    shared: Axes | None = None
    drawn = []
    for i, (criterion, title) in enumerate(criteria(found).items()):
        for j, which in enumerate(columns):
            place = i * len(columns) + j + 1
            axes = figure.add_subplot(
                *((2 * len(columns), 1) if narrow else (2, len(columns))), place, sharex=shared, sharey=shared
            )
            shared = shared or axes
            _panel(axes, found, which, criterion)
            axes.set_title(
                f"{textwrap.fill(title, 44) if narrow else title}\n{TITLES[which]}", fontsize=9 if narrow else "medium"
            )
            drawn.append((axes, which, criterion))
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside lower center", ncols=1 if narrow else len(labels), frameon=False, fontsize="small"
    )
    figure.draw_without_rendering()  # computes the layout, because labels are placed in pixels
    for axes, which, criterion in drawn:
        _label_ends(axes, found, which, criterion)
    return figure


def _panel(axes: Axes, found: TradeOff, which: str, criterion: str) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    edge, theme = found.shortest, Theme.current()
    axes.axvspan(edge / 3, edge, color=theme.quiet, alpha=0.15, zorder=0, linewidth=0)
    axes.annotate(
        "none, or shorter than two steps", (edge / 1.75, 0.5), xycoords=("data", "axes fraction"), rotation=90, fontsize=6.5,
        color=theme.quiet, ha="center", va="center",
    )  # fmt: skip
    for k, cloud in enumerate(found.clouds):
        error, margin = cloud.at(which, criterion)
        shown = np.where(margin > 0, margin, edge / (2.4 - 0.35 * k))  # in the band, with a column for each scheme
        axes.scatter(shown, error, s=9, color=theme.colour(k), marker=MARKS[k % len(MARKS)], alpha=0.22, linewidths=0)
        line = _front(cloud, which, criterion)
        knobs = " × ".join(SYMBOLS.get(name, name) for name in cloud.tunings[0])
        label = f"{cloud.scheme}: {knobs}" if knobs else cloud.scheme
        mark, dash = MARKS[k % len(MARKS)], dash_of(k)
        axes.plot(*line.T, color=theme.colour(k), linestyle=dash, marker=mark, markersize=3.5, linewidth=1.6, label=label)
    axes.set_xlim(left=edge / 3)
    axes.set_xlabel("largest delay tolerated at the plant's input [s]")
    axes.set_ylabel("RMS |e| without delay / RMS |x$_m$|")
    axes.grid(True, which="major", linewidth=0.4, alpha=0.6)


def _front(cloud: Cloud, which: str, criterion: str) -> Array:
    """Return margins and errors (K, 2) of the front."""
    error, margin = cloud.at(which, criterion)
    front = cloud.front(which, criterion)
    return np.column_stack([margin[front], error[front]])


def _label_ends(axes: Axes, found: TradeOff, which: str, criterion: str) -> None:
    """Label the tunings at both ends of each front, and draw an arrow in the direction of improvement."""
    theme = Theme.current()
    lines = [_front(cloud, which, criterion) for cloud in found.clouds]
    labels = LabelPlaces(axes, lines, 6.5)
    for k, (cloud, line) in enumerate(zip(found.clouds, lines, strict=True)):
        front = cloud.front(which, criterion)
        for end in dict.fromkeys([0, len(front) - 1] if len(front) else []):
            labels.place(tuning_text(cloud.tunings[front[end]]) or cloud.scheme, line[end], theme.colour(k))
    axes.annotate(
        "better", xy=(0.985, 0.015), xytext=(0.86, 0.08), xycoords="axes fraction", textcoords="axes fraction",
        fontsize="small", color=theme.quiet, arrowprops={"arrowstyle": "->", "color": theme.quiet},
    )  # fmt: skip


def tuning_text(tuning: dict[str, float]) -> str:
    """Return a tuning in a few characters: Γ 1400, κ 0.02, P(0) 4.3·10⁶."""
    two_digits = {name: in_symbols(f"{float(f'{value:.2g}'):g}") for name, value in tuning.items()}
    return ", ".join(f"{SYMBOLS.get(name, name)} {text}" for name, text in two_digits.items())
