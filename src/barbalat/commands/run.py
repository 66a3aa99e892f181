"""``barbalat run``: simulate and compare a case's controllers."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

from barbalat.commands.options import add_controllers
from barbalat.commands.output import folder_of, print_json
from barbalat.commands.screen import progress_bar, say

if TYPE_CHECKING:
    from barbalat.cases.build import Case
    from barbalat.commands import Commands
    from barbalat.report.files import Folder
    from barbalat.run.result import Result


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser("run", help="simulate and compare a case's controllers")
    parser.add_argument("case", metavar="CASE", help="a case file, or a bundled case's name")
    add_controllers(parser)
    parser.add_argument(
        "--out",
        metavar="DIR",
        help="where pictures, page, JSON and trajectories go; default: barbalat-run, none with --json",
    )
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    parser.add_argument("--no-plots", action="store_true", help="no pictures and no page")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from barbalat.cases.load import load_case

    case = load_case(options.case, options.controllers)
    with folder_of(options.out, None if options.json or options.no_plots else "barbalat-run") as folder:
        results = _simulated(case)
        from barbalat.report import write

        document = write.as_json(write.run_document(case.name, results, None))
        if folder is not None:
            folder.write(write.RUN, document)
            write.write_trajectories(folder, results)
            folder.commit(gone=write.files_of_run(folder.path))  # whatever becomes of the certificates, the runs are safe
            if not options.no_plots:
                document = _with_page(folder, case, results)
        if options.json:
            print_json(document)
        else:
            _show(results, folder)
    return 0


def _simulated(case: Case) -> list[Result]:
    """All controllers, those that were numerically unstable also at a finer step."""
    from barbalat.run.check_numerics import check_numerics
    from barbalat.run.simulate import simulate

    with progress_bar("simulating") as progress:
        found = simulate(case.problem, case.controllers, case.simulation, progress=progress)
    labelled = [name for name, result in found.items() if result.label is not None]
    if labelled:
        say(f"numerically unstable, repeated at a finer step: {', '.join(labelled)}")
        with progress_bar("checking the numerics") as progress:
            found = check_numerics(found, progress=progress)
    return list(found.values())


def _with_page(folder: Folder, case: Case, results: Sequence[Result]) -> str:
    """Certify and write the page; the JSON document with what was found."""
    from barbalat.certificates.overview import certified_case
    from barbalat.report import write

    certified = certified_case(case.problem, case.controllers, case.simulation)
    document = write.as_json(write.run_document(case.name, results, certified))
    folder.write(write.RUN, document)
    write.write_comparison(folder, case.name, results, certified)
    folder.commit()
    return document


def _show(results: Sequence[Result], folder: Folder | None) -> None:
    from rich.markup import escape

    from barbalat.report import tables

    console = tables.console()
    console.print(tables.figures_of_runs(results))
    for result in results:
        console.print(escape(f"{result.name}: {result.numerics}"))
    if any(result.adapting is not None for result in results):
        console.print(tables.adapting_of_runs(results))
    for result in results:
        for warning in () if result.adapting is None else result.adapting.warnings:
            console.print(f"[yellow]{escape(f'{result.name}: {warning}')}[/yellow]")
    if folder is not None:
        console.print(escape(f"written to {folder.path}"))
