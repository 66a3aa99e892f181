"""``barbalat claims``: the rows of the ledger, or the full measurement of one row."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from barbalat.commands.output import print_json
from barbalat.commands.progress import work

if TYPE_CHECKING:
    from barbalat.commands import Commands


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser("claims", help="list the claims of the papers, or measure one of them")
    parser.add_argument(
        "name", nargs="?", metavar="NAME", help="measure the claim NAME and show its details; default: list all claims"
    )
    parser.add_argument("--list", action="store_true", help="list all claims; the same as giving no NAME")
    parser.add_argument(
        "--notebook",
        metavar="FILE",
        help="instead of measuring, write a notebook (.ipynb) that contains the code of the claim, for experiments",
    )
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Run the command. Return the exit code, which is 0 whatever the finding."""
    from barbalat.papers import ledger
    from barbalat.papers.paper import papers
    from barbalat.report.documents import as_json
    from barbalat.report.terminal import ledger as terminal
    from barbalat.report.terminal.layout import Screen
    from barbalat.validate import InputError

    if options.list and (options.name is not None or options.notebook is not None):
        raise InputError("--list takes neither a NAME nor --notebook: it lists all claims (barbalat claims NAME measures one)")
    if options.notebook is not None:
        return _write_notebook(options)
    if options.name is None:
        if options.json:
            print_json(
                as_json({"claims": [row for paper in papers().values() for part in paper.ledger for row in part.as_json()]})
            )
        else:
            terminal.names(Screen(), list(papers().values()))
        return 0
    paper, part = ledger.part_with(options.name)
    with work({"measuring": part.seconds + paper.run_seconds * part.judges_runs}) as running, running.part("measuring"):
        claim = ledger.row(options.name)
    if options.json:
        print_json(as_json(claim.as_json()))
    else:
        terminal.in_full(Screen(), claim)
    return 0


def _write_notebook(options: argparse.Namespace) -> int:
    from barbalat.folders import output_folder
    from barbalat.papers.notebook import notebook
    from barbalat.report.documents import as_json
    from barbalat.report.terminal.layout import Screen
    from barbalat.validate import InputError, local_path

    if options.name is None:
        raise InputError("--notebook needs the NAME of a claim (barbalat claims lists them)")
    file = local_path("--notebook", options.notebook)
    if file.suffix != ".ipynb":
        raise InputError(f"--notebook must name a file that ends in .ipynb, got {str(file)!r}")
    text = notebook(options.name)
    with output_folder(file.parent) as folder:
        folder.write(file.name, text)
        folder.commit()
    if options.json:
        print_json(as_json({"notebook": str(file)}))
    else:
        Screen().whole(f"notebook: {file}")
    return 0
