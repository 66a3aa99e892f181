"""Runs as a notebook shows them."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

from barbalat.pictures.plotted import image_of
from barbalat.run.outcome import about_u, table
from barbalat.run.picture import figure_of

if TYPE_CHECKING:
    from barbalat.run.result import Result


def html_of(results: Sequence[Result]) -> str:
    """The figures as a table, what deserves a second look, the plot."""
    if not results:
        return "<p>no runs</p>"
    several = len(results) > 1
    said = about_u(results[0].problem)
    notes = [escape(said)] if said is not None else []
    notes += [
        escape(f"{result.name}: {sentence}" if several else sentence)
        for result in results
        for sentence in (result.numerics, *result.warnings)
    ]
    picture = image_of(figure_of(results), f"{', '.join(result.name for result in results)} over time")
    return f"{table(results, results[0].problem.labels)}<small>{'<br>'.join(notes)}</small><br>{picture}"
