"""Draws a film of a scene with Matplotlib, as a GIF: the frames of the vehicles, their trails, and the commanded positions."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Iterator
from typing import Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.transforms import BboxBase
from PIL.Image import Dither, Image, fromarray, new

from barbalat.pictures.panels import text_of
from barbalat.pictures.theme import GROUND, INK, QUIET_INK, Theme, dash_of, new_figure
from barbalat.validate import Array
from barbalat.vehicles.picture import box_of, frame, inside
from barbalat.vehicles.scene import Mover, Scene

FRAME_SIDE, PIXELS_PER_INCH = 4.8, 100
"""Side of a frame [in] and resolution. A frame has 480 pixels per side; a phone shows it with 390."""
FRAMES_PER_SECOND = 10
SECONDS_BEFORE = 3.0
"""Time shown before the failure of a flight [s]."""
TITLE_WIDTH = 66
"""Largest number of characters in a line of the title."""
TRAIL_SECONDS = 3.0
"""Time for which a vehicle's path stays visible [s]."""
LARGEST_FILM_BYTES = 2_000_000
"""Largest size of a film in bytes. A larger one is drawn again with half the frames."""
SHADES = 12
"""Number of shades between each colour and the background, for the smoothed edges of lines."""


def film(scene: Scene) -> bytes:
    """Return the film in real time, beginning ``SECONDS_BEFORE`` the failure. The same scene gives the same bytes."""
    rate = FRAMES_PER_SECOND
    while True:
        found = _film(scene, max(0.0, scene.fails - SECONDS_BEFORE), rate)
        if len(found) <= LARGEST_FILM_BYTES or rate < 2:
            return found
        rate //= 2


def _film(scene: Scene, start: float, rate: int) -> bytes:
    step = float(scene.t[1] - scene.t[0])
    every = max(1, round(1 / (rate * step)))
    pictures = list(_frames(scene, range(round(start / step), len(scene.t), every)))
    palette = _palette(scene)
    first, *others = [one.quantize(palette=palette, dither=Dither.NONE) for one in pictures]
    buffer = io.BytesIO()
    first.save(buffer, "GIF", save_all=True, append_images=others, duration=round(1000 * every * step), loop=0, optimize=True)
    return buffer.getvalue()


class Canvas(Protocol):
    """The parts of Matplotlib that are used here. They have no type stubs."""

    def draw(self) -> None: ...

    def copy_from_bbox(self, bbox: BboxBase) -> object: ...

    def restore_region(self, region: object) -> None: ...

    def buffer_rgba(self) -> memoryview: ...


def _palette(scene: Scene) -> Image:
    """Return the palette of the drawing: the vehicles' colours, ink and greys."""
    theme, shares = Theme(), np.linspace(0, 1, SHADES)[:, None]
    named = np.array([to_rgb(one) for one in (*(theme.colour(mover.colour) for mover in scene.movers), INK, QUIET_INK)])
    shades = np.concatenate([(1 - shares) * one + shares for one in named])
    found = new("P", (1, 1))
    found.putpalette(np.round(255 * shades).astype(np.uint8).tobytes())
    return found


def _frames(scene: Scene, instants: range) -> Iterator[Image]:
    """Yield the frames. The box is drawn once, and the moving parts are drawn on top of it."""
    figure = new_figure(FRAME_SIDE, FRAME_SIDE, shown=False)
    figure.set_dpi(PIXELS_PER_INCH)
    figure.set_facecolor(GROUND)
    canvas: Canvas = FigureCanvasAgg(figure)
    axes = box_of(figure, scene, font=7.5)
    theme = Theme()
    if scene.target is not None:
        axes.plot(*scene.target.T, color=QUIET_INK, linewidth=0.6, linestyle=":")
    handles = [
        Line2D([], [], color=theme.colour(one.colour), linestyle=dash_of(one.colour), label=text_of(one.label))
        for one in scene.movers
    ]
    figure.legend(handles=handles, loc="upper left", frameon=False, fontsize=8.5)
    figure.text(0.02, 0.87, textwrap.fill(scene.title, TITLE_WIDTH), fontsize=8.5, color=INK, va="top")
    canvas.draw()
    ground = canvas.copy_from_bbox(figure.bbox)
    for k in instants:
        canvas.restore_region(ground)
        moving: list[Line2D] = []
        if scene.target is not None:
            moving += axes.plot(*scene.target[k : k + 1].T, color=INK, marker="+", markersize=9)
        for mover in scene.movers:
            moving += _moving(axes, scene, mover, k, theme)
        told = figure.text(0.98, 0.97, _told(scene, k), fontsize=8.5, color=INK, ha="right", va="top")
        for line in moving:
            axes.draw_artist(line)
        figure.draw_artist(told)
        picture = fromarray(np.asarray(canvas.buffer_rgba()).copy()).convert("RGB")
        for artist in (*moving, told):
            artist.remove()
        yield picture


def _moving(axes: Axes, scene: Scene, mover: Mover, k: int, theme: Theme) -> list[Line2D]:
    """Draw a vehicle at an instant, or the mark of a lost vehicle."""
    at, colour, dash = min(k, len(mover.path) - 1), theme.colour(mover.colour), dash_of(mover.colour)
    since = max(0, k - round(TRAIL_SECONDS / float(scene.t[1] - scene.t[0])))
    found: list[Line2D] = []
    if since < at:
        found += axes.plot(*inside(scene, mover.path[since : at + 1]).T, color=colour, linewidth=0.8, linestyle=dash)
    if at < k or (at == len(mover.path) - 1 and mover.lost):
        return found + axes.plot(*_clipped(scene, mover.path[at : at + 1]).T, color=colour, marker="x", markersize=9)
    if np.isfinite(inside(scene, mover.path[at : at + 1])).all():
        for line in frame(scene, mover.path[at], mover.attitude[at]):
            found += axes.plot(*line.T, color=colour, linewidth=1.8)
    return found


def _clipped(scene: Scene, points: Array) -> Array:
    """Move points outside the box to its wall."""
    return np.asarray(np.clip(points, *scene.box))


def _told(scene: Scene, k: int) -> str:
    """Return the title: the time, and the distance of each vehicle from its commanded position."""
    since = float(scene.t[k]) - scene.fails
    failed = f", {since:.1f} s after the failure" if scene.failing and since >= 0 else ""
    lines = [f"{scene.t[k]:.1f} s{failed}"]
    for mover in scene.movers:
        if k >= len(mover.path) or (mover.lost and k == len(mover.path) - 1):
            lines.append(f"{text_of(mover.label)}: lost")
        elif scene.target is not None:
            off = float(np.linalg.norm(mover.path[k] - scene.target[k]))
            lines.append(f"{text_of(mover.label)}: {off:.2f} {scene.unit} off")
    return "\n".join(lines)
