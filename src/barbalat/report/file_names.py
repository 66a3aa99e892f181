"""What the files of each controller are called."""

from __future__ import annotations

import re
from collections.abc import Sequence

LONGEST_NAME = 80
"""Characters of a controller's name in a file's; file systems take 255 bytes, and people read fewer."""


def table_names(names: Sequence[str]) -> list[str]:
    """Of the controllers' CSVs; the number makes them different."""
    return [f"{i}-{file_name(name)}.csv" for i, name in enumerate(names, start=1)]


def diagram_names(names: Sequence[str]) -> list[str]:
    """For each controller one of its own."""
    chosen: list[str] = []
    for name in names:
        plain = f"diagram-{file_name(name)}"
        numbered = (f"{plain}-{i}" for i in range(2, len(names) + 1))
        chosen.append(next(new for new in (plain, *numbered) if new not in chosen))
    return chosen


def file_name(name: str) -> str:
    """What of a name every file system takes."""
    return re.sub(r"[^A-Za-z0-9]+", "-", name)[:LONGEST_NAME].strip("-").lower() or "controller"
