"""Self-contained HTML pages: everything, pictures included, in one file."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

import barbalat
from barbalat.certificates.cells import PROPERTIES
from barbalat.certificates.overview import Certified
from barbalat.claims.claim import Claim, PaperFigure
from barbalat.report import tradeoff
from barbalat.report.certificates import rows
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
    """A drawn figure: where its PNG and SVG lie beside the page, the SVG itself, and one for phones where there is one."""

    name: str
    svg: bytes
    narrow: bytes | None = None

    @property
    def data(self) -> Markup:
        return data_of(self.svg)

    @property
    def narrow_data(self) -> Markup:
        return Markup() if self.narrow is None else data_of(self.narrow)


def data_of(svg: bytes) -> Markup:
    """A picture inside of a page: as text, with what an address or an attribute may not contain written otherwise."""
    text = " ".join(svg.decode().split("\n")).replace('"', "'")
    return Markup("data:image/svg+xml,{}").format(Markup(re.sub(r"[%#&]|:(?=//)", lambda found: f"%{ord(found[0]):02x}", text)))


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
    titles = {which: TITLES[which] for which in panels(found)}
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
