"""What pydantic finds, as one sentence that names the field, the value and what would be right."""

from __future__ import annotations

import difflib
import re
from typing import Any

from pydantic import ValidationError

from barbalat.cases.tables import TAGS
from barbalat.validate import show

_ORDER = {"unknown_key": 0, "extra_forbidden": 2}
"""A misspelt key is also a missing one: speak of the spelling. A key that means nothing here comes after one that is missing."""


def sentence(error: ValidationError, data: dict[str, Any]) -> str:
    """The finding that helps most."""
    findings = sorted(error.errors(include_url=False), key=lambda finding: _ORDER.get(finding["type"], 1))
    return " ".join(_sentence(findings[0], data).split())  # a key may hold line breaks


def _sentence(finding: Any, data: dict[str, Any]) -> str:
    kind, location, context = finding["type"], finding["loc"], finding.get("ctx", {})
    match kind:
        case "missing":
            return f"{_place(location, data)} is missing"
        case "unknown_key":
            near = difflib.get_close_matches(context["key"], context["known"], n=1, cutoff=0.4)
            hint = f"did you mean {near[0]!r}?" if near else _known(context)
            return f"unknown key {_place((*location, context['key']), data)}; {hint}"
        case "meaningless_key":
            place = _place((*location, context["key"]), data)
            return f"{place} has no meaning for {context['choice']}; {_known(context)}"
        case "union_tag_not_found":
            return f"{_place(location, data)}.{context['discriminator'].strip(chr(39))} is missing"
        case "union_tag_invalid":
            place = f"{_place(location, data)}.{context['discriminator'].strip(chr(39))}"
            return _one_of(place, context["expected_tags"], context["tag"])
        case "model_type" | "model_attributes_type":
            return f"{_place(location, data)} must be a table, got {show(finding['input'])}"
        case "literal_error" if isinstance(finding["input"], str):
            return _one_of(_place(location, data), context["expected"], finding["input"])
    message = finding["msg"].removeprefix("Input ")
    return f"{_place(location, data)} {message[0].lower()}{message[1:]}, got {show(finding.get('input'))}"


def _known(context: dict[str, Any]) -> str:
    return f"known here: {', '.join(context['known'])}"


def _one_of(place: str, expected: str, given: str) -> str:
    """``expected`` as pydantic writes it: every name in quotes."""
    known = re.findall("'([^']*)'", expected)
    near = difflib.get_close_matches(given, known, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"{place} must be one of {', '.join(known)}, got {show(given)}{hint}"


def _place(location: tuple[int | str, ...], data: Any) -> str:
    """The dotted name of a place, without the tags that pydantic puts between for a kind or a scheme."""
    parts: list[str] = []
    here = data
    location = tuple(key for key in location if key not in TAGS)
    for position, key in enumerate(location):
        is_last = position == len(location) - 1
        if isinstance(here, dict) and (key in here or is_last):
            parts.append(str(key) if str(key).isprintable() else repr(key))  # a key in quotes may hold anything
            here = here.get(key)
        elif isinstance(here, list) and isinstance(key, int):
            parts[-1] += f" {key + 1}"
            here = here[key] if key < len(here) else None
    return ".".join(parts)
