"""The names of the files that commands write."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path

PAGE, RUN, CERTIFICATES = "report.html", "run.json", "certify.json"
"""The first page of a command, and the documents of ``run`` and ``certify``."""
TUNED_CASE = "tuned.toml"
"""The case file that ``tune`` writes."""
COLUMNS = "datapackage.json"
"""The file that describes the columns of the CSVs. A standard defines this name."""
PICTURE, LOOPS = "comparison", "loops"
"""Names without suffixes: each picture exists in several formats."""
NARROW = "-narrow"
"""Suffix of a picture's name for phones."""

LONGEST_NAME = 80
"""Largest number of characters of a controller's name in a file name. File systems allow 255 bytes, but shorter names are
more readable."""


def table_names(names: Sequence[str]) -> list[str]:
    """Return the names of the controllers' CSV files. Numbers make them unique."""
    return [f"{i}-{file_name(name)}.csv" for i, name in enumerate(names, start=1)]


def diagram_names(names: Sequence[str]) -> list[str]:
    """Return the name of each controller's diagram."""
    chosen: list[str] = []
    for name in names:
        plain = f"diagram-{file_name(name)}"
        numbered = (f"{plain}-{i}" for i in range(2, len(names) + 1))
        chosen.append(next(new for new in (plain, *numbered) if new not in chosen))
    return chosen


def loop_names(count: int) -> list[str]:
    """Return the names of ``count`` pictures of loops."""
    return [f"{LOOPS}{f'-{i}' if i > 1 else ''}" for i in range(1, count + 1)]


def files_of_run(folder: Path) -> set[str]:
    """Return the files that ``barbalat run`` may have left in a folder, according to its ``run.json``. Without that file the
    set is empty."""
    try:
        names = [str(name) for name in json.loads((folder / RUN).read_bytes())["controllers"]]
    except (OSError, ValueError, LookupError, TypeError):
        return set()
    drawn = {f"{name}.{kind}" for name in (PICTURE, *diagram_names(names)) for kind in ("png", "svg")}
    drawn |= {f"{name}.{kind}" for name in loop_names(len(names)) for kind in ("png", "svg")}
    return {RUN, PAGE, COLUMNS, *table_names(names)} | drawn


def file_name(name: str) -> str:
    """Reduce a name to characters that every file system accepts."""
    return re.sub(r"[^A-Za-z0-9]+", "-", name)[:LONGEST_NAME].strip("-").lower() or "controller"
