"""Pictures of a sweep: the distribution of the members' errors, a map over two axes, and each varied number's fraction of the
variance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from barbalat import validate
from barbalat.judge.judged import CLASSES
from barbalat.judge.verdict import Class
from barbalat.open_numbers.path import FieldPath
from barbalat.pictures.panel_drawing import draw_into
from barbalat.pictures.panels import SHARING, Panel, width_of
from barbalat.pictures.theme import NARROW, WIDE, Theme, dash_of, new_figure
from barbalat.sweeps.bounds import ERROR_BOUND
from barbalat.sweeps.sensitivity import Sensitivity
from barbalat.sweeps.spread import LogUniform
from barbalat.sweeps.study import SETTLED, VERDICT
from barbalat.validate import Array

if TYPE_CHECKING:
    from barbalat.sweeps.result import SweepResult

FEWEST_BINS, MOST_BINS = 10, 60
"""Least and largest number of bins of a histogram; in between, twice the cube root of the number of members (Rice's rule)."""
HATCHES = ("", "///", "...", "xxx")
"""Hatches of bars with similar colours."""
MOST_BARS = 12
"""Largest number of inputs in a chart of variance fractions; the inputs with the largest fractions are shown."""
DECADES_FOR_LOG = 1.3
"""An axis is logarithmic if the largest value is at least 20 times the smallest."""


MARKED = {Class.FOLLOWS: ".", Class.OFF: "^", Class.CYCLE: "o", Class.LOST: "x"}
"""The markers of the judge's classes, in drawing order; open if not settled."""
MOST_MARKED = 2000
"""Largest number of members in a panel; of more members, an evenly spaced subset is drawn."""
MOST_SHOWN = 4
"""Largest number of controllers with a panel and a run."""
BINS_OF_DECIDING = 8
"""Number of equally large groups into which the values of a varied number are divided to show its effect."""


@dataclass(frozen=True, eq=False)
class WorstRun:
    """The worst member of a controller, simulated again: the panel of its trajectory, up to ``t_end`` [s]."""

    controller: str
    member: int
    panel: Panel
    t_end: float


def members_by_verdict(found: SweepResult, runs: Sequence[WorstRun], *, narrow: bool = False) -> Figure:
    """For each controller, the members over the two most influential numbers and, beside them or below them on a phone, its worst
    run."""
    shown = [run for run in runs if f"{run.controller}/{VERDICT}" in found.rows.names][:MOST_SHOWN]
    rows, columns = (2 * len(shown), 1) if narrow else (len(shown), 2)
    figure, theme = new_figure(NARROW if narrow else WIDE, 3.4 * rows + 0.4, shown=False), Theme.current()
    places = figure.subplots(rows, columns, squeeze=False).reshape(-1)
    height = figure.get_size_inches()[1]
    figure.subplots_adjust(
        left=0.17 if narrow else 0.075, right=0.97, wspace=0.2, hspace=0.75, top=1 - 0.75 / height, bottom=0.6 / height
    )
    for run, left, right in zip(shown, places[::2], places[1::2], strict=True):
        _scatter(left, found, run.controller, theme)
        draw_into([right], [run.panel], run.t_end)
    return figure


def deciding(found: SweepResult) -> list[FieldPath]:
    """The varied numbers, ordered by their influence on the verdicts, or on the tail's error if all verdicts are equal."""
    judged = []
    for controller in found.controllers:
        kinds = found.column(f"{controller}/{VERDICT}")
        if kinds.std() == 0:
            kinds = np.argsort(np.argsort(np.nan_to_num(found.column(f"{controller}/tail_max_abs_e[0]"), nan=np.inf))).astype(
                float
            )
        judged.append((kinds - kinds.mean()) / max(kinds.std(), 1e-300))
    shares = {}
    for path in found.plan.paths:
        order = np.argsort(found.column(str(path)), kind="stable")
        parts = np.array_split(order, min(BINS_OF_DECIDING, len(found)))
        shares[path] = sum(sum(len(part) * one[part].mean() ** 2 for part in parts) / len(found) for one in judged)
    return sorted(found.plan.paths, key=lambda path: -shares[path])


def _scatter(axes: Axes, found: SweepResult, controller: str, theme: Theme) -> None:
    which = np.unique(np.linspace(0, len(found) - 1, min(len(found), MOST_MARKED)).astype(int))
    kinds, settled = (found.column(f"{controller}/{name}") for name in (VERDICT, SETTLED))
    (first, *others), tail = deciding(found), "tail_max_abs_e[0]"
    x, y = (found.column(name)[which] for name in (str(first), str(others[0]) if others else f"{controller}/{tail}"))
    for k, (kind, mark) in enumerate(MARKED.items()):
        own, colour = kinds == CLASSES.index(kind), theme.colour(k)
        for members, sure in ((own & (settled == 1), True), (own & (settled != 1), False)):
            if members.any():
                shown, label = members[which], f"{kind} {int(members.sum())}{'' if sure else ', not settled'}"
                face = colour if sure or mark == "x" else "none"
                drawn = axes.scatter(
                    x[shown], y[shown], s=22, marker=mark, linewidths=0.8 if sure else 0.4, label=label, color=colour
                )
                drawn.set_facecolor(face)
    spread: dict[FieldPath, object] = {**found.plan.axes, **found.plan.draws}
    for side, path in zip("xy", (first, *others), strict=False):
        if isinstance(spread[path], LogUniform) or getattr(spread[path], "logarithmic", False):
            axes.set(**{f"{side}scale": "log"})
    axes.set_xlabel(str(first), fontsize=9)
    axes.set_ylabel(str(others[0]) if others else f"{symbol(tail)} in the tail", fontsize=9)
    title = f"{controller}: {validate.counted(len(found), 'member')} by verdict"
    axes.set_title(title + (f", {len(which)} shown" if len(which) < len(found) else ""), fontsize=10, loc="left", pad=22)
    axes.legend(
        loc="lower left", bbox_to_anchor=(-0.01, 0.99), ncols=4, frameon=False, fontsize=8, handletextpad=0.1, columnspacing=0.9
    )
    _plain(axes)


def histograms(found: SweepResult, *, narrow: bool = False, shown: bool = False) -> Figure:
    """The largest |e| of every member, a row for each component; the guaranteed bounds are lines."""
    figures = [name for name in found.evidence.metrics if name.startswith("max_abs_e[")]
    figure = new_figure(NARROW if narrow else WIDE, 2.6 * max(len(figures), 1) + 0.6, shown=shown, layout="constrained")
    theme = Theme.current()
    for i, name in enumerate(figures):
        axes = figure.add_subplot(len(figures), 1, i + 1)
        _histogram(axes, found, name, theme)
        axes.set_xlabel(f"largest {symbol(name)} of a member's run", fontsize=9)
        axes.set_ylabel("members", fontsize=9)
        if i == 0:
            axes.legend(loc="lower left", bbox_to_anchor=(-0.01, 1.0), ncols=1 if narrow else 3, frameon=False, fontsize=9)
    return figure


def symbol(name: str) -> str:
    """The label |e_1| of max_abs_e[0], in Matplotlib's notation."""
    return f"$|e_{{{int(name.split('[')[1][:-1]) + 1}}}|$"


def _histogram(axes: Axes, found: SweepResult, name: str, theme: Theme) -> None:
    known = found.evidence.metrics[name]
    low, high = min(one.min for one in known.values()), max(one.max for one in known.values())
    logarithmic = low > 0 and np.log10(high / low) > DECADES_FOR_LOG
    spaced = np.geomspace if logarithmic else np.linspace
    bins = int(np.clip(2 * len(found) ** (1 / 3), FEWEST_BINS, MOST_BINS))
    edges = spaced(low, high if high > low else low + 1, bins + 1)
    for k, controller in enumerate(known):
        one = found.column(f"{controller}/{name}")
        gone = len(one) - known[controller].finite
        one = one[np.isfinite(one)]
        label = f"{controller} ({gone} of {len(found)} diverged)" if gone else controller
        axes.stairs(
            np.histogram(one, edges)[0],
            edges,
            color=theme.colour(k),
            linestyle=dash_of(k),
            linewidth=width_of(k, len(known)),
            label=label,
        )
        bound = _largest_bound(found, controller)
        if bound is not None:
            text = f"guaranteed for {controller}: {bound:.4g}"
            axes.axvline(bound, color=theme.colour(k), linestyle=":", linewidth=1.3, label=text)
    if logarithmic:
        axes.set_xscale("log")
    _plain(axes)


def _largest_bound(found: SweepResult, controller: str) -> float | None:
    """The largest bound of all members, if each of them has one."""
    name = f"{controller}/{ERROR_BOUND}"
    if name not in found.rows.names:
        return None
    bounds = found.column(name)
    return float(bounds.max()) if np.isfinite(bounds).all() else None


@dataclass(frozen=True, eq=False)
class Heat:
    """A metric over two axes of the grid: the median of the draws at each point, NaN if a member diverged there."""

    x: tuple[FieldPath, Array]
    y: tuple[FieldPath, Array]
    values: dict[str, Array]


def heat_of(found: SweepResult, figure: str) -> Heat | None:
    """The map; None unless the grid has two axes, or if members diverged at each of its points."""
    axes = [(path, axis.values) for path, axis in found.plan.axes.items() if axis.count > 1]
    if len(axes) != 2 or len(found.plan.axes) != 2:
        return None
    (y, x) = axes
    shape = len(y[1]), len(x[1]), found.plan.draws_each
    values = {c: np.median(found.column(f"{c}/{figure}").reshape(shape), axis=2) for c in found.evidence.metrics.get(figure, {})}
    return Heat(x, y, values) if any(np.isfinite(one).any() for one in values.values()) else None


def heat_map(heat: Heat, title: str, logarithmic: tuple[bool, bool], *, narrow: bool = False) -> Figure:
    """A panel for each controller, stacked on a phone; grey where members diverged."""
    from matplotlib.colors import LogNorm, Normalize

    count = len(heat.values)
    size = (NARROW, 0.6 + 2.8 * count) if narrow else (min(WIDE, 1.0 + 3.2 * count), 3.6)
    figure = new_figure(*size, shown=False, layout="constrained")
    finite = np.concatenate([one[np.isfinite(one)] for one in heat.values.values()])
    scale = (LogNorm if finite.min() > 0 and finite.max() > 20 * finite.min() else Normalize)(finite.min(), finite.max())
    drawn = []
    for i, (controller, values) in enumerate(heat.values.items()):
        axes = figure.add_subplot(*((count, 1) if narrow else (1, count)), i + 1)
        axes.set_facecolor("0.85")
        x, y = _edges(heat.x[1], logarithmic=logarithmic[1]), _edges(heat.y[1], logarithmic=logarithmic[0])
        mesh = axes.pcolormesh(x, y, np.ma.masked_invalid(values), cmap="viridis", norm=scale)
        mesh.set_rasterized(True)  # vector cells would show hairlines between them
        axes.set_title(controller, fontsize="medium")
        axes.set_xlabel(str(heat.x[0]), fontsize=9)
        if narrow or i == 0:
            axes.set_ylabel(str(heat.y[0]), fontsize=9)
        for side, wanted in zip("xy", (logarithmic[1], logarithmic[0]), strict=True):
            axes.set(**{f"{side}scale": "log" if wanted else "linear"})
        drawn.append(axes)
    figure.colorbar(mesh, ax=drawn, label=title)
    return figure


def _edges(values: Array, *, logarithmic: bool) -> Array:
    """The borders of the cells around an axis' values."""
    places = np.log(values) if logarithmic else values
    middle = (places[1:] + places[:-1]) / 2
    edges = np.concatenate([[2 * places[0] - middle[0]], middle, [2 * places[-1] - middle[-1]]])
    return np.exp(edges) if logarithmic else edges


def tornado(sensitivities: Sequence[Sensitivity], controllers: Sequence[str], name: str, *, narrow: bool = False) -> Figure:
    """A bar for each varied number and controller: its fraction of the metric's variance, with its interval; the largest at the
    top."""
    shares: dict[str, float] = {}
    for one in sensitivities:
        shares[str(one.path)] = max(shares.get(str(one.path), 0.0), one.first)
    paths = sorted(shares, key=lambda path: -shares[path])[:MOST_BARS]
    theme = Theme.current()
    height = 0.8 + 0.32 * len(paths) * max(len(controllers), 1)
    figure = new_figure(NARROW if narrow else 2 * NARROW, height, shown=False, layout="constrained")
    axes = figure.add_subplot()
    width = 0.8 / max(len(controllers), 1)
    for k, controller in enumerate(controllers):
        own = {str(one.path): one for one in sensitivities if one.controller == controller}
        places = [i + (k - (len(controllers) - 1) / 2) * width for i, path in enumerate(paths) if path in own]
        bars = [own[path] for path in paths if path in own]
        spread = 100 * np.array([[max(b.first - b.low, 0) for b in bars], [max(b.high - b.first, 0) for b in bars]])
        values = [100 * b.first for b in bars]
        axes.barh(
            places, values, width * 0.9, color=theme.colour(k), hatch=HATCHES[k // SHARING % len(HATCHES)], label=controller,
            xerr=spread, ecolor=theme.quiet,
        )  # fmt: skip
    axes.set_yticks(range(len(paths)), paths, fontsize=9)
    axes.invert_yaxis()
    axes.set_xlim(left=0)
    axes.set_xlabel(f"fraction of the variance of max {symbol(name)} [%]", fontsize=9)
    axes.legend(loc="lower left", bbox_to_anchor=(-0.01, 1.0), ncols=1 if narrow else 3, frameon=False, fontsize=9)
    _plain(axes)
    return figure


def _plain(axes: Axes) -> None:
    axes.tick_params(labelsize=9)
    axes.grid(visible=True, linewidth=0.3)
    axes.spines[["top", "right"]].set_visible(False)
