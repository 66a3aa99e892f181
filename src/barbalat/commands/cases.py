"""``barbalat cases``: the bundled cases."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from barbalat.commands.output import print_json

if TYPE_CHECKING:
    from pathlib import Path

    from barbalat.commands import Commands


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser("cases", help="list the bundled cases")
    parser.add_argument("--json", action="store_true", help="print one JSON document on standard output")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Run the command. Return the exit code."""
    from barbalat.cases.bundled import bundled

    rows = [_row(name, path) for name, path in bundled().items()]
    if options.json:
        from barbalat.report.documents import as_json

        print_json(as_json({"cases": [row._asdict() for row in rows]}))
    else:
        _show(rows)
    return 0


class Row(NamedTuple):
    """A bundled case: its subject, the order of the plant's state, and the names of its controllers."""

    name: str
    about: str
    order: int
    controllers: list[str]


def _row(name: str, path: Path) -> Row:
    from barbalat.cases.load import load_case

    case = load_case(name)
    return Row(name, _first_sentence(path), len(case.problem.dynamics.x0), [controller.name for controller in case.controllers])


def _show(rows: Sequence[Row]) -> None:
    from barbalat.pictures.symbols import held
    from barbalat.report.terminal.layout import Screen
    from barbalat.validate import counted

    screen = Screen()
    for row in rows:
        screen.line(row.name, "bold")
        for text in (row.about, f"{counted(row.order, 'state')}. Controllers: {'; '.join(map(held, row.controllers))}."):
            screen.line(text, indent="  ", start="  ")
    screen.title("barbalat run NAME simulates one; barbalat new FILE --from NAME copies it as a starting point.", "")


def _first_sentence(path: Path) -> str:
    """Return the first sentence of the comment that opens a case file."""
    lines = path.read_text("utf-8").splitlines()
    comment = " ".join(line.removeprefix("#").strip() for line in lines[: next(i for i, x in enumerate(lines) if x[:1] != "#")])
    return comment.split(". ")[0].rstrip(".") + "."
