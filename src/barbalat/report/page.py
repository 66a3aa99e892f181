"""HTML pages that load nothing from the network.

A page contains its pictures, so that it can be sent alone, unless it would exceed the limit for a page. A larger page, such as
the claims with their dozen maps, links to its pictures as files and says so in its last line.
"""

from __future__ import annotations

import re
from base64 import b64encode
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_args

from markupsafe import Markup

from barbalat.certificates.certify import Certified
from barbalat.comparison.contest.result import Contest
from barbalat.comparison.design.design import Design
from barbalat.comparison.suite.suite import Standings
from barbalat.comparison.tradeoff.picture import TITLES, panels
from barbalat.comparison.tradeoff.tradeoff import TradeOff
from barbalat.comparison.tune.result import Tuning
from barbalat.identify.result import Identification
from barbalat.papers.claim import Claim
from barbalat.papers.finding import Finding
from barbalat.papers.paper import ADDED_FIGURE, Paper, PaperFigure
from barbalat.problem.state_feedback import Problem
from barbalat.report import contest as contest_texts
from barbalat.report import design as design_texts
from barbalat.report import dispersed, flights, replayed, tradeoff
from barbalat.report import identification as identification_texts
from barbalat.report import suite as suite_texts
from barbalat.report import tuning as tuning_texts
from barbalat.report.documents import by_side, coverage
from barbalat.report.drawings import ReportFigure
from barbalat.report.file_names import PAGE
from barbalat.report.rendering import render
from barbalat.report.sweep import WorstMember, extremes, in_symbols, meanings, shares, varied
from barbalat.study.replay import Replay
from barbalat.sweeps.result import SweepResult
from barbalat.vehicles.comparison import FlightComparison
from barbalat.vehicles.dispersed import DispersedComparison

REPRODUCTION = {PAGE: "Figures", "claims.html": "Claims", "coverage.html": "Coverage", "guarantees.html": "Guarantees"}
"""The pages of ``barbalat reproduce``, each with its file and its title in links."""
EXPLORER = "explorer.html"
"""The page of lessons in the same folder."""


def reproduction(
    paper: Paper,
    figures: Sequence[PaperFigure],
    claims: Sequence[Claim],
    pictures: dict[str, ReportFigure],
    maps: dict[str, ReportFigure],
    certified: Certified,
    loops: Sequence[Mapping[str, Any]],
    seconds: dict[str, float],
    tried: Mapping[str, str],
) -> dict[str, str]:
    """Return the pages of ``barbalat reproduce`` for a paper, by file name.

    pictures, maps  by key
    seconds         by part
    tried           addresses of lessons by the names of claims and figures, such as "figure-2"; empty without explorers
    """
    tally = Counter(claim.finding for claim in claims)
    described = [figure for figure in figures if figure.key != ADDED_FIGURE]
    values: dict[str, object] = {"tally": dict(tally.most_common()), "tried": tried}
    values |= {"reproduced": sum(figure.reproduced for figure in described), "described": len(described)}
    values |= {"paper": paper, "findings": get_args(Finding), "by_side": by_side(claims)}
    values |= {"coverage": coverage(paper, claims), "names": [name for part in paper.ledger for name in part.names]}
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
    return {file: _rendered(template, here=file, **values) for file, template in templates.items()}


def trade_off(found: TradeOff, picture: ReportFigure) -> str:
    """The page of ``barbalat tradeoff``."""
    titles = {which: TITLES[which] for which in panels(found)}
    return _rendered("tradeoff.html", found=found, picture=picture, titles=titles, texts=tradeoff)


def linked(text: Markup, names: Sequence[str]) -> Markup:
    """Return the text with links to the claims that it names. A claim whose name is an English word is not linked."""
    told = sorted((name for name in names if "-" in name), key=len, reverse=True)
    pattern = rf"(?<![\w#-])({'|'.join(map(re.escape, told))})(?![\w-])"
    return Markup(re.sub(pattern, r'<a href="#claim-\1"><code>\1</code></a>', str(text))) if told else text


def sweep(found: SweepResult, pictures: Mapping[str, ReportFigure], worst: Sequence[WorstMember] = ()) -> str:
    """Return the page of ``barbalat sweep``. ``worst`` are the members with explorers, or the reasons why there are none."""
    tables = {"shares": _symbols(shares(found)), "extremes": _symbols(extremes(found))}
    return _rendered("sweep.html", found=found, meanings=meanings(found), pictures=pictures, worst=worst, varied=varied, **tables)


@dataclass(frozen=True)
class Film:
    """A film: its file, its description and its bytes."""

    file: str
    meaning: str
    gif: bytes

    def address(self, alone: bool) -> str:
        """The address of the file or, if ``alone``, a data URL with its content."""
        return f"data:image/gif;base64,{b64encode(self.gif).decode()}" if alone else self.file


def flight(
    found: FlightComparison, pictures: Mapping[str, ReportFigure], paths: Mapping[str, ReportFigure], film: Film | None
) -> str:
    """Return the page of ``barbalat fly``. The pictures over time and in space are keyed by the name of the failure."""
    return _rendered("flights.html", found=found, pictures=pictures, paths=paths, film=film, texts=flights)


def dispersed_flights(found: DispersedComparison) -> str:
    """The page of ``barbalat fly --dispersions``."""
    return _rendered("dispersed.html", found=found, texts=dispersed)


def tuning(found: Tuning, picture: ReportFigure | None) -> str:
    """The page of ``barbalat tune``."""
    return _rendered("tuning.html", found=found, picture=picture, texts=tuning_texts)


def contest(found: Contest, picture: ReportFigure | None) -> str:
    """The page of ``barbalat contest``."""
    return _rendered("contest.html", found=found, picture=picture, texts=contest_texts)


def suite(found: Standings) -> str:
    """The page of ``barbalat contest --suite``."""
    return _rendered("suite.html", found=found, texts=suite_texts)


def design(found: Design, picture: ReportFigure | None, *, explorer: str | None, files: Sequence[str], text: str | None) -> str:
    """The page of ``barbalat design``.

    explorer  the reason why there is no page with sliders, or None if there is one
    files     sentences on the further files
    text      the text of the case file
    """
    return _rendered("design.html", found=found, picture=picture, explorer=explorer, files=files, text=text, texts=design_texts)


def identification(found: Identification, picture: ReportFigure, source: str, text: str) -> str:
    """Return the page of an identified plant: coefficients, residuals on validation samples and the case file."""
    return _rendered("identification.html", found=found, picture=picture, source=source, text=text, texts=identification_texts)


def replay(found: Mapping[str, Replay], problem: Problem, picture: ReportFigure, source: str, case: str) -> str:
    """Return the page of a recording that was replayed through the estimators of a case: the estimates, and the controls compared
    with the recorded control."""
    return _rendered("replayed.html", found=found, problem=problem, picture=picture, source=source, case=case, texts=replayed)


def _symbols(rows: Sequence[Sequence[str]]) -> list[list[str]]:
    """Return the rows with symbols in place of names in the first entry."""
    return [[in_symbols(first), *rest] for first, *rest in rows]


def _rendered(template: str, **values: object) -> str:
    return render(template, values, filters={"linked": linked, "in_symbols": in_symbols})
