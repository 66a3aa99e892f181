"""The screens of ``barbalat reproduce`` and ``barbalat claims``: the figures, the ledger by finding, and all details of a row."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

from barbalat.papers.claim import Claim, Listing
from barbalat.papers.finding import Finding, Reading
from barbalat.papers.paper import ADDED_FIGURE, Paper, PaperFigure
from barbalat.pictures.symbols import held
from barbalat.report.documents import by_side
from barbalat.report.terminal.layout import Screen, capitalized

STYLES: dict[Finding, str] = {"holds": "green", "holds if": "yellow", "mixed": "yellow", "fails": "red", "erratum": "red"}
NAME_COLUMNS = 26
"""Width in columns of the names of rows, which is the length of the longest name."""


def overview(screen: Screen, shown: Sequence[PaperFigure], claims: Sequence[Claim]) -> None:
    """Print the names of the rows that hold, the headlines of the others, the number of rows of each side, and the results for
    the figures."""
    for finding in get_args(Finding):
        mine = [claim for claim in claims if claim.finding == finding]
        if mine:
            screen.line(f"{capitalized(finding)}: {len(mine)}", STYLES[finding])
        if finding == "holds" and mine:
            screen.line(", ".join(held(claim.id) for claim in mine), "", "  ", "  ")
        for claim in mine if finding != "holds" else ():
            screen.line(f"{claim.id}: {claim.headline}", "", "    ", "  ")
    for side, counts in by_side(claims).items():
        screen.line(f"{side}: {', '.join(f'{counts[finding]} {finding}' for finding in get_args(Finding) if counts[finding])}")
    _figures(screen, shown)


def _figures(screen: Screen, shown: Sequence[PaperFigure]) -> None:
    """Print how many of the paper's figures and of the statements about them hold, and list the statements that do not hold."""
    paper = [figure for figure in shown if figure.key != ADDED_FIGURE]
    checks = [check for figure in paper for check in figure.checks]
    if not paper:
        return
    said = f"{sum(check.holds for check in checks)} of {len(checks)} statements hold; no curve is compared"
    missed = [check for figure in shown for check in figure.checks if not check.holds]
    reproduced = sum(figure.reproduced for figure in paper)
    screen.line(f"Figures: {reproduced} of {len(paper)} as described, {said}", "red" if missed else "green")
    for check in missed:
        screen.line(f"does not hold: {check.statement} ({check.measured})", "red", "    ", "  ")


def streamed(screen: Screen, claim: Claim) -> None:
    """Print a claim that has just been measured, on one line if it fits."""
    screen.line(f"{claim.id}: {held(claim.finding)}. {claim.headline}", STYLES[claim.finding], "    ")


def in_full(screen: Screen, claim: Claim) -> None:
    """Print everything about one claim."""
    screen.line(f"{claim.id}: {claim.finding}", f"bold {STYLES[claim.finding]}")
    sentence = claim.sentence
    facts = [
        ("headline", claim.headline),
        ("sentence", f'"{sentence.quote}"' if sentence.quote else ""),
        ("says" if not claim.ours else "ours", claim.statement),
        ("source", f"{sentence.source.name}: {claim.where}" if not claim.ours else claim.where),
        *((held(f"reading {i}"), _reading(one)) for i, one in enumerate(claim.readings, start=1)),
        ("measured", claim.measured),
        ("how", claim.how),
        ("changes if", claim.would_change),
        ("sharpened", claim.sharpened),
        *(("changed", f"{one.date}, {held(one.findings)}: {one.what}") for one in sentence.changed),
        ("equation", sentence.equation),
        ("code", claim.code),
        ("notebook", f"barbalat claims {claim.id} --notebook {claim.id}.ipynb"),
    ]
    for label, text in facts:
        if text:
            screen.fact(label, text, 10, "bold")
    for listing in claim.listings:
        _listing(screen, listing)
    for shown in claim.maps:
        screen.fact("picture", f"{shown.title}: map-{shown.key}.svg of barbalat reproduce", 10, "bold")


def _reading(one: Reading) -> str:
    role = one.role if one.decides else "supplementary"
    return f"{role}, {held(one.finding)}: {one.says}. {capitalized(one.measured)}"


def _listing(screen: Screen, listing: Listing) -> None:
    screen.title(listing.caption)
    screen.table(listing.columns, listing.rows, left=range(1, len(listing.columns)))


def names(screen: Screen, papers: Sequence[Paper]) -> None:
    """Print the name of every row, its subject, and the time that its measurement takes."""
    screen.line("The claims of the ledger. Findings are not stored: barbalat claims NAME measures one.", "bold")
    for paper in papers:
        if len(papers) > 1:
            screen.title(f"{paper.name}: {paper.title}")
        for part in paper.ledger:
            seconds = part.seconds + paper.run_seconds * part.judges_runs
            for name, about in part.names.items():
                screen.fact(name, about if seconds < 1 else f"{about} ({held(f'{seconds:.0f} s')})", NAME_COLUMNS)
    screen.line("The estimated time is in brackets, if it is at least a second.", "dim")
