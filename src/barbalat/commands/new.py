"""``barbalat new``: a case file to start from."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from barbalat.commands.screen import say

if TYPE_CHECKING:
    from barbalat.commands import Commands


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser("new", help="write a commented case file to start from")
    parser.add_argument("file", type=Path, metavar="FILE")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from importlib import resources

    from barbalat.report.files import prepare_folder, write
    from barbalat.validate import InputError

    if options.file.exists():
        raise InputError(f"{str(options.file)!r} exists already; choose another name")
    prepare_folder(options.file.parent)
    write(options.file, (resources.files("barbalat.cases") / "template.toml").read_bytes())
    say(f"written: {options.file}; run it with: barbalat run {options.file}")
    return 0
