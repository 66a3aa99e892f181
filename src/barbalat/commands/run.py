"""``barbalat run``: simulate and compare a case's controllers."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from barbalat.commands.options import add_controllers
from barbalat.commands.screen import progress_bar, say

if TYPE_CHECKING:
    from barbalat.commands import Commands


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser("run", help="simulate and compare a case's controllers")
    parser.add_argument("case", metavar="CASE", help="a case file, or a bundled case's name")
    add_controllers(parser)
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="where pictures, page, JSON and trajectories go; default: barbalat-run, none with --json",
    )
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    parser.add_argument("--no-plots", action="store_true", help="no pictures and no page")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from barbalat.cases.load import load_case
    from barbalat.run.check_numerics import check_numerics
    from barbalat.run.simulate import simulate

    case = load_case(options.case, options.controllers)
    folder = options.out
    if folder is None and not options.json and not options.no_plots:
        folder = Path("barbalat-run")
    if folder is not None:
        from barbalat.report.files import prepare_folder

        prepare_folder(folder)
    with progress_bar("simulating") as progress:
        found = simulate(case.problem, case.controllers, case.simulation, progress=progress)
    labelled = [name for name, result in found.items() if result.label is not None]
    if labelled:
        say(f"numerically unstable, repeated at a finer step: {', '.join(labelled)}")
        with progress_bar("checking the numerics") as progress:
            found = check_numerics(found, progress=progress)
    results = list(found.values())

    from barbalat.report import tables, write
    from barbalat.report.files import write as write_file

    certified = None
    if folder is not None and not options.no_plots:
        from barbalat.certificates.overview import certified_case

        certified = certified_case(case.problem, case.controllers, case.simulation)
    document = write.as_json(write.run_document(case.name, results, certified))
    if folder is not None:
        write_file(folder / "run.json", document)
        write.write_trajectories(folder, results)
        if certified is not None:
            write.write_comparison(folder, case.name, results, certified)
    if options.json:
        print(document)  # noqa: T201
        return 0
    console = tables.console()
    console.print(tables.figures_of_runs(results))
    for result in results:
        console.print(f"{result.name}: {result.numerics}")
    if any(result.adapting is not None for result in results):
        console.print(tables.adapting_of_runs(results))
    for result in results:
        for warning in () if result.adapting is None else result.adapting.warnings:
            console.print(f"[yellow]{result.name}: {warning}[/yellow]")
    if folder is not None:
        console.print(f"written to {folder}")
    return 0
