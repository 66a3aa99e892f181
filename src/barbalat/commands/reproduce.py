"""``barbalat reproduce``: everything of the paper."""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path
from typing import TYPE_CHECKING

from barbalat.commands.screen import progress_bar

if TYPE_CHECKING:
    from barbalat.commands import Commands


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser("reproduce", help="everything of the paper: figures, tables, claims")
    parser.add_argument("--out", type=Path, default=Path("barbalat-report"), metavar="DIR", help="default: %(default)s")
    parser.add_argument("--quick", action="store_true", help="the figures and the claims that take seconds")
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    started = time.perf_counter()
    from barbalat.claims import figures as paper
    from barbalat.claims import ledger, section_v
    from barbalat.claims.paper_certificates import certified_paper
    from barbalat.report import page, tables, write
    from barbalat.report.files import prepare_folder
    from barbalat.report.files import write as write_file

    folder = prepare_folder(options.out)
    seconds = {"start": time.perf_counter() - started}
    with ledger.under_way(1 if options.quick else os.cpu_count() or 1, quick=options.quick) as ahead:
        with progress_bar("simulating") as progress:
            runs = section_v.run(progress)
        seconds["simulations"] = time.perf_counter() - started - sum(seconds.values())
        figures = paper.paper_figures(runs)
        pictures = write.draw_reproduction(folder, figures)
        seconds["pictures"] = time.perf_counter() - started - sum(seconds.values())
        certified = certified_paper(runs)
        seconds["certificates"] = time.perf_counter() - started - sum(seconds.values())
        with progress_bar("measuring the claims") as progress:
            claims = ledger.measure(runs, quick=options.quick, progress=progress, ahead=ahead)
        seconds["claims"] = time.perf_counter() - started - sum(seconds.values())
    maps = write.draw_maps(folder, claims)
    seconds["maps"] = time.perf_counter() - started - sum(seconds.values())
    seconds["total"] = time.perf_counter() - started
    document = write.as_json(write.reproduction_document(figures, claims, certified, seconds))
    write_file(folder / "report.html", page.reproduction(figures, claims, pictures, maps, certified, seconds))
    write_file(folder / "report.json", document)
    if options.json:
        print(document)  # noqa: T201
    else:
        console = tables.console()
        console.print(tables.checks_of_figures(figures), tables.ledger(claims))
        console.print(f"{sum(f.reproduced for f in figures)} of {len(figures)} figures reproduced in {seconds['total']:.1f} s")
        console.print(f"report: {folder / 'report.html'}")
    return 0 if all(figure.reproduced for figure in figures) else 1
