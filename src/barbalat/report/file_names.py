"""What the files that the commands leave are called."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path

PAGE, RUN, CERTIFICATES = "report.html", "run.json", "certify.json"
"""A command's first page, the documents of ``run`` and ``certify``."""
TUNED_CASE = "tuned.toml"
"""The case that ``tune`` found."""
COLUMNS = "datapackage.json"
"""What the columns of the CSVs are; the name is the standard's."""
PICTURE, LOOPS = "comparison", "loops"
"""Without their suffixes: each picture is there in several forms."""
NARROW = "-narrow"
"""After the name of a picture for a phone."""

LONGEST_NAME = 80
"""Characters of a controller's name in a file's; file systems take 255 bytes, and people read fewer."""


def table_names(names: Sequence[str]) -> list[str]:
    """Return the names of the controllers' CSV files; the number keeps them apart."""
    return [f"{i}-{file_name(name)}.csv" for i, name in enumerate(names, start=1)]


def diagram_names(names: Sequence[str]) -> list[str]:
    """For each controller one of its own."""
    chosen: list[str] = []
    for name in names:
        plain = f"diagram-{file_name(name)}"
        numbered = (f"{plain}-{i}" for i in range(2, len(names) + 1))
        chosen.append(next(new for new in (plain, *numbered) if new not in chosen))
    return chosen


def loop_names(count: int) -> list[str]:
    """Return the names of so many pictures of loops."""
    return [f"{LOOPS}{f'-{i}' if i > 1 else ''}" for i in range(1, count + 1)]


def files_of_run(folder: Path) -> set[str]:
    """What ``barbalat run`` may have left in a folder, by the ``run.json`` that lies there; nothing where none does."""
    try:
        names = [str(name) for name in json.loads((folder / RUN).read_bytes())["controllers"]]
    except (OSError, ValueError, LookupError, TypeError):
        return set()
    drawn = {f"{name}.{kind}" for name in (PICTURE, *diagram_names(names)) for kind in ("png", "svg")}
    drawn.add(f"{PICTURE}{NARROW}.svg")
    drawn |= {f"{name}{variant}.svg" for name in loop_names(len(names)) for variant in ("", NARROW)}
    return {RUN, PAGE, COLUMNS, *table_names(names)} | drawn


def file_name(name: str) -> str:
    """What of a name every file system takes."""
    return re.sub(r"[^A-Za-z0-9]+", "-", name)[:LONGEST_NAME].strip("-").lower() or "controller"
