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
    extent = parser.add_mutually_exclusive_group()
    extent.add_argument("--quick", action="store_true", help="the figures and the claims that take seconds")
    extent.add_argument("--full", action="store_true", help="sharpen claims by what takes minutes: more gains, longer runs")
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    parser.set_defaults(execute=execute)


SECONDS, QUICK_SECONDS, FULL_SECONDS = 40.0, 9.0, 130.0
"""In all, until the ledger is there to say it."""
START_SECONDS, RUNS_SECONDS, PICTURES_SECONDS, MAPS_SECONDS = 3.0, 6.0, 4.0, 4.0
"""Seconds of a core: until the first row is begun, and what is done beside the rows."""


def execute(options: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    started = time.perf_counter()
    expected = {"reproducing": QUICK_SECONDS if options.quick else FULL_SECONDS if options.full else SECONDS}
    with folder_of(options.out, None) as folder, work(expected) as running, running.part("reproducing", here=False):
        assert folder is not None  # --out has a default
        figures, claims, document, seconds = _reproduced(
            folder, started, running, quick=options.quick, full=options.full, shown=not options.json
        )
        folder.commit()
    if options.json:
        print_json(document)
    else:
        _show(figures, claims, folder, seconds)
    return 0 if all(figure.reproduced for figure in figures) else 1


def _reproduced(
    folder: Folder, started: float, running: Work, *, quick: bool, full: bool, shown: bool
) -> tuple[list[PaperFigure], list[Claim], str, float]:
    """Figures, claims, the JSON document, and how long it took [s] from ``started`` on; the page is written."""
    from barbalat.claims import figures as paper
    from barbalat.claims import ledger, section_v
    from barbalat.claims.rows import LEDGER
    from barbalat.report import documents, page, write

    processes = 1 if quick else os.cpu_count() or 1
    pace = Pace(running, sum(part.duration(full=full) for part in LEDGER if part.quick or not quick), processes, shown=shown)
    seconds, maps = {"start": time.perf_counter() - started}, {}
    with ledger.under_way(processes, quick=quick, full=full, told=pace.told) as ahead:
        runs = section_v.run(pace.running_section_v)
        seconds["simulations"] = time.perf_counter() - started - sum(seconds.values())
        figures = paper.paper_figures(runs)
        narrow = ahead.pool.submit(write.narrow_pictures, figures)
        certified = ahead.certified.result()
        drawing_loops = ahead.pool.submit(write.loop_pictures, certified.certificates)
        pictures = write.draw_reproduction(folder, figures)
        pace.drawn(PICTURES_SECONDS)
        seconds["pictures"] = time.perf_counter() - started - sum(seconds.values())
        claims = ledger.measure(
            runs,
            quick=quick,
            full=full,
            ahead=ahead,
            told=pace.told,
            taken=lambda rows: maps.update(write.draw_maps(folder, rows)),
        )
        pictures, loops = write.with_narrow(pictures, narrow.result()), drawing_loops.result()
        write.keep(folder, [*pictures.values(), *loops])
        seconds["claims, maps, certificates"] = time.perf_counter() - started - sum(seconds.values())
    seconds["total"] = time.perf_counter() - started
    document = documents.as_json(documents.reproduction_document(figures, claims, certified, seconds))
    for file, text in page.reproduction(figures, claims, pictures, maps, certified, loops, seconds).items():
        folder.write(file, text)
    folder.write("report.json", document)
    return figures, claims, document, seconds["total"]


class Pace:
    """Tells of rows as they are measured; and how long all takes, from how much of the work was done in which time."""

    PRIOR_SECONDS = 3.0
    """So long the work counts as having gone as fast as expected, before anything is known."""

    def __init__(self, running: Work, rows: float, processes: int, *, shown: bool) -> None:
        from barbalat.report.terminal.layout import Screen

        self.cores = min(os.cpu_count() or 1, processes + 1)
        self.running, self.whole, self.done = running, START_SECONDS + RUNS_SECONDS + PICTURES_SECONDS + MAPS_SECONDS + rows, 0.0
        self.started, self.runs_done = time.perf_counter(), 0.0
        self.screen = Screen(running.console) if shown and running.console.is_terminal else None
        self._add(0.0)

    def told(self, measured: Measured) -> None:
        """A line for each row, where somebody is looking."""
        from barbalat.report.terminal import ledger

        self._add(measured.expected)
        if self.screen is not None:
            for claim in measured.claims:
                ledger.streamed(self.screen, claim)

    def running_section_v(self, fraction: float) -> None:
        """So much of the runs is done."""
        self._add(RUNS_SECONDS * (fraction - self.runs_done) + START_SECONDS * (self.runs_done == 0))
        self.runs_done = fraction

    def drawn(self, seconds: float) -> None:
        """Pictures are drawn that were to take so long."""
        self._add(seconds)

    def _add(self, work: float) -> None:
        self.done += work
        known = time.perf_counter() - self.started + self.PRIOR_SECONDS
        self.running.expect(self.whole * known / (self.done + self.PRIOR_SECONDS * self.cores))


def _show(figures: list[PaperFigure], claims: list[Claim], folder: Folder, seconds: float) -> None:
    from barbalat.report.page import PAGE
    from barbalat.report.terminal import ledger
    from barbalat.report.terminal.layout import Screen

    screen = Screen()
    ledger.overview(screen, figures, claims)
    screen.line(f"All of one row: barbalat claims NAME. Measured in {seconds:.1f} s.")
    screen.whole(f"page: {folder.path / PAGE}")
