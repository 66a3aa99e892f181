"""A run as a notebook shows it."""

from __future__ import annotations

import base64
from html import escape
from typing import TYPE_CHECKING

from barbalat.pictures.render import render
from barbalat.run.outcome import table
from barbalat.run.picture import figure_of

if TYPE_CHECKING:
    from barbalat.run.result import Result


def html_of(result: Result) -> str:
    """The figures as a table, what deserves a second look, the plot."""
    svg = base64.b64encode(render(figure_of([result]), "svg")).decode("ascii")
    notes = "".join(f"<br>{escape(sentence)}" for sentence in (result.numerics, *result.warnings))
    picture = f'<img style="max-width: 100%" alt="{escape(result.name)} over time" src="data:image/svg+xml;base64,{svg}">'
    return f"{table([result])}<small>{notes.removeprefix('<br>')}</small><br>{picture}"
