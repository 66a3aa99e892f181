"""HTML pages; nothing is asked for elsewhere.

A page holds its pictures itself, so that it can be sent alone, as long as it is no larger than a page may be. A larger one, such
as the claims with their dozen maps, has them as files beside it and says so in its last line.
"""

from __future__ import annotations

import re
from base64 import b64encode
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import get_args

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

import barbalat
from barbalat.certificates.cells import PROPERTIES
from barbalat.certificates.certify import Certified
from barbalat.comparison.contest.result import Contest
from barbalat.comparison.design.design import Design
from barbalat.comparison.suite.suite import Standings
from barbalat.comparison.tradeoff.picture import TITLES, panels
from barbalat.comparison.tradeoff.tradeoff import TradeOff
from barbalat.comparison.tune.result import Tuning
from barbalat.papers.claim import Claim
from barbalat.papers.finding import Finding
from barbalat.papers.paper import ADDED_FIGURE, Paper, PaperFigure
from barbalat.pictures.symbols import number_text
from barbalat.report import contest as contest_rows
from barbalat.report import design as design_rows
from barbalat.report import dispersed, flights, tradeoff
from barbalat.report import suite as suite_rows
from barbalat.report import tuning as tuning_rows
from barbalat.report.documents import by_side, coverage
from barbalat.report.drawings import ReportFigure
from barbalat.report.file_names import PAGE
from barbalat.report.notation import mathematics
from barbalat.report.sweep import WorstMember, extremes, in_symbols, meanings, shares, varied
from barbalat.run.results.findings import Told, together
from barbalat.run.results.outcome import about_u, ends_of, units_of
from barbalat.run.results.result import Result
from barbalat.sweeps.result import SweepResult
from barbalat.vehicles.comparison import FlightComparison
from barbalat.vehicles.dispersed import DispersedComparison

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


def figure_columns(results: Iterable[Result]) -> dict[str, str]:
    """The columns of a table of runs, with the units that their case has told."""
    units = units_of(next(iter(results)).problem.labels)
    return {name: f"{heading} {units.get(name, '')}".rstrip() for name, heading in FIGURE_COLUMNS.items()}


def told(results: Iterable[Result]) -> list[Told]:
    """The findings of runs, each once."""
    return together({result.name: result.findings for result in results})


LARGEST_PAGE_BYTES = 500_000
"""Bytes of a page with its pictures: mail programs show and phones load that at once."""
LARGER_PAGES_BYTES = {"flights.html": 4_000_000}
"""Of pages that hold their pictures even so: flights are sent to others as one file, and have a picture for each failure."""
PICTURES_BESIDE = " Its pictures are files in the same folder: send them along."


REPRODUCTION = {PAGE: "Figures", "claims.html": "Claims", "coverage.html": "Coverage", "guarantees.html": "Guarantees"}
"""The pages of ``barbalat reproduce``: file -> what the others call it."""
EXPLORER = "explorer.html"
"""The page of lessons beside them."""


def reproduction(
    paper: Paper,
    figures: Sequence[PaperFigure],
    claims: Sequence[Claim],
    pictures: dict[str, ReportFigure],
    maps: dict[str, ReportFigure],
    certified: Certified,
    loops: Sequence[ReportFigure],
    seconds: dict[str, float],
    tried: Mapping[str, str],
) -> dict[str, str]:
    """The pages of ``barbalat reproduce`` for a paper, by their files; ``pictures`` and ``maps`` are by key, ``seconds`` by part.

    tried  addresses of lessons by the names of claims and of figures, as "figure-2"; empty without explorers
    """
    tally = Counter(claim.finding for claim in claims)
    described = [figure for figure in figures if figure.key != ADDED_FIGURE]
    values: dict[str, object] = {"tally": dict(tally.most_common()), "tried": tried}
    values |= {"reproduced": sum(figure.reproduced for figure in described), "described": len(described)}
    values |= {"paper": paper, "findings": get_args(Finding), "by_side": by_side(claims)}
    values["coverage"] = coverage(paper, claims)
    values["siblings"] = REPRODUCTION | ({EXPLORER: "Explorer"} if tried else {})
    values |= {
        "figures": figures,
        "claims": claims,
        "pictures": pictures,
        "maps": maps,
        "certified": certified,
        "loops": loops,
        "seconds": seconds,
    }
    templates = dict(zip(REPRODUCTION, ("reproduction.html", "claims.html", "coverage.html", "guarantees.html"), strict=True))
    return {file: _render(template, here=file, **values) for file, template in templates.items()}


def comparison(
    name: str,
    results: Sequence[Result],
    certified: Certified,
    picture: ReportFigure,
    diagrams: Sequence[ReportFigure] = (),
    loops: Sequence[ReportFigure] = (),
) -> str:
    """The page of ``barbalat run``; ``diagrams`` show what controllers are, ``loops`` the loops whose margins are given."""
    shown = {"picture": picture, "diagrams": diagrams, "loops": loops}
    return _render("comparison.html", name=name, results=results, certified=certified, **shown)


def certificates(name: str, certified: Certified, loops: Sequence[ReportFigure]) -> str:
    """The page of ``barbalat certify``; ``loops`` are those whose margins are given."""
    return _render("certified.html", name=name, certified=certified, loops=loops)


def trade_off(found: TradeOff, picture: ReportFigure) -> str:
    """The page of ``barbalat tradeoff``."""
    titles = {which: TITLES[which] for which in panels(found)}
    tables = {"rows": tradeoff.rows, "at_equal_error": tradeoff.at_equal_error, "ranking": tradeoff.ranking}
    return _render("tradeoff.html", found=found, picture=picture, titles=titles, **tables)


def linked(text: Markup, names: Sequence[str]) -> Markup:
    """Where other claims are named, a link to them; a name that is a word of English is none."""
    told = sorted((name for name in names if "-" in name), key=len, reverse=True)
    pattern = rf"(?<![\w#-])({'|'.join(map(re.escape, told))})(?![\w-])"
    return Markup(re.sub(pattern, r'<a href="#claim-\1"><code>\1</code></a>', str(text))) if told else text


def sweep(found: SweepResult, pictures: Mapping[str, ReportFigure], worst: Sequence[WorstMember] = ()) -> str:
    """The page of ``barbalat sweep``; ``worst`` are members of which there are explorers beside it, or why there are none."""
    tables = {"shares": _symbols(shares(found)), "extremes": _symbols(extremes(found))}
    return _render("sweep.html", found=found, meanings=meanings(found), pictures=pictures, worst=worst, varied=varied, **tables)


@dataclass(frozen=True)
class Film:
    """A film's file, what it shows, and the bytes of it."""

    file: str
    meaning: str
    gif: bytes

    def address(self, alone: bool) -> str:
        """Its file's, or one that holds all of it."""
        return f"data:image/gif;base64,{b64encode(self.gif).decode()}" if alone else self.file


def flight(
    found: FlightComparison, pictures: Mapping[str, ReportFigure], paths: Mapping[str, ReportFigure], film: Film | None
) -> str:
    """The page of ``barbalat fly``; pictures over time and in space by the failures' names."""
    told = {
        "title": flights.title,
        "facts": flights.facts,
        "rows": flights.rows,
        "reasons": flights.reasons,
        "losses": flights.losses,
        "best_and_worst": flights.best_and_worst,
        "suspects": flights.suspects,
    }
    headings = tuple(heading.replace("\n", " ") for heading in flights.headings(found))
    values = {
        "headings": headings,
        "loss_headings": tuple(one.replace("\n", " ") for one in flights.loss_headings(found)),
        "paths": paths,
        "film": film,
        "verdicts": flights.verdicts(found),
        "notes": flights.notes(found),
    }
    return _render("flights.html", found=found, pictures=pictures, **told, **values)


def dispersed_flights(found: DispersedComparison) -> str:
    """The page of ``barbalat fly --dispersions``."""
    told = {"rows": dispersed.rows, "losses": dispersed.losses, "verdicts": dispersed.verdicts}
    values = {
        "facts": dispersed.facts(found),
        "notes": dispersed.notes(found),
        "headings": tuple(heading.replace("\n", " ") for heading in dispersed.headings(found)),
        "loss_headings": dispersed.loss_headings(found),
    }
    return _render("dispersed.html", found=found, **told, **values)


def tuning(found: Tuning, picture: ReportFigure | None) -> str:
    """The page of ``barbalat tune``."""
    rows_of = tuning_rows
    made = (
        rows_of.verdicts, rows_of.points, rows_of.columns, rows_of.changes, rows_of.held_out, rows_of.front, rows_of.judged,
    )  # fmt: skip
    return _render("tuning.html", found=found, picture=picture, **{one.__name__: one for one in made})


def contest(found: Contest, picture: ReportFigure | None) -> str:
    """The page of ``barbalat contest``."""
    rows_of = contest_rows
    made = (
        rows_of.verdicts, rows_of.summary, rows_of.rule, rows_of.held_out, rows_of.failures, rows_of.margins, rows_of.errors,
        rows_of.pairs, rows_of.own,
    )  # fmt: skip
    headings = {
        "SUMMARY": rows_of.SUMMARY,
        "FAILURES": rows_of.FAILURES,
        "MARGINS": rows_of.MARGINS,
        "ERRORS": rows_of.ERRORS,
        "PAIRS": rows_of.PAIRS,
        "OWN": rows_of.OWN,
    }
    return _render("contest.html", found=found, picture=picture, **headings, **{one.__name__: one for one in made})


def suite(found: Standings) -> str:
    """The page of ``barbalat contest --suite``."""
    made = (suite_rows.identity, suite_rows.rebuilt, suite_rows.rows)
    return _render("suite.html", found=found, COLUMNS=suite_rows.COLUMNS, **{one.__name__: one for one in made})


def design(found: Design, picture: ReportFigure | None, *, explorer: str | None, files: Sequence[str], text: str | None) -> str:
    """The page of ``barbalat design``.

    explorer  why there is no page with sliders beside it, None where there is one
    files     sentences on the files beside it; ``text`` is that of the case file
    """
    made = (design_rows.title, design_rows.rows, design_rows.sentences)
    return _render(
        "design.html", found=found, picture=picture, explorer=explorer, files=files, text=text, COLUMNS=design_rows.COLUMNS,
        **{one.__name__: one for one in made},
    )  # fmt: skip


def _symbols(rows: Sequence[Sequence[str]]) -> list[list[str]]:
    """Each row's first entry with symbols in the place of names."""
    return [[in_symbols(first), *rest] for first, *rest in rows]


@cache
def _templates() -> Environment:
    environment = Environment(
        loader=PackageLoader("barbalat.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {
        "number": number_text,
        "about_u": about_u,
        "told": told,
        "ends": partial(ends_of, text=number_text),
        "mathematics": mathematics,
        "linked": linked,
        "in_symbols": in_symbols,
    }
    environment.globals |= {"version": barbalat.__version__, "figure_columns": figure_columns, "properties": PROPERTIES}
    environment.globals["fits_a_phone"] = fits_a_phone
    return environment


def _render(template: str, **values: object) -> str:
    found = _templates().get_template(template)
    complete = found.render(alone=True, of_pictures="", **values)
    if len(complete.encode()) <= LARGER_PAGES_BYTES.get(template, LARGEST_PAGE_BYTES):
        return complete
    return found.render(alone=False, of_pictures=PICTURES_BESIDE, **values)


PHONE = 326
"""Pixels of 390 that are left inside a card."""
CHARACTER, PADDING = 9.2, 11.2
"""Pixels: of a digit of DejaVu Sans at a table's 14.4, and of a cell to both sides."""


def fits_a_phone(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> bool:
    """Whether the columns stand beside one another when their texts are broken between words."""
    longest = (max(len(word) for text in column for word in text.split() or [""]) for column in zip(columns, *rows, strict=True))
    return sum(count * CHARACTER + PADDING for count in longest) <= PHONE
