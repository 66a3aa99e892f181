"""``barbalat new`` writes a case file to start from, with the schema that editors use for completion, or a new law."""

from __future__ import annotations

import argparse
import keyword
import os
import re
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from barbalat.commands.output import STANDARD_OUTPUT, print_json, print_text
from barbalat.commands.progress import say

if TYPE_CHECKING:
    from barbalat.commands import Commands

SCHEMA_FILE = "barbalat.schema.json"
LAW = ".py"
"""Suffix of a file with a law."""
LAW_CLASS = "MyLaw"
"""Name of the class in the template. The class of the new law is named after the file if that gives a valid name."""


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser("new", help="write a commented case file to start from, or a law in Python")
    parser.add_argument(
        "file",
        metavar="FILE",
        help=f"the case file to write, or FILE.py for a law; {STANDARD_OUTPUT} is standard output. An existing file is never "
        "overwritten",
    )
    parser.add_argument("--from", dest="source", metavar="CASE", help="copy this bundled case instead of the template")
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Run the command. Return the exit code."""
    from barbalat.cases.load import text_to_start_from
    from barbalat.cases.schema import json_schema
    from barbalat.folders import output_folder
    from barbalat.report.documents import as_json
    from barbalat.validate import InputError, local_path

    if options.file == STANDARD_OUTPUT:
        if options.json:
            raise InputError(f"--json and FILE {STANDARD_OUTPUT} both write to standard output; omit one of them")
        print_text(text_to_start_from(options.source))
        return 0
    file = local_path("FILE", options.file)
    if not options.file or os.path.lexists(file):
        raise InputError(
            f"{options.file!r} exists already; choose a different name" if options.file else "FILE must not be empty"
        )
    if file.suffix == LAW:
        return _law(file, options)
    text = text_to_start_from(options.source)
    with output_folder(file.parent) as folder:
        folder.write(file.name, f"#:schema ./{SCHEMA_FILE}\n{text}")
        with_schema = not os.path.lexists(file.parent / SCHEMA_FILE)  # an existing file may belong to the user
        if with_schema:
            folder.write(SCHEMA_FILE, as_json(json_schema()))
        folder.commit()
    if options.json:
        print_json(as_json({"case": str(file), "schema": str(file.parent / SCHEMA_FILE) if with_schema else None}))
        return 0
    say(f"written: {file}")
    if with_schema:
        say(f"written to the same folder: {SCHEMA_FILE}, which lets editors complete and check the case file")
    say(f"run it with: barbalat run {file}")
    return 0


def _law(file: Path, options: argparse.Namespace) -> int:
    """Write a new law instead of a case."""
    from barbalat.folders import output_folder
    from barbalat.report.documents import as_json
    from barbalat.validate import InputError

    if options.source is not None:
        raise InputError(f"--from copies a case, but {file.name!r} is a file name for a law: give a name that ends in .toml")
    with output_folder(file.parent) as folder:
        folder.write(file.name, _law_for(file.name))
        folder.commit()
    if options.json:
        print_json(as_json({"law": str(file)}))
        return 0
    say(f"written: {file}")
    say(f"run it with: barbalat run paper --controllers {file}")
    say(f"check it with: python {file}")
    contest = f"barbalat contest CASE --controllers {file} --schemes mrac l1 --quick"
    say(f"tune all laws with equal effort and compare them with: {contest}")
    say("run and sweep use gains that were not tuned with equal effort, so they do not show which law is better")
    return 0


def _law_for(file: str) -> str:
    """Return the Python text of a law for a file of this name. It runs without changes, and its class is named after the file."""
    text = (resources.files("barbalat.commands") / "law_template.py").read_text("utf-8")
    name = "".join(word[0].upper() + word[1:] for word in re.findall(r"[A-Za-z0-9]+", Path(file).stem))
    taken = not name.isidentifier() or keyword.iskeyword(name) or re.search(rf"\b{name}\b", text) is not None
    return text.replace(LAW_CLASS, LAW_CLASS if taken else name).replace("FILE", Path(file).name)
