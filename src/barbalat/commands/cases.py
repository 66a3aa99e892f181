"""``barbalat cases``: the bundled cases."""

from __future__ import annotations

import argparse
import textwrap
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from barbalat.commands import Commands

WIDTH = 80
"""Columns that a line takes at most, where the terminal has more."""


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser("cases", help="list the bundled cases")
    parser.set_defaults(execute=execute)


def execute(_: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from barbalat.cases.bundled import bundled
    from barbalat.cases.load import load_case
    from barbalat.report import tables

    console = tables.console()
    width = min(console.width, WIDTH)
    for name, path in bundled().items():
        case = load_case(name)
        console.print(name, style="bold", markup=False, highlight=False)
        compared = f"State of order {len(case.problem.dynamics.x0)}. Controllers: {'; '.join(c.name for c in case.controllers)}."
        for paragraph in (_first_sentence(path), compared):
            lines = textwrap.wrap(paragraph, width, initial_indent="  ", subsequent_indent="  ")
            console.print("\n".join(lines), markup=False, highlight=False)
    console.print("\nbarbalat run NAME simulates one; barbalat new FILE --from NAME copies it to start from.", highlight=False)
    return 0


def _first_sentence(path: Path) -> str:
    """Of the comment that opens a case file."""
    lines = path.read_text("utf-8").splitlines()
    comment = " ".join(line.removeprefix("#").strip() for line in lines[: next(i for i, x in enumerate(lines) if x[:1] != "#")])
    return comment.split(". ")[0].rstrip(".") + "."
