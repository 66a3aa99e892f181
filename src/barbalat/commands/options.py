"""Options that several commands share."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_controllers(parser: argparse.ArgumentParser) -> None:
    """Classes of the user's own."""
    parser.add_argument(
        "--controllers",
        type=Path,
        metavar="FILE.py",
        help="controllers of your own beside the case's: this file is run, and its list CONTROLLERS joins them, or else all "
        'controllers made in it; the case may name its classes, as scheme = "MyLaw"',
    )
