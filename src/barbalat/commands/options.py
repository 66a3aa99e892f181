"""Options that several commands share."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_budget(parser: argparse.ArgumentParser) -> None:
    """How much work may be begun."""
    parser.add_argument(
        "--budget",
        metavar="LIMITS",
        help="memory and time of one core that work may take by its estimate before it is begun, such as 16GiB, 5h or 16GiB,5h; "
        "default: 4GiB,1h",
    )


def add_controllers(parser: argparse.ArgumentParser) -> None:
    """Classes of the user's own."""
    parser.add_argument(
        "--controllers",
        type=Path,
        metavar="FILE.py",
        help="controllers of your own beside the case's: this file is run, and its list CONTROLLERS joins them, or else all "
        'controllers made in it; the case may name its classes, as scheme = "MyLaw"',
    )
