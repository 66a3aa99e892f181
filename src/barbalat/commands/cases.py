"""``barbalat cases``: the bundled cases."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from barbalat.commands import Commands


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser("cases", help="list the bundled cases")
    parser.set_defaults(execute=execute)


def execute(_: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from barbalat.cases.load import bundled, load_case
    from barbalat.report import tables

    console = tables.console()
    for name in bundled():
        case = load_case(name)
        schemes = ", ".join(controller.name for controller in case.controllers)
        order = len(case.problem.dynamics.x0)
        console.print(f"{name:18} {case.name}: n = {order}; {schemes}", markup=False)
    return 0
