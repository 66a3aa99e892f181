"""``barbalat cases``: the bundled cases."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from barbalat.commands import Commands


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser("cases", help="list the bundled cases")
    parser.set_defaults(execute=execute)


def execute(_: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from barbalat.cases.bundled import bundled
    from barbalat.cases.load import load_case
    from barbalat.report.terminal.layout import Screen, held

    screen = Screen()
    for name, path in bundled().items():
        case = load_case(name)
        compared = "; ".join(held(controller.name) for controller in case.controllers)
        screen.line(name, "bold")
        for text in (_first_sentence(path), f"State of order {len(case.problem.dynamics.x0)}. Controllers: {compared}."):
            screen.line(text, indent="  ", start="  ")
    screen.title("barbalat run NAME simulates one; barbalat new FILE --from NAME copies it to start from.", "")
    return 0


def _first_sentence(path: Path) -> str:
    """Of the comment that opens a case file."""
    lines = path.read_text("utf-8").splitlines()
    comment = " ".join(line.removeprefix("#").strip() for line in lines[: next(i for i, x in enumerate(lines) if x[:1] != "#")])
    return comment.split(". ")[0].rstrip(".") + "."
