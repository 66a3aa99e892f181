"""Reading a case: a path or a bundled name in, a validated Case out, or one clear sentence."""

from __future__ import annotations

import difflib
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from barbalat.cases import schema
from barbalat.cases.build import build
from barbalat.cases.output_build import build_output
from barbalat.cases.output_tables import TABLES as OUTPUT_TABLES
from barbalat.cases.output_tables import OutputCaseTable
from barbalat.cases.parts import Case
from barbalat.cases.tables import SHAPES
from barbalat.validate import InputError, show


def bundled() -> dict[str, Path]:
    """The bundled cases: name -> file."""
    folder = Path(str(resources.files("barbalat.cases.bundled")))
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


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
    kind = OutputCaseTable if _feeds_back_the_output(data) else schema.CaseTable
    try:
        table = kind.model_validate(data)
    except ValidationError as error:
        # a misspelt key is also a missing one: speak of the spelling
        findings = sorted(error.errors(include_url=False), key=lambda finding: finding["type"] != "extra_forbidden")
        raise InputError(" ".join(_sentence(findings[0], data).split())) from None  # a key may hold line breaks
    return build_output(table, folder) if isinstance(table, OutputCaseTable) else build(table, folder)


def _feeds_back_the_output(data: dict[str, Any]) -> bool:
    plant = data.get("plant")
    return isinstance(plant, dict) and "transfer_function" in plant


def _sentence(error: Any, data: dict[str, Any]) -> str:
    """pydantic's first finding as one sentence that names the field, the value and what would be right."""
    place = _place(error["loc"], data)
    kind, given = error["type"], show(error.get("input"))
    if kind == "missing":
        return f"{place} is missing"
    if kind == "extra_forbidden":
        known = _known_keys(error["loc"], data)
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


def _known_keys(location: tuple[int | str, ...], data: dict[str, Any]) -> list[str]:
    """The keys of the table in which ``location`` found an unknown one."""
    table = next((key for key in reversed(location[:-1]) if isinstance(key, str) and key not in SHAPES), None)
    tables = schema.TABLES | OUTPUT_TABLES if _feeds_back_the_output(data) else schema.TABLES
    return list(tables[table].model_fields)
