"""The picture of a trade-off: tracking error against delay margin, a cloud and a front for each scheme."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from barbalat.report.numbers import number_text
from barbalat.report.plots import COLOURS
from barbalat.study.tradeoff import Cloud, TradeOff

MARKS = ("o", "s", "^", "D")
TITLES = {"plant": "the case's own plant", "worst": "worst of the plants in the sample"}


def draw(found: TradeOff) -> Figure:
    """Two panels: the case's plant, and the worst over the sample where there is one."""
    panels = ["plant", "worst"] if len(found.thetas) > 1 else ["plant"]
    figure = Figure(figsize=(6.2 * len(panels), 5.4), layout="constrained")
    FigureCanvasAgg(figure)
    shared: Axes | None = None
    for j, which in enumerate(panels):
        axes = figure.add_subplot(1, len(panels), j + 1, sharex=shared, sharey=shared)
        shared = shared or axes
        for k, cloud in enumerate(found.clouds):
            _scheme(axes, cloud, which, COLOURS[k], MARKS[k])
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel("delay that the loop bears at the plant's input [s]")
        axes.set_ylabel("RMS |e| without delay / RMS |x$_m$|")
        axes.set_title(TITLES[which], fontsize="medium")
        axes.grid(True, which="major", linewidth=0.4, alpha=0.6)
        axes.annotate(
            "better", xy=(0.97, 0.03), xytext=(0.82, 0.12), xycoords="axes fraction", textcoords="axes fraction",
            fontsize="small", color="0.35", arrowprops={"arrowstyle": "->", "color": "0.35"},
        )  # fmt: skip
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(found.clouds), frameon=False, fontsize="small")
    return figure


def _scheme(axes: Axes, cloud: Cloud, which: str, colour: str, mark: str) -> None:
    error, margin = cloud.at(which)
    usable = np.isfinite(error) & (margin > 0)
    axes.scatter(margin[usable], error[usable], s=9, color=colour, marker=mark, alpha=0.25, linewidths=0)
    front = cloud.front(which)
    if not len(front):
        return
    label = f"{cloud.scheme}: {' x '.join(SYMBOLS.get(name, name) for name in cloud.tunings[0])}"
    axes.plot(margin[front], error[front], color=colour, marker=mark, markersize=4, linewidth=1.6, label=label)
    for i, place in {front[0]: (0, -11), front[-1]: (-4, 6)}.items():
        axes.annotate(
            tuning_text(cloud.tunings[i]), (margin[i], error[i]), textcoords="offset points", xytext=place, fontsize=6.5,
            color=colour, ha="right" if i == front[-1] else "left", bbox={"facecolor": "white", "alpha": 0.7, "lw": 0},
        )  # fmt: skip


SYMBOLS = {"gamma": "Γ", "kappa": "κ", "tau": "τ", "covariance0": "P(0)"}


def tuning_text(tuning: dict[str, float]) -> str:
    """A tuning in a few characters."""
    return ", ".join(f"{SYMBOLS.get(name, name)} {value:.2g}" for name, value in tuning.items())


def as_document(found: TradeOff) -> dict[str, Any]:
    """Everything measured, in plain numbers; None for what has no finite value."""
    return {
        "case": found.problem.name,
        "simulation": {"t_end": found.simulation.t_end, "dt": found.simulation.dt, "solver": found.simulation.solver.name},
        "thetas": found.thetas.tolist(),
        "runs": found.runs,
        "excluded": list(found.excluded),
        "seconds": found.seconds,
        "schemes": {
            cloud.scheme: {
                "tunings": list(cloud.tunings),
                "error": [[value if np.isfinite(value) else None for value in row] for row in cloud.error.tolist()],
                "delay": cloud.margin.tolist(),
                "front": {which: cloud.front(which).tolist() for which in TITLES},
            }
            for cloud in found.clouds
        },
    }


def rows(found: TradeOff, which: str = "plant") -> list[tuple[str, ...]]:
    """For a table: the ends and the middle of each front."""
    lines: list[tuple[str, ...]] = []
    for cloud in found.clouds:
        error, margin = cloud.at(which)
        front = cloud.front(which)
        for i in dict.fromkeys([*front[:1], *front[len(front) // 2 : len(front) // 2 + 1], *front[-1:]]):
            lines.append(
                (cloud.scheme, tuning_text(cloud.tunings[i]), number_text(float(error[i])), number_text(float(margin[i])))
            )
    return lines
