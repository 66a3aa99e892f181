"""Drawings of runs: tracking error on the left, estimates on the right, as in the paper."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from barbalat.report.columns import drawn, largest
from barbalat.run.result import Result
from barbalat.validate import Array

# Okabe and Ito's palette: told apart by colour-blind readers and on a grey print
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
DASHES = ("-", "--", ":", "-.")
LONGEST_LABEL = 40
"""Characters of a name in a picture: beside the axes of a run's row there is room for no more."""


def error_and_estimates(result: Result) -> Figure:
    """e(t) and theta_hat(t) of one run, with the true parameters and the projection bounds."""
    figure, (left, right) = _pair(height=3.4)
    envelope = result.envelope
    n = result.e.shape[1]
    for i in range(n):
        _line(left, result.t, result.e[:, i], (envelope.e_min[:, i], envelope.e_max[:, i]), COLOURS[i % 6], f"$e_{i + 1}$")
    left.set_ylabel("tracking error $e = x - x_m$")
    true = result.problem.parameters
    for i in range(result.theta_hat.shape[1]):
        band = (envelope.theta_hat_min[:, i], envelope.theta_hat_max[:, i])
        _line(right, result.t, result.theta_hat[:, i], band, COLOURS[i % 6], rf"$\hat\theta_{i + 1}$")
        if true is not None:
            right.axhline(true[i], color=COLOURS[i % 6], linestyle="--", linewidth=0.8)
    _bounds(right, result)
    right.set_ylabel(r"estimates $\hat\theta$ (dashed: true values)")
    _finish((left, right), [result])
    return figure


def comparison(results: Sequence[Result]) -> Figure:
    """Several runs: |e| on a logarithmic axis, the control, and each one's estimates."""
    figure = Figure(figsize=(10, 3.1 + 2.2 * len(results)), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(1 + len(results), 2, height_ratios=[3.1, *[2.2] * len(results)])
    left, right = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
    for k, result in enumerate(results):
        envelope = result.envelope
        starts, error = largest(result.t, np.maximum(np.abs(envelope.e_min), np.abs(envelope.e_max)).max(axis=1))
        name = shown(result.name)
        left.semilogy(starts, np.maximum(error, 1e-16), color=COLOURS[k % 6], linewidth=1, label=name)
        u = result.u.reshape(len(result.t), -1)
        for j in range(u.shape[1]):
            label = name if u.shape[1] == 1 else f"{name}, $u_{j + 1}$"
            _line(right, result.t, u[:, j], (envelope.u_min[:, j], envelope.u_max[:, j]), COLOURS[k % 6], label, DASHES[j % 4])
    bounded = [np.abs(result.u).max() for result in results if result.diverged_at is None and result.u.size]
    if bounded and len(bounded) < len(results):
        right.set_ylim(-1.5 * max(bounded), 1.5 * max(bounded))
    left.set_ylabel("max |e|, all components")
    right.set_ylabel("control $u$")
    axes = [left, right]
    for k, result in enumerate(results):
        errors = figure.add_subplot(grid[k + 1, 0] if result.theta_hat.shape[1] else grid[k + 1, :])
        if result.diverged_at is not None:  # the burst would hide what led to it
            errors.set_yscale("symlog", linthresh=1.0)
        errors.set_ylabel(f"{shown(result.name)}\n$e$")
        axes.append(errors)
        envelope = result.envelope
        for i in range(result.e.shape[1]):
            band = (envelope.e_min[:, i], envelope.e_max[:, i])
            _line(errors, result.t, result.e[:, i], band, COLOURS[k % 6], f"$e_{i + 1}$", DASHES[i % 4])
        if not result.theta_hat.shape[1]:
            continue
        estimates = figure.add_subplot(grid[k + 1, 1])
        for i in range(result.theta_hat.shape[1]):
            band = (envelope.theta_hat_min[:, i], envelope.theta_hat_max[:, i])
            _line(estimates, result.t, result.theta_hat[:, i], band, COLOURS[k % 6], rf"$\hat\theta_{i + 1}$", DASHES[i % 4])
        _bounds(estimates, result)
        if result.diverged_at is not None:
            estimates.set_yscale("symlog", linthresh=1.0)
        estimates.set_ylabel(r"$\hat\theta$")
        axes.append(estimates)
    _finish(axes, results)
    return figure


def shown(name: str) -> str:
    """A name as Matplotlib shows it as it is: no mathematics, no label that legends leave out, none that pushes the axes away."""
    short = name if len(name) <= LONGEST_LABEL else name[: LONGEST_LABEL - 1] + "…"
    return ("\u200b" if short.startswith("_") else "") + short.replace("$", r"\$")


def render(figure: Figure, kind: str) -> bytes:
    """The figure as PNG or SVG; the same input gives the same bytes."""
    import matplotlib as mpl

    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=r"Glyph \d+")  # where the font lacks a script, names are boxes
        if kind == "svg":
            with mpl.rc_context({"svg.hashsalt": "barbalat", "svg.fonttype": "path"}):
                figure.savefig(buffer, format="svg", metadata={"Date": None})
        else:
            figure.savefig(buffer, format=kind, dpi=150, metadata={"Software": None})
    return FINER_THAN_SEEN.sub(rb"\1", buffer.getvalue()) if kind == "svg" else _of_few_colours(buffer)


FINER_THAN_SEEN = re.compile(rb"(\d\.\d\d)\d+")
"""A coordinate's digits beyond a hundredth of a point."""


def _of_few_colours(png: io.BytesIO) -> bytes:
    """The same picture with a palette: lines on white have few colours, and it is a third as large."""
    from PIL import Image

    buffer = io.BytesIO()
    with Image.open(png) as image:
        image.convert("RGB").quantize(256, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(buffer, "png")
    return buffer.getvalue()


def _pair(height: float) -> tuple[Figure, tuple[Axes, Axes]]:
    figure = Figure(figsize=(10, height), layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    return figure, (left, right)


def _line(axes: Axes, t: Array, value: Array, band: tuple[Array, Array], colour: str, label: str, dash: str = "-") -> None:
    """A recorded series, and as a band what it did between the recorded instants; where the band is wide, it alone is drawn."""
    t, shown, low, high = drawn(t, value, *band)
    fast = np.isnan(shown)
    if fast.any():
        axes.fill_between(t, low, high, where=fast, step="post", color=colour, alpha=0.45, linewidth=0)
    axes.plot(t, shown, dash, color=colour, linewidth=1, label=label)


def _bounds(axes: Axes, result: Result) -> None:
    """How far the known set reaches in each component."""
    known_set = getattr(result.problem, "uncertainty", None)
    if known_set is None:
        return
    for bound in sorted({value for side in known_set.extent for value in side.tolist()}):
        axes.axhline(bound, color="0.6", linestyle=":", linewidth=0.8)


def _finish(axes: Sequence[Axes], results: Sequence[Result]) -> None:
    t_end = results[0].simulation.t_end
    for ax in axes:
        ax.set_xlabel("t [s]")
        ax.set_xlim(0, t_end)
        ax.grid(visible=True, linewidth=0.3)
        if ax.get_legend_handles_labels()[0]:
            ax.legend(loc="upper right", fontsize="small", framealpha=0.7)
