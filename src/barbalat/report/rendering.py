"""Fills in the templates of pages. It imports little, because it is part of every run.

A page contains its pictures, so that it can be sent alone, unless it would exceed the limit for a page. A larger page, such as
the claims with their dozen maps, links to its pictures as files and says so in its last line.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, partial
from importlib import resources

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup

import barbalat
from barbalat.certificates.cells import PROPERTIES
from barbalat.pictures.palette import COLOURS, ON_DARK
from barbalat.pictures.scripts import CHARTS, UPLOT, UPLOT_LICENCE, UPLOT_STYLE, as_script_data, script_of
from barbalat.pictures.symbols import number_text
from barbalat.report.notation import mathematics, naming
from barbalat.report.omissions import grouped_omissions
from barbalat.run.results.findings import Told, together
from barbalat.run.results.outcome import about_u, ends_of, units_of
from barbalat.run.results.result import Result

FIGURE_COLUMNS = {
    "max_abs_e": "max |e|",
    "rms_e": "RMS e",
    "tail_max_abs_e": "max |e|, tail",
    "max_abs_u": "max |u|",
    "theta_hat_final": "estimates at the end",
    "theta_hat_tail_min": "smallest in the tail",
    "theta_hat_tail_max": "largest in the tail",
    "theta_hat_variation_rate": "variation, 1/s",
}


def figure_columns(results: Iterable[Result]) -> dict[str, str]:
    """Return the columns of a table of runs, with the units of the case."""
    units = units_of(next(iter(results)).problem.labels)
    return {name: f"{heading} {units.get(name, '')}".rstrip() for name, heading in FIGURE_COLUMNS.items()}


def told(results: Iterable[Result]) -> list[Told]:
    """Return the findings of the runs, without duplicates."""
    return together({result.name: result.findings for result in results})


LARGEST_PAGE_BYTES = 500_000
"""Largest size in bytes of a page with its pictures. Mail programs show such a page, and phones load it at once."""
LARGER_PAGES_BYTES = {"flights.html": 4_000_000}
"""Largest size in bytes of pages that always contain their pictures. Flights are shared as one file, with a picture for each
failure."""
PICTURES_BESIDE = " Its pictures are separate files in the same folder; send them together with the page."


@cache
def templates() -> Environment:
    """Return the environment with all templates of the package's pages."""
    environment = Environment(
        loader=PackageLoader("barbalat.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {
        "number": number_text,
        "about_u": about_u,
        "told": told,
        "ends": partial(ends_of, text=number_text),
        "mathematics": mathematics,
        "naming": naming,
        "grouped_omissions": grouped_omissions,
        "script_data": lambda data: Markup(as_script_data(data)),
    }
    environment.globals |= {"version": barbalat.__version__, "figure_columns": figure_columns, "properties": PROPERTIES}
    environment.globals |= {"fits_a_phone": fits_a_phone, "parts_of_charts": parts_of_charts}
    return environment


@cache
def parts_of_charts() -> tuple[Markup | str, ...]:
    """Return the parts of a page with charts, without the data: uPlot, its style, the colours for light and dark mode, the script
    and the licence."""
    own = resources.files("barbalat.report") / "templates" / "charts.js"
    light, dark = ("; ".join(f"--line-{k}: {one}" for k, one in enumerate(palette)) for palette in (COLOURS, ON_DARK))
    script = "\n".join(map(script_of, [*CHARTS, own]))
    safe = (UPLOT.read_text("utf-8"), UPLOT_STYLE.read_text("utf-8"), light, dark, script)
    return (*map(Markup, safe), UPLOT_LICENCE.read_text("utf-8").strip())


def render(
    template: str | Template, values: Mapping[str, object], filters: Mapping[str, Callable[..., object]] | None = None
) -> str:
    """Return the page. ``filters`` are what its template needs in addition to the common filters."""
    environment = templates().overlay()
    environment.filters = environment.filters | dict(filters or {})
    found = environment.get_template(template)
    largest = LARGER_PAGES_BYTES.get(found.name or "", LARGEST_PAGE_BYTES)
    complete = found.render(values, alone=True, of_pictures="")
    if len(complete.encode()) <= largest:
        return complete
    return found.render(values, alone=False, of_pictures=PICTURES_BESIDE)


PHONE = 326
"""Width in pixels inside a card on a screen that is 390 pixels wide."""
CHARACTER, PADDING = 9.2, 11.2
"""Width of a digit of DejaVu Sans at the font size of tables, 14.4, and padding of a cell, both in pixels."""


def fits_a_phone(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> bool:
    """Whether the columns fit side by side if their texts are broken between words."""
    longest = (max(len(word) for text in column for word in text.split() or [""]) for column in zip(columns, *rows, strict=True))
    return sum(count * CHARACTER + PADDING for count in longest) <= PHONE
