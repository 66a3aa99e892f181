"""``barbalat reproduce``: everything of the paper."""

from __future__ import annotations

import argparse
import os
import time
from typing import TYPE_CHECKING

from barbalat.commands.output import folder_of, print_json
from barbalat.commands.screen import progress_bar

if TYPE_CHECKING:
    from barbalat.claims.claim import Claim, PaperFigure
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


def execute(options: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    started = time.perf_counter()
    with folder_of(options.out, None) as folder:
        assert folder is not None  # --out has a default
        figures, claims, document, seconds = _reproduced(folder, started, quick=options.quick, full=options.full)
        folder.commit()
    if options.json:
        print_json(document)
    else:
        _show(figures, claims, folder, seconds)
    return 0 if all(figure.reproduced for figure in figures) else 1


def _reproduced(folder: Folder, started: float, *, quick: bool, full: bool) -> tuple[list[PaperFigure], list[Claim], str, float]:
    """Figures, claims, the JSON document, and how long it took [s] from ``started`` on; the page is written."""
    from barbalat.claims import figures as paper
    from barbalat.claims import ledger, section_v
    from barbalat.claims.paper_certificates import certified_paper
    from barbalat.report import page, write

    seconds = {"start": time.perf_counter() - started}
    with ledger.under_way(1 if quick else os.cpu_count() or 1, quick=quick, full=full) as ahead:
        with progress_bar("simulating") as progress:
            runs = section_v.run(progress)
        seconds["simulations"] = time.perf_counter() - started - sum(seconds.values())
        figures = paper.paper_figures(runs)
        pictures = write.draw_reproduction(folder, figures)
        seconds["pictures"] = time.perf_counter() - started - sum(seconds.values())
        certified = certified_paper(runs)
        seconds["certificates"] = time.perf_counter() - started - sum(seconds.values())
        with progress_bar("measuring the claims") as progress:
            claims = ledger.measure(runs, quick=quick, full=full, progress=progress, ahead=ahead)
        seconds["claims"] = time.perf_counter() - started - sum(seconds.values())
    maps = write.draw_maps(folder, claims)
    seconds["maps"] = time.perf_counter() - started - sum(seconds.values())
    seconds["total"] = time.perf_counter() - started
    document = write.as_json(write.reproduction_document(figures, claims, certified, seconds))
    for file, text in page.reproduction(figures, claims, pictures, maps, certified, seconds).items():
        folder.write(file, text)
    folder.write("report.json", document)
    return figures, claims, document, seconds["total"]


def _show(figures: list[PaperFigure], claims: list[Claim], folder: Folder, seconds: float) -> None:
    from rich.markup import escape

    from barbalat.report import tables, write

    console = tables.console()
    console.print(tables.checks_of_figures(figures), tables.ledger(claims))
    console.print(f"{sum(f.reproduced for f in figures)} of {len(figures)} figures reproduced in {seconds:.1f} s")
    console.print(escape(f"report: {folder.path / write.PAGE}"))
