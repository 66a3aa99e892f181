"""Self-contained HTML pages: everything, pictures included, in one file."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources

from jinja2 import Environment, StrictUndefined

import barbalat
from barbalat.certificates.cells import PROPERTIES
from barbalat.certificates.overview import Certified
from barbalat.claims.claim import Claim, PaperFigure
from barbalat.report import tradeoff
from barbalat.report.certificates import rows
from barbalat.report.numbers import number_text
from barbalat.run.result import Result
from barbalat.study.tradeoff import TradeOff

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
    """A drawn figure: where its PNG and SVG lie beside the page, and the PNG itself."""

    name: str
    png: bytes

    @property
    def data(self) -> str:
        return "data:image/png;base64," + base64.b64encode(self.png).decode("ascii")


def reproduction(
    figures: Sequence[PaperFigure],
    claims: Sequence[Claim],
    pictures: dict[str, Picture],
    maps: dict[str, Picture],
    certified: Certified,
    seconds: dict[str, float],
) -> str:
    """The page of ``barbalat reproduce``; ``pictures`` by figure key, ``maps`` by map key, ``seconds`` by part of the work."""
    values = {"figures": figures, "claims": claims, "pictures": pictures, "maps": maps}
    return _render("reproduction.html", **values, certified=certified, seconds=seconds)


def comparison(
    name: str, results: Sequence[Result], certified: Certified, picture: Picture, diagrams: Sequence[Picture] = ()
) -> str:
    """The page of ``barbalat run``; ``diagrams`` show what controllers are."""
    return _render("comparison.html", name=name, results=results, certified=certified, picture=picture, diagrams=diagrams)


def trade_off(found: TradeOff, picture: Picture) -> str:
    """The page of ``barbalat tradeoff``."""
    titles = {which: tradeoff.TITLES[which] for which in tradeoff.panels(found)}
    tables = {"rows": tradeoff.rows, "at_equal_error": tradeoff.at_equal_error, "ranking": tradeoff.ranking}
    return _render("tradeoff.html", found=found, picture=picture, titles=titles, **tables)


def _render(template: str, **values: object) -> str:
    folder = resources.files("barbalat.report") / "templates"
    loader_environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    loader_environment.filters["number"] = number_text
    loader_environment.filters["rows"] = rows
    macros = "".join((folder / name).read_text(encoding="utf-8") for name in ("macros.html", "certificates.html"))
    body = (folder / template).read_text(encoding="utf-8")
    values |= {"version": barbalat.__version__, "columns": FIGURE_COLUMNS, "properties": PROPERTIES}
    return loader_environment.from_string(macros + body).render(**values)
