"""Labels for points of a drawing, placed so that they cover neither lines nor one another."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from matplotlib import rcParams
from matplotlib.axes import Axes

from barbalat.validate import Array

RADII = (9.0, 16.0, 26.0, 40.0, 60.0)
"""Distances from the point that are tried [points], the smallest first."""
ANGLES = np.deg2rad(np.arange(0, 360, 30))
WIDTH, HEIGHT = 0.66, 1.4
"""Size of a character and of a line, in font sizes. Both are slightly more than DejaVu Sans needs for numbers."""


class LabelPlaces:
    """Places labels in one panel whose limits and layout are final.

    ``lines`` are drawn polylines, (K, 2) each in data coordinates.
    """

    def __init__(self, axes: Axes, lines: Sequence[Array], size: float) -> None:
        self.axes, self.size = axes, size
        self.scale = axes.figure.dpi / 72  # pixels per point
        drawn = [_dense(axes.transData.transform(line)) for line in lines if len(line)]
        self.taken = np.concatenate(drawn) if drawn else np.zeros((0, 2))
        self.boxes: list[tuple[float, float, float, float]] = []

    def place(self, text: str, point: Array, colour: str) -> None:
        """Place the label at the nearest free position around the point, or at the position that covers the least. A thin line
        connects it to the point."""
        at = self.axes.transData.transform(point)
        width, height = WIDTH * self.size * len(text) * self.scale, HEIGHT * self.size * self.scale
        best, least = (0.0, 0.0), np.inf
        for radius in RADII:
            for angle in ANGLES:
                dx, dy = radius * self.scale * np.cos(angle), radius * self.scale * np.sin(angle)
                left = at[0] + dx - width * (1 - np.cos(angle)) / 2
                covered = self._covered((left, at[1] + dy - height / 2, left + width, at[1] + dy + height / 2))
                if covered < least:
                    best, least = (left + width / 2 - at[0], dy), covered
            if least == 0:
                break
        centre = at + best
        self.boxes.append((centre[0] - width / 2, centre[1] - height / 2, centre[0] + width / 2, centre[1] + height / 2))
        ground = rcParams["figure.facecolor"]
        self.axes.annotate(
            text, point, xytext=(best[0] / self.scale, best[1] / self.scale), textcoords="offset points", fontsize=self.size,
            color=colour, ha="center", va="center", zorder=5, bbox={"facecolor": ground, "alpha": 0.75, "lw": 0, "pad": 0.6},
            arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.6, "shrinkA": 0, "shrinkB": 2},
        )  # fmt: skip

    def _covered(self, box: tuple[float, float, float, float]) -> float:
        """Return how much the box covers: points of lines, other labels, and the part beyond the panel's edge."""
        left, low, right, high = box
        x, y = self.taken.T
        points = int(((x > left) & (x < right) & (y > low) & (y < high)).sum())
        others = sum(left < r and right > l and low < h and high > b for l, b, r, h in self.boxes)  # noqa: E741
        panel = self.axes.bbox
        outside = left < panel.x0 or right > panel.x1 or low < panel.y0 or high > panel.y1
        return float(points + 200 * others + 1000 * outside)


def _dense(line: Array) -> Array:
    """Return points along a polyline in pixels, a few pixels apart."""
    parts = [line[:1]]
    for start, end in pairwise(line):
        count = max(int(np.hypot(*(end - start)) / 3), 1)
        parts.append(start + (end - start) * np.linspace(0, 1, count + 1)[1:, None])
    return np.concatenate(parts)
