"""Options that several commands share."""

from __future__ import annotations

import argparse
from decimal import Decimal, InvalidOperation
from pathlib import Path

from barbalat.commands.parser import Several


def add_budget(parser: argparse.ArgumentParser) -> None:
    """How much work may be begun."""
    parser.add_argument(
        "--budget",
        type=_limits,
        metavar="LIMITS",
        help="memory and time of one core that work may take by its estimate before it is begun, such as 16GiB, 5h or 16GiB,5h; "
        "default: 4GiB,1h",
    )


def _limits(text: str) -> str:
    if any(part.strip().startswith("-") for part in text.split(",")):
        raise argparse.ArgumentTypeError(f"must be a positive memory, a positive time or both, such as 16GiB,5h, got {text!r}")
    return text


MOST_DIGITS = 40
"""Of a whole number: as many as any seed needs, and more than any count."""


def whole(text: str) -> int:
    """The type of an option that takes a whole number, which may be written as 1e6."""
    try:
        number = Decimal(text)
    except InvalidOperation:
        raise ValueError(text) from None
    if not number.is_finite() or number != number.to_integral_value():
        raise ValueError(text)
    if number.adjusted() >= MOST_DIGITS:
        from barbalat.validate import show

        raise argparse.ArgumentTypeError(f"must be a whole number of at most {MOST_DIGITS} digits, got {show(text)}")
    return int(number)


def add_controllers(parser: argparse.ArgumentParser) -> None:
    """Classes of the user's own."""
    parser.add_argument(
        "--controllers",
        type=Path,
        metavar="FILE.py",
        help="controllers of your own beside the case's: this file is run, and its list CONTROLLERS joins them, or else all "
        'controllers made in it; the case may name its classes, as scheme = "MyLaw"',
    )


def add_list(parser: argparse.ArgumentParser, *names: str, metavar: str, help: str, form: str = "", commas: bool = False) -> None:
    """An option with several values: after one another, or each after the option once more; an empty list without it.

    form    a regular expression that is found in each value, and hardly in anything else
    commas  whether values may also stand with commas between
    """
    said = "several, or the option again, for more"
    parser.add_argument(
        *names, action=Several, nargs="+", default=[], metavar=metavar, help=f"{help}; {said}", form=form, commas=commas
    )
