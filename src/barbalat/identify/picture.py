"""The plot of an identification: the measurements, the nominal plant on the validation samples, and the residuals."""

from __future__ import annotations

from matplotlib.figure import Figure

from barbalat.identify.result import Identification
from barbalat.pictures.theme import NARROW, WIDE, Theme, dash_of, new_figure


def draw(found: Identification, *, narrow: bool = False, shown: bool = False) -> Figure:
    """A row of panels for each state: its measurements with the simulation over the validation samples, and their difference."""
    data, theme = found.recording, Theme.current()
    n, held = len(data.output_names), len(found.predicted)
    start = len(data.times) - held
    figure = new_figure(NARROW if narrow else WIDE, 2.2 * n * (2 if narrow else 1) + 0.8, shown=shown, layout="constrained")
    grid = (2 * n, 1) if narrow else (n, 2)
    for i, name in enumerate(data.output_names):
        axes = figure.add_subplot(*grid, 2 * i + 1)
        axes.plot(data.times, data.outputs[:, i], color=theme.quiet, linewidth=1.0, label="measured")
        axes.plot(
            data.times[start:], found.predicted[:, i], color=theme.colour(0), linestyle=dash_of(3), linewidth=1.4,
            label="nominal plant, simulated",
        )  # fmt: skip
        if found.trained < len(data.times):
            axes.axvline(data.times[found.trained], color=theme.quiet, linestyle=":", linewidth=1.0)
        axes.set_ylabel(name)
        rest = figure.add_subplot(*grid, 2 * i + 2)
        rest.plot(data.times[start:], data.outputs[start:, i] - found.predicted[:, i], color=theme.colour(1), linewidth=1.0)
        if found.noise is not None:
            for sign in (-1.0, 1.0):
                rest.axhline(sign * found.noise[name], color=theme.quiet, linestyle=":", linewidth=1.0)
        rest.set_ylabel(f"residual of {name}")
        if i == 0:
            axes.set_title(
                "validation data: to the right of the dotted line" if found.trained < len(data.times) else "all samples",
                fontsize=9,
            )
            rest.set_title("measured - simulated" + (", dotted: the noise bound" if found.noise is not None else ""), fontsize=9)
            axes.legend(loc="best", fontsize=8, frameon=False)
        for one in (axes, rest):
            one.grid(visible=True, linewidth=0.3)
            one.spines[["top", "right"]].set_visible(False)
            if i == n - 1:
                one.set_xlabel("time [s]")
    return figure
