"""Named exports in one folder form a component, joined by a header, a README and a CMake target."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from itertools import pairwise
from pathlib import Path

from barbalat import validate
from barbalat.export.texts import comment, filled, indented
from barbalat.validate import InputError

HEADER = "_controller.h"
"""The file name of the header of a named export, after the name of the export."""


def joined(present: Mapping[str, str]) -> dict[str, str]:
    """The files that join the exports of these names in one folder, from the text of each header."""
    names = sorted(present)
    for a, b in pairwise(sorted(names, key=str.upper)):
        if a.upper() == b.upper():
            raise InputError(
                f"names in one folder must differ by more than their case, got {validate.show(a)} and {validate.show(b)}"
            )
    _require_distinct(present)
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


def _require_distinct(present: Mapping[str, str]) -> None:
    """Raise InputError if two headers define the same identifier. For example, ``pitch_read_log`` is both the function of
    ``pitch`` that reads the log and the type of the log of ``pitch_read``."""
    owner: dict[str, str] = {}
    for name in sorted(present):
        own = {found[found.lastindex or 0] for found in DEFINED.finditer(present[name])}
        if both := sorted(own & owner.keys()):
            raise InputError(
                f"the names {owner[both[0]]} and {name} can't be in one folder because both exports would define {both[0]}: "
                f"choose a different name"
            )
        owner |= dict.fromkeys(own, name)


DEFINED = re.compile(r"^#define (\w+)|^\} (\w+);$|^(?:unsigned|void) (\w+)\(", re.MULTILINE)
"""A macro, a type or a function in a header."""


def present(folder: Path, names: Iterable[str] = ()) -> dict[str, str]:
    """The headers of named exports in a folder, by name, without the given names."""
    found = {file.name.removesuffix(HEADER): file.read_text("utf-8", "replace") for file in folder.glob(f"?*{HEADER}")}
    return {name: text for name, text in found.items() if name not in names and f"#define {name.upper()}_EXPORT " in text}


def require_apart(folder: Path, made: Iterable[str]) -> None:
    """Raise InputError if only one of the new export and the export in the folder has a name.

    Both would write a ``README.md``: the unnamed export for itself, and the named export for the component.
    """
    joint, where = any(file.endswith(HEADER) for file in made), validate.show(str(folder))
    if not joint and (found := sorted(present(folder))):
        raise InputError(
            f"{where} contains exports with names ({', '.join(found)}), and this export would replace their README.md: give it "
            f"a name as well, or choose a different folder"
        )
    if joint and _is_export(folder / HEADER.removeprefix("_")):
        raise InputError(
            f"{where} contains an export without a name, and this export would replace its README.md: choose a different "
            f"folder, or export the other controller again with a name"
        )


def _is_export(header: Path) -> bool:
    return header.is_file() and re.search(r"^#define \w+_EXPORT ", header.read_text("utf-8", "replace"), re.MULTILINE) is not None


def _origin(header: str) -> str:
    """The description in the first lines of a header: the controller, its scheme, its sample time, its case."""
    lines = [line.removeprefix(" * ").strip() for line in header.splitlines()[1:3]]
    return comment(" ".join(lines).partition(". Made by")[0])
