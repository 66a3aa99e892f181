"""What notebooks show: a figure as an image that lies in the page itself, below a sentence."""

from __future__ import annotations

import base64
from html import escape

from matplotlib.figure import Figure

from barbalat.pictures.render import render


def image_of(figure: Figure, description: str) -> str:
    """Return the picture as an HTML element, with a text for those who cannot see it."""
    svg = base64.b64encode(render(figure, "svg")).decode("ascii")
    return f'<img style="max-width: 100%" alt="{escape(description)}" src="data:image/svg+xml;base64,{svg}">'


def html_of(shown: object, figure: Figure) -> str:
    """The one line that an object is at a prompt, and its picture."""
    line = repr(shown).strip("<>")
    return f"<p>{escape(line)}</p>{image_of(figure, line.partition(':')[0])}"
