"""How large everything in a picture of panels is, on a page or on a phone, and what stands above each panel."""

from __future__ import annotations

import re
import textwrap
from dataclasses import dataclass
from typing import NamedTuple

from barbalat.pictures.panels import Panel
from barbalat.pictures.symbols import HELD_BLANK
from barbalat.pictures.theme import NARROW, WIDE

LEVEL_WIDTH = 0.9
"""Of a level's line [points]."""


@dataclass(frozen=True)
class Sizes:
    """Sizes of everything on a page or a phone [in], [points]; fixed, since Matplotlib's own layouts take longer than the
    drawing."""

    width: float
    left: float
    right: float
    axes: float
    below: float
    font: float
    columns: int

    def across(self, panel: Panel) -> float:
        """Width of a panel's axes [in]."""
        return self.width / (1 if panel.whole_row else self.columns) - self.left - self.right

    def characters(self, panel: Panel) -> int:
        """About as many fit above a panel."""
        return int(self.across(panel) * 72 / (0.56 * self.font))  # DejaVu Sans is 0.56 of its size wide on average

    def above(self, panel: Panel) -> float:
        """Height of title, note and legend [in]."""
        lines = len(heading(panel, self).splitlines()) + -(-len(entries(panel)) // legend_columns(panel, self))
        return 1.42 * self.font * lines / 72 + 0.12


PAGE = Sizes(WIDE, left=0.84, right=0.22, axes=1.75, below=0.5, font=9.0, columns=2)
PHONE = Sizes(NARROW, left=0.74, right=0.18, axes=1.8, below=0.48, font=8.0, columns=1)


def heading(panel: Panel, sizes: Sizes) -> str:
    """Title and note, in lines that fit above the panel."""
    lines = [panel.title, *([panel.note] if panel.note else [])]
    return "\n".join(_filled(line, sizes.characters(panel)) for line in lines)


def _filled(text: str, width: int) -> str:
    """In lines that end at no blank within a formula: half of one is shown with its dollar."""
    held = re.sub(r"\$[^$]*\$", lambda formula: formula[0].replace(" ", HELD_BLANK), text)
    return textwrap.fill(held, width).replace(HELD_BLANK, " ")


class Mark(NamedTuple):
    """An entry of a legend: as its line is, so that on a grey print its width tells it apart."""

    text: str
    colour: int | str
    dash: int | None
    width: float


def entries(panel: Panel) -> list[Mark]:
    """The legend's entries."""
    levels = {level.label: level.dash for level in panel.levels if level.label}
    lines = [Mark(one.label, one.colour, one.dash, one.width) for one in panel.series]
    return [*lines, *(Mark(text, "quiet", dash, LEVEL_WIDTH) for text, dash in levels.items())]


def legend_columns(panel: Panel, sizes: Sizes) -> int:
    """Return how many of the legend's columns fit above the panel."""
    labels = [one.text for one in entries(panel)]
    longest = max(map(_length, labels), default=1)
    return max(min(sizes.characters(panel) // (longest + 7), len(labels)), 1)  # 7: the line before it, the gap behind


def _length(label: str) -> int:
    """Characters that are seen of a label with mathematics in it."""
    return len(re.sub(r"\\hat|[{}$_]", "", re.sub(r"\\[a-gi-z]\w*", "x", label)))
