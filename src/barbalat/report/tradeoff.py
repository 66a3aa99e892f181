"""The picture of a trade-off: tracking error against the delay borne, by two criteria; a cloud and a front for each scheme."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from barbalat.report.labels import Labels
from barbalat.report.numbers import number_text
from barbalat.report.plots import COLOURS
from barbalat.study.tradeoff import Cloud, TradeOff
from barbalat.validate import Array

MARKS = ("o", "s", "^", "D")
TITLES = {"plant": "the case's own plant", "worst": "worst of the plants in the sample"}
SYMBOLS = {"gamma": "Γ", "kappa": "κ", "tau": "τ", "covariance0": "P(0)"}
ERRORS = (1e-3, 1e-2, 3e-2, 0.1, 0.3)
"""Tracking errors at which the schemes are put beside one another, relative to the model's motion."""


def criteria(found: TradeOff) -> dict[str, str]:
    """What each criterion asks, in a line."""
    onset, lost = found.criteria
    return {
        "onset": f"onset: no oscillation, error within {onset.share:g} max |x$_m$| of that with θ known",
        "loss": f"loss: error grown by less than {lost.share:g} max |x$_m$|, whatever oscillates",
    }


def panels(found: TradeOff) -> list[str]:
    """The case's plant, and the worst over the sample where there is one."""
    return ["plant", "worst"] if len(found.thetas) > 1 else ["plant"]


def draw(found: TradeOff) -> Figure:
    """A row of panels for each criterion."""
    columns = panels(found)
    figure = Figure(figsize=(6.4 * len(columns), 10.4), layout="constrained")
    FigureCanvasAgg(figure)
    shared: Axes | None = None
    drawn = []
    for i, (criterion, title) in enumerate(criteria(found).items()):
        for j, which in enumerate(columns):
            axes = figure.add_subplot(2, len(columns), i * len(columns) + j + 1, sharex=shared, sharey=shared)
            shared = shared or axes
            _panel(axes, found, which, criterion)
            axes.set_title(f"{title}\n{TITLES[which]}", fontsize="medium")
            drawn.append((axes, which, criterion))
    handles, labels = _legend(figure)
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False, fontsize="small")
    figure.draw_without_rendering()  # lays the panels out: labels are placed in pixels
    for axes, which, criterion in drawn:
        _label_ends(axes, found, which, criterion)
    return figure


def _panel(axes: Axes, found: TradeOff, which: str, criterion: str) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    edge = found.shortest
    axes.axvspan(edge / 3, edge, color="0.92", zorder=0, linewidth=0)
    axes.annotate(
        "none, or shorter than two steps", (edge / 1.75, 0.5), xycoords=("data", "axes fraction"), rotation=90, fontsize=6.5,
        color="0.4", ha="center", va="center",
    )  # fmt: skip
    for k, cloud in enumerate(found.clouds):
        error, margin = cloud.at(which, criterion)
        shown = np.where(margin > 0, margin, edge / (2.4 - 0.35 * k))  # in the band, each scheme in a column of its own
        axes.scatter(shown, error, s=9, color=COLOURS[k], marker=MARKS[k], alpha=0.22, linewidths=0)
        line = _front(cloud, which, criterion)
        label = f"{cloud.scheme}: {' x '.join(SYMBOLS.get(name, name) for name in cloud.tunings[0])}"
        axes.plot(*line.T, color=COLOURS[k], marker=MARKS[k], markersize=3.5, linewidth=1.6, label=label)
    axes.set_xlim(left=edge / 3)
    axes.set_xlabel("largest delay borne at the plant's input [s]")
    axes.set_ylabel("RMS |e| without delay / RMS |x$_m$|")
    axes.grid(True, which="major", linewidth=0.4, alpha=0.6)


def _front(cloud: Cloud, which: str, criterion: str) -> Array:
    """(K, 2): margin, error."""
    error, margin = cloud.at(which, criterion)
    front = cloud.front(which, criterion)
    return np.column_stack([margin[front], error[front]])


def _legend(figure: Figure) -> tuple[list[Any], list[str]]:
    handles, labels = figure.axes[0].get_legend_handles_labels()
    return handles, labels


def _label_ends(axes: Axes, found: TradeOff, which: str, criterion: str) -> None:
    """The tunings at both ends of each front, and the way to go."""
    lines = [_front(cloud, which, criterion) for cloud in found.clouds]
    labels = Labels(axes, lines, 6.5)
    for k, (cloud, line) in enumerate(zip(found.clouds, lines, strict=True)):
        front = cloud.front(which, criterion)
        for end in dict.fromkeys([0, len(front) - 1] if len(front) else []):
            labels.place(tuning_text(cloud.tunings[front[end]]), line[end], COLOURS[k])
    axes.annotate(
        "better", xy=(0.985, 0.015), xytext=(0.86, 0.08), xycoords="axes fraction", textcoords="axes fraction",
        fontsize="small", color="0.35", arrowprops={"arrowstyle": "->", "color": "0.35"},
    )  # fmt: skip


def tuning_text(tuning: dict[str, float]) -> str:
    """A tuning in a few characters."""
    return ", ".join(f"{SYMBOLS.get(name, name)} {value:.2g}" for name, value in tuning.items())


def as_document(found: TradeOff) -> dict[str, Any]:
    """Everything measured, in plain numbers; None for what has no finite value."""
    onset, lost = found.criteria
    return {
        "case": found.problem.name,
        "simulation": {"t_end": found.simulation.t_end, "dt": found.simulation.dt, "solver": found.simulation.solver.name},
        "thetas": found.thetas.tolist(),
        "runs": found.runs,
        "notes": list(found.notes),
        "seconds": found.seconds,
        "criteria": {"onset": {"share": onset.share, "multiple": onset.multiple}, "loss": {"share": lost.share}},
        "schemes": {
            cloud.scheme: {
                "tunings": list(cloud.tunings),
                "error": [[value if np.isfinite(value) else None for value in row] for row in cloud.error.tolist()],
                "onset": cloud.onset.tolist(),
                "loss": cloud.loss.tolist(),
                "front": {which: {name: cloud.front(which, name).tolist() for name in ("onset", "loss")} for which in TITLES},
            }
            for cloud in found.clouds
        },
    }


def rows(found: TradeOff, which: str, criterion: str) -> list[tuple[str, ...]]:
    """For a table: the ends and the middle of each front."""
    lines: list[tuple[str, ...]] = []
    for cloud in found.clouds:
        error, margin = cloud.at(which, criterion)
        front = cloud.front(which, criterion)
        for i in dict.fromkeys([*front[:1], *front[len(front) // 2 : len(front) // 2 + 1], *front[-1:]]):
            lines.append(
                (cloud.scheme, tuning_text(cloud.tunings[i]), number_text(float(error[i])), number_text(float(margin[i])))
            )
    return lines


def at_equal_error(found: TradeOff, which: str) -> list[tuple[str, ...]]:
    """For a table: the largest delay borne by each scheme with at most the errors of ``ERRORS``, by both criteria."""
    return [
        (f"{error:g}", *(_borne(found, cloud, which, name, error) for name in ("onset", "loss") for cloud in found.clouds))
        for error in ERRORS
    ]


def _borne(found: TradeOff, cloud: Cloud, which: str, criterion: str, error: float) -> str:
    delay = cloud.bears(which, criterion, error)
    if np.isnan(delay):
        return "no tuning"
    return f"{delay:.3g}" if delay > 0 else f"< {found.shortest:.3g}"


def ranking(found: TradeOff, which: str) -> str:
    """A sentence: at which errors the order of the schemes depends on the criterion."""
    head, parts = orders(found, which)
    return f"{head}: {'; '.join(parts)}." if parts else f"{head}."


def orders(found: TradeOff, which: str) -> tuple[str, list[str]]:
    """The same as what it says in all, and what it says of each error."""
    orders = {error: [_order(found, which, name, error) for name in ("onset", "loss")] for error in ERRORS}
    known = {error: pair for error, pair in orders.items() if len(pair[0]) > 1}
    parts = [
        f"at an error of at most {error:g} {_text(a)} by " + ("both criteria" if a == b else f"the onset, {_text(b)} by the loss")
        for error, (a, b) in known.items()
    ]
    if not parts:
        return "No two schemes reach a common error", []
    differ = sum(a != b for a, b in known.values())
    head = "The order does not depend on the criterion" if differ == 0 else "The order of the schemes depends on the criterion"
    return f"{head} (delay borne, the most first)", parts


def _order(found: TradeOff, which: str, criterion: str, error: float) -> list[list[str]]:
    """The schemes by the delay borne, the most first; those within the bisection's resolution together."""
    delays = {cloud.scheme: cloud.bears(which, criterion, error) for cloud in found.clouds}
    groups: list[list[str]] = []
    last = np.nan
    for scheme, delay in sorted(((s, d) for s, d in delays.items() if not np.isnan(d)), key=lambda pair: -pair[1]):
        if groups and delay >= last / EQUAL_DELAYS_RATIO:
            groups[-1].append(scheme)
        else:
            groups.append([scheme])
            last = delay
    return [sorted(group) for group in groups]


EQUAL_DELAYS_RATIO = 1.05
"""Ratio within which two delays count as equal: two brackets of 2 % apart."""


def _text(order: list[list[str]]) -> str:
    return ", ".join(" = ".join(group) for group in order)
