"""``barbalat new``: a case file to start from, and the schema by which editors complete it."""

from __future__ import annotations

import argparse
import os
from typing import TYPE_CHECKING

from barbalat.commands.output import STANDARD_OUTPUT, print_json, print_text
from barbalat.commands.screen import say

if TYPE_CHECKING:
    from barbalat.commands import Commands

SCHEMA_FILE = "barbalat.schema.json"


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser("new", help="write a commented case file to start from")
    parser.add_argument(
        "file", metavar="FILE", help=f"where the case goes; one that is there is kept; {STANDARD_OUTPUT} is standard output"
    )
    parser.add_argument("--from", dest="source", metavar="CASE", help="a bundled case to copy instead of the template")
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from barbalat.cases.load import text_to_start_from
    from barbalat.cases.schema import json_schema
    from barbalat.report.documents import as_json
    from barbalat.report.files import output_folder
    from barbalat.validate import InputError, local_path

    if options.file == STANDARD_OUTPUT:
        if options.json:
            raise InputError(f"--json and FILE {STANDARD_OUTPUT} both write to standard output; leave one of them out")
        print_text(text_to_start_from(options.source))
        return 0
    file = local_path("FILE", options.file)
    if not options.file or os.path.lexists(file):
        raise InputError(f"{options.file!r} exists already; choose another name" if options.file else "FILE must not be empty")
    text = text_to_start_from(options.source)
    with output_folder(file.parent) as folder:
        folder.write(file.name, f"#:schema ./{SCHEMA_FILE}\n{text}")
        with_schema = not os.path.lexists(file.parent / SCHEMA_FILE)  # one that is there may be the user's
        if with_schema:
            folder.write(SCHEMA_FILE, as_json(json_schema()))
        folder.commit()
    if options.json:
        print_json(as_json({"case": str(file), "schema": str(file.parent / SCHEMA_FILE) if with_schema else None}))
        return 0
    say(f"written: {file}")
    if with_schema:
        say(f"and beside it {SCHEMA_FILE}, by which editors complete and check it")
    say(f"run it with: barbalat run {file}")
    return 0
