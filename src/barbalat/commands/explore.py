"""``barbalat explore`` writes a page with a slider for each number of a case, one file that simulates offline."""

from __future__ import annotations

import argparse
import webbrowser
from contextlib import nullcontext
from dataclasses import replace
from typing import TYPE_CHECKING

from barbalat.commands.options import add_case, conclude
from barbalat.commands.output import STANDARD_OUTPUT, print_json, print_text
from barbalat.commands.progress import say, work

if TYPE_CHECKING:
    from barbalat.commands import Commands

DEFAULT_FILE = "explore.html"


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser(
        "explore", help="write an offline page that simulates the case and has a slider for each of its parameters"
    )
    add_case(parser)
    parser.add_argument(
        "--out",
        metavar="FILE",
        default=DEFAULT_FILE,
        help=f"file for the page; default: {DEFAULT_FILE}. {STANDARD_OUTPUT} writes to standard output and opens no browser",
    )
    parser.add_argument("--no-open", action="store_true", help="do not open the page in a browser")
    conclude(parser, execute)


EXPECTED_SECONDS = 10.0
"""Estimated seconds for a case with three controllers. Most of the time is spent on numbers that change other numbers."""


def execute(options: argparse.Namespace) -> int:
    """Run the command. Return the exit code."""
    from barbalat.cases.load import CaseText
    from barbalat.explorer.explorer import Explorer
    from barbalat.explorer.section_v import ON_THE_PAPER_S_EXAMPLE, PAPER_CASE
    from barbalat.explorer.source import TextSource
    from barbalat.folders import output_folder
    from barbalat.study.fixed_steps import fixed_steps
    from barbalat.validate import InputError, local_path

    file, to_output = local_path("--out", options.out), options.out == STANDARD_OUTPUT
    if not options.out or file.is_dir():
        raise InputError(f"--out must name a file, such as {DEFAULT_FILE}, got {options.out!r}")
    if to_output and options.json:
        raise InputError(f"--json and --out {STANDARD_OUTPUT} both write to standard output; omit one of them")
    text = CaseText.read(options.case, options.controllers)
    case = text.case()
    steps = fixed_steps(case.problem, case.controllers, case.simulation)
    source = TextSource(replace(text, dt=steps.simulation.dt))
    explorer = Explorer(source, ON_THE_PAPER_S_EXAMPLE if options.case == PAPER_CASE and text.own is None else ())
    with nullcontext() if to_output else output_folder(file.parent) as folder:
        with work({"making the page": EXPECTED_SECONDS}) as running, running.part("making the page"):
            page = explorer.html
        if folder is not None:
            folder.write(file.name, page)
            folder.commit()
    if to_output:
        print_text(page)
        return 0
    if options.json:
        from barbalat.report.documents import as_json

        print_json(as_json({"case": case.name, "page": str(file)}))
    else:
        for line in filter(None, (steps.sentence, f"page: {file}")):
            say(line)
    if not options.no_open:
        webbrowser.open(file.resolve().as_uri())
    return 0
