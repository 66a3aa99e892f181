"""Which schemes a flight offers: those that can be designed here; and what is said of a name that is none of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from importlib.util import find_spec

from barbalat.validate import InputError, show

ROBUST = "hinf"
"""The one whose synthesis takes packages of the extra ``robust``, by its name in every flight's registry."""
COUNTERPARTS = {"lqr": "geometric", "linear": "geometric-integral"}
"""Of the F-16's schemes that the quadrotor does not have, and there under other names: feedback alone, and with an integral."""


def designable(names: Iterable[str]) -> list[str]:
    """Of these schemes, those whose packages are installed."""
    return [name for name in names if name != ROBUST or find_spec("slycot") is not None]


def require_offered(names: Sequence[str], offered: Mapping[str, object]) -> None:
    """InputError for a scheme that is none of these, with the one that may be meant."""
    unknown = [name for name in names if name not in offered]
    if unknown:
        there = COUNTERPARTS | {its: own for own, its in COUNTERPARTS.items()}
        name = unknown[0]
        near = [there[name]] if name in there else get_close_matches(name, offered, n=1)
        meant = f"; here it is {near[0]}" if name in there else f"; did you mean {near[0]}?" if near else ""
        raise InputError(f"--schemes must be of {', '.join(offered)}, got {show(name)}{meant}")
