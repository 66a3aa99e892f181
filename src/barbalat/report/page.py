"""HTML pages; their pictures lie beside them, and nothing is asked for elsewhere."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined

import barbalat
from barbalat.certificates.cells import PROPERTIES
from barbalat.certificates.overview import Certified
from barbalat.claims.claim import Claim, PaperFigure
from barbalat.report import tradeoff
from barbalat.report.certificates import rows
from barbalat.report.notation import mathematics
from barbalat.report.numbers import number_text
from barbalat.run.result import Result
from barbalat.study.tradeoff import TradeOff
from barbalat.study.tradeoff_picture import TITLES, panels

FIGURE_COLUMNS = {
    "max_abs_e": "max |e|",
    "rms_e": "RMS e",
    "tail_max_abs_e": "max |e|, tail",
    "max_abs_u": "max |u|",
    "theta_hat_final": "estimates at the end",
    "theta_hat_tail_min": "least in the tail",
    "theta_hat_tail_max": "greatest in the tail",
    "theta_hat_variation_rate": "variation, 1/s",
}


@dataclass(frozen=True)
class Picture:
    """A drawn figure: its SVG lies beside the page under ``name``, and one for phones under ``narrow`` where there is one."""

    name: str
    narrow: str | None = None


PAGE = "report.html"
"""What a command's first page is called."""
REPRODUCTION = {PAGE: "Figures", "claims.html": "Claims", "guarantees.html": "Guarantees"}
"""The pages of ``barbalat reproduce``: file -> what the others call it."""


def reproduction(
    figures: Sequence[PaperFigure],
    claims: Sequence[Claim],
    pictures: dict[str, Picture],
    maps: dict[str, Picture],
    certified: Certified,
    seconds: dict[str, float],
) -> dict[str, str]:
    """The pages of ``barbalat reproduce`` by their files; ``pictures`` and ``maps`` are by key, ``seconds`` by part."""
    tally = Counter(claim.verdict for claim in claims)
    count = sum(figure.reproduced for figure in figures)
    values: dict[str, object] = {"tally": dict(tally.most_common()), "reproduced": count, "siblings": REPRODUCTION}
    values |= {
        "figures": figures,
        "claims": claims,
        "pictures": pictures,
        "maps": maps,
        "certified": certified,
        "seconds": seconds,
    }
    templates = dict(zip(REPRODUCTION, ("reproduction.html", "claims.html", "guarantees.html"), strict=True))
    return {file: _render(template, here=file, **values) for file, template in templates.items()}


def comparison(
    name: str, results: Sequence[Result], certified: Certified, picture: Picture, diagrams: Sequence[Picture] = ()
) -> str:
    """The page of ``barbalat run``; ``diagrams`` show what controllers are."""
    return _render("comparison.html", name=name, results=results, certified=certified, picture=picture, diagrams=diagrams)


def certificates(name: str, certified: Certified, pictures: dict[str, Picture]) -> str:
    """The page of ``barbalat certify``; ``pictures`` show the loops by their controllers' names."""
    return _render("certified.html", name=name, certified=certified, pictures=pictures)


def trade_off(found: TradeOff, picture: Picture) -> str:
    """The page of ``barbalat tradeoff``."""
    titles = {which: TITLES[which] for which in panels(found)}
    tables = {"rows": tradeoff.rows, "at_equal_error": tradeoff.at_equal_error, "ranking": tradeoff.ranking}
    return _render("tradeoff.html", found=found, picture=picture, titles=titles, **tables)


@cache
def _templates() -> Environment:
    environment = Environment(
        loader=PackageLoader("barbalat.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {"number": number_text, "rows": rows, "mathematics": mathematics}
    environment.globals |= {"version": barbalat.__version__, "columns": FIGURE_COLUMNS, "properties": PROPERTIES}
    return environment


def _render(template: str, **values: object) -> str:
    return _templates().get_template(template).render(**values)
