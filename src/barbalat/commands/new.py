"""``barbalat new``: a case file to start from."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING

from barbalat.commands.screen import say

if TYPE_CHECKING:
    from barbalat.commands import Commands


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser("new", help="write a commented case file to start from")
    parser.add_argument("file", metavar="FILE")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from importlib import resources

    from barbalat.report.files import output_folder
    from barbalat.validate import InputError

    file = Path(options.file)
    if not options.file or os.path.lexists(file):
        raise InputError(f"{options.file!r} exists already; choose another name" if options.file else "FILE must not be empty")
    with output_folder(file.parent) as folder:
        folder.write(file.name, (resources.files("barbalat.cases") / "template.toml").read_bytes())
        folder.commit()
    say(f"written: {file}; run it with: barbalat run {file}")
    return 0
