"""``barbalat schema`` prints the JSON Schema of case files, which lets editors complete and check them."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from barbalat.commands.output import print_json

if TYPE_CHECKING:
    from barbalat.commands import Commands


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser("schema", help="print the JSON Schema of case files, for editors")
    parser.set_defaults(execute=execute)


def execute(_: argparse.Namespace) -> int:
    """Run the command. Return the exit code."""
    from barbalat.cases.schema import json_schema
    from barbalat.report.documents import as_json

    print_json(as_json(json_schema()))
    return 0
