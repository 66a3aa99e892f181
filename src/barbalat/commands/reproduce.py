"""``barbalat reproduce``: the figures, tables and claims of a paper."""

from __future__ import annotations

import argparse
import os
import time
from functools import partial
from typing import TYPE_CHECKING

from barbalat.commands.options import conclude
from barbalat.commands.output import folder_of, print_json
from barbalat.commands.progress import work

if TYPE_CHECKING:
    from rich.console import Console

    from barbalat.budget import Progress
    from barbalat.commands import Commands
    from barbalat.folders import Folder
    from barbalat.papers.claim import Claim
    from barbalat.papers.ledger import Measured
    from barbalat.papers.paper import Paper, PaperFigure


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser("reproduce", help="reproduce the figures, tables and claims of a paper")
    parser.add_argument(
        "paper", nargs="?", metavar="PAPER", help="name of the paper; default: What is L1 Adaptive Control, jafari_2013"
    )
    parser.add_argument("--list", action="store_true", help="list the papers that can be reproduced")
    parser.add_argument("--out", default="barbalat-report", metavar="DIR", help="default: %(default)s")
    extent = parser.add_mutually_exclusive_group()
    extent.add_argument("--quick", action="store_true", help="measure only the figures and those claims that take seconds")
    extent.add_argument(
        "--full", action="store_true", help="support the claims with measurements that take minutes: more gains, longer runs"
    )
    conclude(parser, execute)


ORDINARY_SECONDS, QUICK_SECONDS, FULL_SECONDS = 40.0, 9.0, 130.0
"""Estimated total seconds until the estimate of the ledger is available."""
START_SECONDS, PICTURES_SECONDS, MAPS_SECONDS, PAGE_SECONDS = 1.0, 9.0, 4.0, 2.0
"""Seconds on one core until the first row starts, and seconds for the work besides the rows."""
EXPLORER_SECONDS = 3.0
"""Seconds for each page with sliders."""


def execute(options: argparse.Namespace) -> int:
    """Run the command. Return the exit code."""
    started = time.perf_counter()
    from barbalat.papers.paper import DEFAULT, paper_of

    if options.list:
        return _list_papers(as_json=options.json)
    paper = paper_of(options.paper or DEFAULT)
    expected = {"reproducing": QUICK_SECONDS if options.quick else FULL_SECONDS if options.full else ORDINARY_SECONDS}
    with folder_of(options.out, None) as folder, work(expected) as running, running.part("reproducing", here=False) as progress:
        assert folder is not None  # --out has a default
        figures, claims, document, seconds = _reproduced(
            paper, folder, started, None if options.json else running.console, progress, quick=options.quick, full=options.full
        )
        folder.commit()
    if options.json:
        print_json(document)
    else:
        _show(paper, figures, claims, folder, seconds)
    return 0 if all(figure.reproduced for figure in figures) else 1


def _list_papers(*, as_json: bool) -> int:
    from barbalat.papers.paper import papers
    from barbalat.report.documents import as_json as text_of
    from barbalat.report.terminal.layout import Screen

    if as_json:
        rows = [{"name": one.name, "title": one.title, "cases": [str(path) for path in one.cases]} for one in papers().values()]
        print_json(text_of({"papers": rows}))
        return 0
    screen = Screen()
    for paper in papers().values():
        screen.fact(paper.name, paper.title, 26)
        for path in paper.cases:
            screen.whole(f"    case: {path}")
    return 0


def _reproduced(
    paper: Paper, folder: Folder, started: float, console: Console | None, progress: Progress, *, quick: bool, full: bool
) -> tuple[list[PaperFigure], list[Claim], str, float]:
    """Write the page. Return the figures, the claims, the JSON document, and the time [s] since ``started``."""
    from barbalat.explorer import section_v as explorers
    from barbalat.papers import ledger
    from barbalat.report import documents, page, write
    from barbalat.report.run_pages import loops_data

    processes = 1 if quick else os.cpu_count() or 1
    rows = sum(part.duration(full=full) for part in paper.ledger if part.quick or not quick)
    pace = Pace(paper.run_seconds, rows + (0.0 if quick else MAPS_SECONDS), progress, console)
    seconds, maps = {"start": time.perf_counter() - started}, {}
    explored = explorers.PAGES if paper.name == explorers.PAPER and not quick else ()
    exploring = {file: ledger.Other(partial(explorers.contents, file), EXPLORER_SECONDS) for file in explored}
    with ledger.under_way(paper, processes, quick=quick, full=full, told=pace.told, others=exploring) as ahead:
        runs = paper.run(pace.running)
        seconds["simulations"] = time.perf_counter() - started - sum(seconds.values())
        figures = list(paper.figures(runs))
        narrow = write.NarrowPictures(figures, ahead.pool)
        certified = ahead.certified.result()
        pictures = write.draw_reproduction(folder, figures, drawn=lambda share: pace.drawn(PICTURES_SECONDS * share))
        pictures = narrow.joined(pictures)
        seconds["pictures"] = time.perf_counter() - started - sum(seconds.values())
        claims = ledger.measure(
            paper, runs, quick=quick, full=full, ahead=ahead, told=pace.told,
            taken=lambda rows: maps.update(write.draw_maps(folder, rows)),
        )  # fmt: skip
        write.keep(folder, list(pictures.values()))
        for file, contents in ahead.others.items():
            folder.write(file, contents.result().page(claims))
        seconds["claims, maps, certificates, explorers"] = time.perf_counter() - started - sum(seconds.values())
    seconds["total"] = time.perf_counter() - started
    document = documents.as_json(documents.reproduction_document(paper, figures, claims, certified, seconds))
    tried, loops = explorers.addresses(claims) if exploring else {}, loops_data(certified.certificates)
    for file, text in page.reproduction(paper, figures, claims, pictures, maps, certified, loops, seconds, tried).items():
        folder.write(file, text)
    folder.write("report.json", document)
    for path in paper.cases:
        folder.write(path.name, path.read_bytes())
    return figures, claims, document, seconds["total"]


class Pace:
    """Reports rows when they are measured, and the finished fraction of the work, based on seconds on one core."""

    def __init__(self, runs: float, rows: float, progress: Progress, console: Console | None) -> None:
        """Take the expected seconds of the paper's runs, and of the ledger's measurements and pictures."""
        from barbalat.report.terminal.layout import Screen

        self.runs, self.whole = runs, START_SECONDS + runs + PICTURES_SECONDS + PAGE_SECONDS + rows
        self.done, self.runs_done = 0.0, 0.0
        self.progress = progress
        self.screen = Screen(console) if console is not None and console.is_terminal else None

    def told(self, measured: Measured) -> None:
        """Print a line for each row if there is a terminal."""
        from barbalat.report.terminal import ledger

        self.drawn(measured.expected)
        if self.screen is not None:
            for claim in measured.claims:
                ledger.streamed(self.screen, claim)

    def running(self, fraction: float) -> None:
        """Report the finished fraction of the paper's runs."""
        self.drawn(self.runs * (fraction - self.runs_done) + START_SECONDS * (self.runs_done == 0))
        self.runs_done = fraction

    def drawn(self, seconds: float) -> None:
        """Report that a task with these expected seconds is finished."""
        self.done += seconds
        self.progress(min(self.done / self.whole, 1.0))


def _show(paper: Paper, figures: list[PaperFigure], claims: list[Claim], folder: Folder, seconds: float) -> None:
    from barbalat.report.file_names import PAGE
    from barbalat.report.terminal import ledger
    from barbalat.report.terminal.layout import Screen

    screen = Screen()
    ledger.overview(screen, figures, claims)
    screen.line(f"For all details of a row: barbalat claims NAME. Measured in {seconds:.1f} s.")
    screen.whole(f"page: {folder.path / PAGE}")
    for path in paper.cases:
        screen.whole(f"case of its rows: {folder.path / path.name}")
