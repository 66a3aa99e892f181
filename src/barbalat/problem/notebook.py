"""Problems as a notebook shows them."""

from __future__ import annotations

from dataclasses import is_dataclass
from html import escape
from typing import TYPE_CHECKING

from barbalat.settings import given_of

if TYPE_CHECKING:
    from barbalat.problem.tracking import TrackingProblem


def html_of(problem: TrackingProblem) -> str:
    """All that is not as by default, a row for each."""
    return table_of(f"Problem: {problem.name}", rows_of(problem))


def rows_of(problem: TrackingProblem) -> dict[str, str]:
    """What is given of a problem beside its name, its plant's numbers each by itself."""
    found: dict[str, str] = {}
    given: dict[str, str] = given_of(problem) if is_dataclass(problem) else {}  # type: ignore[redundant-expr]
    for name, text in given.items():
        plant = problem.plant if name == "plant" else None
        found |= {f"plant.{inner}": value for inner, value in given_of(plant).items()} if is_dataclass(plant) else {name: text}  # type: ignore[redundant-expr]
    found.pop("name", None)
    return found


def table_of(title: str, rows: dict[str, str]) -> str:
    """Names and values as HTML."""
    cells = (f'<tr><th scope="row" style="text-align: left">{escape(name)}</th>' for name in rows)
    values = (f'<td style="text-align: left"><code>{escape(text)}</code></td></tr>' for text in rows.values())
    body = "".join(cell + value for cell, value in zip(cells, values, strict=True))
    return f"<table><caption>{escape(title)}</caption>{body}</table>"
