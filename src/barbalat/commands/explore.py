"""``barbalat explore``: a page with a slider for each number of a case, one file that simulates offline."""

from __future__ import annotations

import argparse
import webbrowser
from typing import TYPE_CHECKING

from barbalat.commands.output import print_json
from barbalat.commands.screen import say, work

if TYPE_CHECKING:
    from barbalat.commands import Commands

DEFAULT_FILE = "explore.html"


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser("explore", help="a page that simulates: one file with a slider for each number of a case")
    parser.add_argument("case", metavar="CASE", help="a case file, or a bundled case's name")
    parser.add_argument("--out", metavar="FILE", default=DEFAULT_FILE, help=f"where the page goes; default: {DEFAULT_FILE}")
    parser.add_argument("--no-open", action="store_true", help="don't open it in a browser")
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    parser.set_defaults(execute=execute)


EXPECTED_SECONDS = 10.0
"""For a case of three controllers, about: every value of a slider behind which other numbers follow is made into a case."""


def execute(options: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from barbalat.cases.load import CaseText
    from barbalat.explorer.explorer import Explorer
    from barbalat.explorer.section_v import ON_THE_PAPER_S_EXAMPLE, PAPER_CASE
    from barbalat.explorer.source import TextSource
    from barbalat.report.files import output_folder
    from barbalat.validate import InputError, local_path

    file = local_path("--out", options.out)
    if not options.out or file.is_dir():
        raise InputError(f"--out must name a file, such as {DEFAULT_FILE}, got {options.out!r}")
    text = CaseText.read(options.case)
    text.case()
    with output_folder(file.parent) as folder:
        with work({"making the page": EXPECTED_SECONDS}) as running, running.part("making the page"):
            page = Explorer(TextSource(text), ON_THE_PAPER_S_EXAMPLE if options.case == PAPER_CASE else ()).html
        folder.write(file.name, page)
        folder.commit()
    if options.json:
        from barbalat.report.documents import as_json

        print_json(as_json({"case": text.case().name, "page": str(file)}))
    else:
        say(f"page: {file}")
    if not options.no_open:
        webbrowser.open(file.resolve().as_uri())
    return 0
