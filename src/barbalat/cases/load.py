"""Reading a case: a path or a bundled name in, a validated Case out, or one clear sentence."""

from __future__ import annotations

import difflib
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from barbalat.cases import schema
from barbalat.cases.build import Case, build
from barbalat.cases.tables import SHAPES
from barbalat.validate import InputError, show

PLANNED = {
    "plant.transfer_function": "output feedback",
    "reference_model.transfer_function": "output feedback",
}
"""Keys of the case-file contract that this version does not serve yet, and what they are about."""

PLANNED_SCHEMES = ("l1-output", "mrac-output")


def bundled() -> dict[str, Path]:
    """The bundled cases: name -> file."""
    folder = Path(str(resources.files("barbalat.cases")))
    return {path.stem: path for path in sorted(folder.glob("*.toml")) if path.stem != "template"}


def load_case(case: str | Path) -> Case:
    """Load a case file, or a bundled case by its name.

    Raises InputError, with one sentence, for a missing or unreadable file, text that is not TOML, unknown keys (with the
    nearest known one), and everything that the objects' constructors refuse.
    """
    path = bundled().get(str(case), Path(case))
    try:
        text = path.read_bytes().decode("utf-8")
    except FileNotFoundError:
        names = ", ".join(bundled())
        raise InputError(f"the case {str(case)!r} is neither a file nor a bundled case ({names})") from None
    except (OSError, ValueError) as error:
        reason = "it is not UTF-8 text" if isinstance(error, UnicodeDecodeError) else getattr(error, "strerror", None) or error
        raise InputError(f"the case file {str(path)!r} cannot be read: {reason}") from None
    return parse_case(text, folder=path.parent, source=str(path))


def parse_case(text: str, folder: Path = Path(), source: str = "the case") -> Case:
    """The same from TOML text; relative paths in it start at ``folder``."""
    try:
        data = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, ValueError, RecursionError) as error:
        raise InputError(f"{source} is not valid TOML: {error}") from None
    _refuse_planned(data)
    try:
        table = schema.CaseTable.model_validate(data)
    except ValidationError as error:
        # a misspelt key is also a missing one: speak of the spelling
        findings = sorted(error.errors(include_url=False), key=lambda finding: finding["type"] != "extra_forbidden")
        raise InputError(" ".join(_sentence(findings[0], data).split())) from None  # a key may hold line breaks
    return build(table, folder)


def _refuse_planned(data: dict[str, Any]) -> None:
    for key, topic in PLANNED.items():
        here: Any = data
        for entry in key.split("."):
            here = here.get(entry) if isinstance(here, dict) else None
        if here is not None:
            raise InputError(f"{key} ({topic}) is not available in this version")
    controllers = data.get("controller")
    for i, settings in enumerate(controllers if isinstance(controllers, list) else [], start=1):
        if not isinstance(settings, dict):
            continue
        if settings.get("scheme") in PLANNED_SCHEMES:
            raise InputError(f"controller {i}: the scheme {settings['scheme']!r} is not available in this version")


def _sentence(error: Any, data: dict[str, Any]) -> str:
    """pydantic's first finding as one sentence that names the field, the value and what would be right."""
    place = _place(error["loc"], data)
    kind, given = error["type"], show(error.get("input"))
    if kind == "missing":
        return f"{place} is missing"
    if kind == "extra_forbidden":
        known = _known_keys(error["loc"])
        near = difflib.get_close_matches(str(error["loc"][-1]), known, n=1, cutoff=0.4)
        hint = f"did you mean {near[0]!r}?" if near else f"known here: {', '.join(known)}"
        return f"unknown key {place}; {hint}"
    if kind == "union_tag_not_found":
        return f"{place}.{error['ctx']['discriminator'].strip(chr(39))} is missing"
    if kind == "union_tag_invalid":
        key, got = error["ctx"]["discriminator"].strip("'"), error["ctx"]["tag"]
        known = [name.strip(" '") for name in error["ctx"]["expected_tags"].split(",")]
        near = difflib.get_close_matches(got, known, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        return f"{place}.{key} must be one of {', '.join(known)}, got {got!r}{hint}"
    message = error["msg"].removeprefix("Input ")
    return f"{place} {message[0].lower()}{message[1:]}, got {given}"


def _place(location: tuple[int | str, ...], data: Any) -> str:
    """The dotted name of a place, without the tags that pydantic puts between for a kind or a scheme."""
    parts: list[str] = []
    here = data
    location = tuple(key for key in location if key not in SHAPES)
    for position, key in enumerate(location):
        is_last = position == len(location) - 1
        if isinstance(here, dict) and (key in here or is_last):
            parts.append(str(key) if str(key).isprintable() else repr(key))  # a key in quotes may hold anything
            here = here.get(key)
        elif isinstance(here, list) and isinstance(key, int):
            parts[-1] += f" {key + 1}"
            here = here[key] if key < len(here) else None
    return ".".join(parts)


def _known_keys(location: tuple[int | str, ...]) -> list[str]:
    """The keys of the table in which ``location`` found an unknown one."""
    table = next((key for key in reversed(location[:-1]) if isinstance(key, str) and key not in SHAPES), None)
    return list(schema.TABLES[table].model_fields)
