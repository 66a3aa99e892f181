"""``barbalat reproduce``: everything of the paper."""

from __future__ import annotations

import argparse
import os
import time
from typing import TYPE_CHECKING

from barbalat.commands.output import folder_of, print_json
from barbalat.commands.screen import Work, work

if TYPE_CHECKING:
    from barbalat.claims.claim import Claim, PaperFigure
    from barbalat.claims.ledger import Measured
    from barbalat.commands import Commands
    from barbalat.report.files import Folder


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser("reproduce", help="everything of the paper: figures, tables, claims")
    parser.add_argument("--out", default="barbalat-report", metavar="DIR", help="default: %(default)s")
    parser.add_argument("--quick", action="store_true", help="the figures and the claims that take seconds")
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    parser.set_defaults(execute=execute)


START, RUNS, PICTURES, MAPS = 2.0, 6.0, 3.0, 4.0
"""Seconds of a core: until the first row is measured, and what is done beside the rows; all of 2 cores as they were measured."""


def execute(options: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    started = time.perf_counter()
    with folder_of(options.out, None) as folder, work({"reproducing": 1.0}) as running, running.part("reproducing"):
        assert folder is not None  # --out has a default
        figures, claims, document, seconds = _reproduced(folder, started, running, quick=options.quick, shown=not options.json)
        folder.commit()
    if options.json:
        print_json(document)
    else:
        _show(figures, claims, folder, seconds)
    return 0 if all(figure.reproduced for figure in figures) else 1


def _reproduced(
    folder: Folder, started: float, running: Work, *, quick: bool, shown: bool
) -> tuple[list[PaperFigure], list[Claim], str, float]:
    """Figures, claims, the JSON document, and how long it took [s] from ``started`` on; the page is written."""
    from barbalat.claims import figures as paper
    from barbalat.claims import ledger, section_v
    from barbalat.report import page, write

    processes = 1 if quick else os.cpu_count() or 1
    pace = Pace(running, sum(part.seconds for part in ledger.LEDGER if part.quick or not quick), processes, shown=shown)
    seconds, maps = {"start": time.perf_counter() - started}, {}
    with ledger.under_way(processes, quick=quick, told=pace.told) as ahead:
        runs = section_v.run()
        seconds["simulations"] = time.perf_counter() - started - sum(seconds.values())
        figures = paper.paper_figures(runs)
        pictures = write.draw_reproduction(folder, figures)
        seconds["pictures"] = time.perf_counter() - started - sum(seconds.values())
        claims = ledger.measure(
            runs, quick=quick, ahead=ahead, told=pace.told, taken=lambda rows: maps.update(write.draw_maps(folder, rows))
        )
        certified = ahead.certified.result()
        seconds["claims, maps, certificates"] = time.perf_counter() - started - sum(seconds.values())
    seconds["total"] = time.perf_counter() - started
    document = write.as_json(write.reproduction_document(figures, claims, certified, seconds))
    folder.write(write.PAGE, page.reproduction(figures, claims, pictures, maps, certified, seconds))
    folder.write("report.json", document)
    return figures, claims, document, seconds["total"]


class Pace:
    """Tells of rows as they are measured, and from what they took how long all of it takes."""

    PRIOR_SECONDS = 3.0
    """Of what was expected: so much counts as measured to be so before anything is, lest the first row decide alone."""

    def __init__(self, running: Work, rows: float, processes: int, *, shown: bool) -> None:
        from barbalat.report.terminal.layout import Screen

        cores = min(os.cpu_count() or 1, processes + 1)
        self.running, self.whole = running, START + max((RUNS + PICTURES + MAPS + rows) / cores, RUNS + PICTURES)
        self.expected = self.seconds = self.PRIOR_SECONDS
        self.screen = Screen(running.console) if shown and running.console.is_terminal else None
        running.expect(self.whole)

    def told(self, measured: Measured) -> None:
        """A line for each row, where somebody is looking."""
        from barbalat.report.terminal import ledger

        self.expected, self.seconds = self.expected + measured.expected, self.seconds + measured.seconds
        self.running.expect(self.whole * self.seconds / self.expected)
        if self.screen is not None:
            for claim in measured.claims:
                ledger.streamed(self.screen, claim)


def _show(figures: list[PaperFigure], claims: list[Claim], folder: Folder, seconds: float) -> None:
    from barbalat.report import write
    from barbalat.report.terminal import ledger
    from barbalat.report.terminal.layout import Screen

    screen = Screen()
    ledger.by_verdict(screen, claims)
    ledger.figures(screen, figures)
    screen.title(f"{sum(f.reproduced for f in figures)} of {len(figures)} figures reproduced in {seconds:.1f} s", "")
    screen.line("One claim in full: barbalat claims NAME")
    screen.whole(f"page: {folder.path / write.PAGE}")
