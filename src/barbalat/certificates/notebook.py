"""Certificates as a notebook shows them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

from barbalat.certificates.picture import TITLE, distinct, figure_of, grouped
from barbalat.certificates.summary import five, measured
from barbalat.pictures.plotted import image_of

if TYPE_CHECKING:
    from barbalat.certificates.certificate import Certificate
    from barbalat.certificates.table_1 import Table1


def html_of(table: Table1, certificates: Mapping[str, Certificate], dt: float) -> str:
    """Five lines for each controller, what was noted, the pictures of the loops."""
    rows = []
    for column in table.columns:
        rows.append(f'<th scope="rowgroup">{escape(column.name)}</th><th scope="col">{escape(column.scheme)}</th>')
        rows += [
            f'<th scope="row">{escape(one.label)}</th><td>{escape(one.text)}</td>'
            for one in (*five(column, certificates[column.name], dt), measured(certificates[column.name]))
            if one is not None
        ]
    lines = "".join(f"<tr>{row}</tr>" for row in rows)
    notes = [f"{name}: {note}" for name, certificate in certificates.items() for note in certificate.notes]
    return f"<table>{lines}</table>{small(notes)}<br>{images_of(certificates)}"


def small(sentences: Sequence[str]) -> str:
    """Sentences below a table, each on a line."""
    return f"<small>{'<br>'.join(map(escape, sentences))}</small>"


def images_of(certificates: Mapping[str, Certificate]) -> str:
    """Bode, Nyquist and sensitivity pictures, so many loops in one as there are colours."""
    return "".join(
        image_of(figure_of(loops, TITLE, shown=False), f"Bode, Nyquist and sensitivity: {'; '.join(one.name for one in loops)}")
        for loops in grouped(distinct(certificates))
    )
