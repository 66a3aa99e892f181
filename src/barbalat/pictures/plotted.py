"""Objects with a plot. Notebooks show the plot below the object's one-line text."""

from __future__ import annotations

import base64
from abc import ABC, abstractmethod
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Plotted(ABC):
    """A result that can be plotted."""

    @abstractmethod
    def plot(self, *, shown: bool = True) -> Figure:
        """Draw a Matplotlib figure; with ``shown``, display it at once if pyplot is in use."""

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the text that a prompt shows, and the plot."""
        return html_of(self, self.plot(shown=False))


def image_of(figure: Figure, description: str) -> str:
    """Return the picture as an HTML element with an alternative text."""
    from barbalat.pictures.render import render  # Matplotlib takes long to import, and this module is imported everywhere

    svg = base64.b64encode(render(figure, "svg")).decode("ascii")
    return f'<img style="max-width: 100%" alt="{escape(description)}" src="data:image/svg+xml;base64,{svg}">'


def html_of(shown: object, figure: Figure) -> str:
    """Return the one-line text of an object and its picture as HTML."""
    line = repr(shown).strip("<>")
    return f"<p>{escape(line)}</p>{image_of(figure, line.partition(':')[0])}"
