"""A run as a notebook shows it."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from barbalat.pictures.notebook import image_of
from barbalat.run.outcome import table
from barbalat.run.picture import figure_of

if TYPE_CHECKING:
    from barbalat.run.result import Result


def html_of(result: Result) -> str:
    """The figures as a table, what deserves a second look, the plot."""
    notes = "".join(f"<br>{escape(sentence)}" for sentence in (result.numerics, *result.warnings))
    picture = image_of(figure_of([result]), f"{result.name} over time")
    return f"{table([result])}<small>{notes.removeprefix('<br>')}</small><br>{picture}"
