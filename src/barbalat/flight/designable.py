"""Which schemes can be designed here: all but the one whose synthesis takes packages of the extra ``robust``."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.util import find_spec

ROBUST = "hinf"
"""Its name in every flight's registry."""


def designable(names: Iterable[str]) -> list[str]:
    """Of these schemes, those whose packages are installed."""
    return [name for name in names if name != ROBUST or find_spec("slycot") is not None]
