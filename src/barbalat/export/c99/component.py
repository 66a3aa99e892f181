"""Exports with names of their own in one folder, as one component: a header, a README and a target of CMake join them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import pairwise
from pathlib import Path

from barbalat import validate
from barbalat.export.texts import comment, filled, indented
from barbalat.validate import InputError

HEADER = "_controller.h"
"""What the header of an export with a name is called, behind that name."""


def joined(present: Mapping[str, str]) -> dict[str, str]:
    """The files that join the exports of these names, each with its header's text: all that stand in one folder."""
    names = sorted(present)
    for a, b in pairwise(sorted(names, key=str.upper)):
        if a.upper() == b.upper():
            raise InputError(
                f"names in one folder must differ by more than their case, got {validate.show(a)} and {validate.show(b)}"
            )
    return {
        "controllers.h": filled("controllers.h", includes="".join(f'#include "{name}{HEADER}"\n' for name in names)),
        "CMakeLists.txt": filled("component.cmake", names=" ".join(names)),
        "README.md": filled(
            "README_component.md",
            rows=indented(
                (f"| `{name}` | {_origin(text)} | [{name}_README.md]({name}_README.md) |" for name, text in present.items()), 0
            ),
            tests=" && ".join(f"./build/{name}_selftest" for name in names),
        ),
    }


def present(folder: Path, names: Iterable[str] = ()) -> dict[str, str]:
    """By their names the headers of exports with a name that stand in a folder, without these names."""
    found = {file.name.removesuffix(HEADER): file.read_text("utf-8", "replace") for file in folder.glob(f"?*{HEADER}")}
    return {name: text for name, text in found.items() if name not in names and f"#define {name.upper()}_EXPORT " in text}


def _origin(header: str) -> str:
    """What a header says of itself in its first lines: the controller, its scheme, its sample time, its case."""
    lines = [line.removeprefix(" * ").strip() for line in header.splitlines()[1:3]]
    return comment(" ".join(lines).partition(". Made by")[0])
