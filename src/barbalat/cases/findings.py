"""Turns Pydantic's findings in a case file into sentences, each with the field, the value as typed, and what would be correct."""

from __future__ import annotations

import difflib
import json
import re
import sys
from collections.abc import Iterable, Iterator
from typing import Any, get_args

from pydantic import ValidationError

from barbalat.cases.table_models import TAGS, Table
from barbalat.validate import MOST_LISTED, InputError

SHOWN_AT_ONCE = 3
"""Largest number of findings reported together: correcting these often corrects others."""
MISSPELT_KEYS = 20
"""Depth of nesting up to which findings are searched."""
LONGEST_MESSAGE = 540
"""Largest number of characters of all findings reported together: 600 with the text around them."""
LONGEST_SENTENCE = 400
"""Largest number of characters of one finding."""
LONGEST_VALUE = 60
"""Characters of a value in a message."""
MOST_BITS = 14_000
"""Largest number of bits of an integer shown in decimal: Python writes at most 4300 digits, and 0xff... may have more."""
DEEPEST_VALUE = 4
"""Depth to which the nested tables or lists of a value are shown."""
BEYOND_RANGE = f"is beyond the range of floating-point numbers, {sys.float_info.max:.2g}"
BARE_KEY = re.compile(r"[\w-]+")
"""A key that is written without quotes, or that could be if its script were ASCII."""
SYMMETRIC_LIMITS = ("saturation",)
"""Keys whose value is a pair of limits, for which a single number may give both."""

KEYS_OF_ONE_NUMBER = {"filter": "kappa"}
"""Tables for which a single number may be given, with the key of that number."""

_ORDER = {"unknown_key": 0}
"""The order of findings. A misspelt key is also a missing key; its spelling is reported first."""


class Typed(str):
    """A number of a case file as it was typed."""

    __slots__ = ()


def several(found: Iterable[str]) -> InputError:
    """One error with the first few findings, and the number of the others."""
    different = [one if len(one) <= LONGEST_SENTENCE else f"{one[: LONGEST_SENTENCE - 3]}..." for one in dict.fromkeys(found)]
    told = different[:SHOWN_AT_ONCE]
    while sum(map(len, told)) > LONGEST_MESSAGE:
        told.pop()
    more = len(different) - len(told)
    return InputError(*told, *([f"and {more} more"] if more else []))


def findings(root: type[Table], data: dict[str, Any], as_typed: dict[str, Any]) -> list[str]:
    """The reasons why ``data``, which is modified, is not a table of ``root``: one sentence each, misspelt keys first.

    as_typed  the same data, with the numbers as they were typed
    """
    told: list[str] = []
    for _ in range(MISSPELT_KEYS):  # a table is examined only if its keys are known: correct misspelt keys and check again
        try:
            root.model_validate(data)
        except ValidationError as error:
            found = sorted(
                error.errors(include_url=False), key=lambda one: (_ORDER.get(one["type"], 1), _position(one["loc"], data))
            )
            unknown = [finding for finding in found if finding["type"] == "unknown_key"]
            # a key may contain line breaks
            told += [" ".join(_sentence(one, as_typed, root).split()) for one in unknown or found]
            for finding in unknown:
                place = _place((*finding["loc"], finding["ctx"]["key"]), as_typed)
                for tree in (data, as_typed):
                    _put_right(_value(finding["loc"], tree), finding["ctx"], _further_in(finding["ctx"], place, root))
            if unknown:
                continue
        break
    return told


def _put_right(table: dict[str, Any], context: dict[str, Any], further_in: list[str]) -> None:
    """Move the value of an unknown key to the intended place; remove it if there is no such place or the place is taken."""
    value = table.pop(context["key"])
    *outer, last = further_in[0].split(".") if further_in else _near(context) or [""]
    for key in outer:
        table = table.setdefault(key, {}) if isinstance(table, dict) else {}  # type: ignore[redundant-expr]
    if last and isinstance(table, dict):
        table.setdefault(last, value)


def _sentence(finding: Any, data: dict[str, Any], root: type[Table]) -> str:
    kind, location, context = finding["type"], finding["loc"], finding.get("ctx", {})
    given = _value(location, data)
    match kind:
        case "missing":
            return f"{_place(location, data)} is missing"
        case "unknown_key":
            place = _place((*location, context["key"]), data)
            return f"unknown key {place}; {_meant(context, place, root)}"
        case "meaningless_key":
            place = _place((*location, context["key"]), data)
            missing = "".join(f"; {_place((*location, one), data)} is missing" for one in context["missing"])
            return f"{place} has no meaning for {context['choice']}{missing}; {_known(context)}"
        case "union_tag_not_found":
            return _choice_missing(_place(location, data), context["discriminator"].strip("'"), given)
        case "union_tag_invalid":
            key = context["discriminator"].strip("'")
            otherwise = "; give your own class with --controllers FILE.py" if key == "scheme" else ""
            return _one_of(f"{_place(location, data)}.{key}", context["expected_tags"], context["tag"], otherwise)
        case "model_attributes_type" if isinstance(given, str) and not isinstance(given, Typed):
            return f"{_place(location, data)} must be a table: write {location[-1]} = {{ kind = {typed(given)} }}"
        case "model_type" | "model_attributes_type" if location[-1] in KEYS_OF_ONE_NUMBER and isinstance(given, (int, Typed)):
            meant = f"{location[-1]} = {{ {KEYS_OF_ONE_NUMBER[location[-1]]} = {typed(given)} }}"
            return f"{_place(location, data)} must be a table: write {meant}"
        case "model_type" | "model_attributes_type":
            return f"{_place(location, data)} must be a table, got {typed(given)}"
        case "list_type" if isinstance(given, dict):
            place = _place(location, data)
            return f"{place} must be a list of tables: write [[{place}]] instead of [{place}]"
        case "list_type" if isinstance(given, (int, Typed)) and not isinstance(given, bool):
            number = typed(given)
            pair = _place(location, data).split(".")[-1] in SYMMETRIC_LIMITS
            meant = f"[-{number}, {number}]" if pair else f"[{number}]"
            return f"{_place(location, data)} must be a list, such as {meant}, got {number}"
        case "float_type" if isinstance(given, int) and not isinstance(given, bool):
            return f"{_place(location, data)} {BEYOND_RANGE}, got {typed(given)}"
        case "literal_error" if isinstance(given, str):
            return _one_of(_place(location, data), context["expected"], given)
    message = finding["msg"].removeprefix("Input ").removeprefix("String ")
    return f"{_place(location, data)} {message[0].lower()}{message[1:]}, got {typed(given)}"


def _choice_missing(place: str, key: str, given: dict[str, Any]) -> str:
    """Return the finding on a table without its ``kind`` or ``scheme``; the key with the closest spelling may be meant."""
    near = next((one for one in given if difflib.get_close_matches(key, [one.lower()])), None)
    return f"{place}.{key} is missing" if near is None else f"unknown key {place}.{near}; did you mean {key!r}?"


def _known(context: dict[str, Any]) -> str:
    return f"known here: {', '.join(context['known'])}"


def _meant(context: dict[str, Any], place: str, root: type[Table]) -> str:
    """The key with that name in an inner table, or the key with the closest spelling here, or the keys here and places elsewhere
    with that name."""
    start = _start(place)
    here = [*(start + path for path in _further_in(context, place, root)), *_near(context)]
    elsewhere = _named(context["key"], root)
    if here:
        return f"did you mean {here[0]!r}?"
    if elsewhere and (not start or len(context["known"]) > MOST_LISTED):
        return f"did you mean {elsewhere[0]!r}?"
    return f"{_known(context)}; or did you mean {elsewhere[0]!r}?" if elsewhere else _known(context)


def _named(key: str, root: type[Table]) -> list[str]:
    """The paths of all keys with a given name."""
    return [".".join(path) for path in _paths(root) if path[-1] == key]


def _further_in(context: dict[str, Any], place: str, root: type[Table]) -> list[str]:
    """The relative paths of the keys with that name in tables inside the table in which it is unknown."""
    start = _start(place)
    return [path.removeprefix(start) for path in _named(context["key"], root) if path.startswith(start)]


def _start(place: str) -> str:
    """The part of a place before its last name."""
    return place[: place.rfind(".") + 1]


def _near(context: dict[str, Any]) -> list[str]:
    """The known key that an unknown one may mean, if any: a key that is not given and is spelt similarly or begins with the
    unknown one."""
    key, free = context["key"], [one for one in context["known"] if one not in context["given"]]
    if SYNONYMS.get(key) in free:
        return [SYNONYMS[key]]
    return difflib.get_close_matches(key, free, n=1) or [one for one in free if len(key) > 2 and one.startswith(key)][:1]


SYNONYMS = {
    "range": "between",
    "bounds": "between",
    "percentage": "tolerance",
    "plusminus": "tolerance",
    "limit": "saturation",
    "limits": "saturation",
    "dead_time": "delay",
    "resolution": "quantization",
    "initial": "x0",
    "initial_state": "x0",
}
"""Words that other tools use for a key."""


def _paths(table: type[Table], start: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """The names of all keys of a table and of its inner tables, except those that a kind or a scheme selects."""
    for name, field in table.model_fields.items():
        yield (*start, name)
        for inner in _tables_in(field.annotation):
            if not inner.recipe.choice:
                yield from _paths(inner, (*start, name))


def _tables_in(hint: Any) -> Iterator[type[Table]]:
    """The tables that a field may contain."""
    if isinstance(hint, type) and not get_args(hint) and issubclass(hint, Table):
        yield hint
    for part in get_args(hint):
        yield from _tables_in(part)


def _one_of(place: str, expected: str, given: str, otherwise: str = "") -> str:
    """``expected`` as pydantic writes it, with every name in quotes; ``otherwise`` if no name is close."""
    known = re.findall("'([^']*)'", expected)
    near = difflib.get_close_matches(given.lower(), known, n=1) or difflib.get_close_matches(given, known, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else otherwise
    return f"{place} must be one of {', '.join(known)}, got {typed(given)}{hint}"


def typed(value: Any) -> str:
    """A value as TOML writes it, with numbers as they were typed: short, on one line."""
    text = " ".join(_as_toml(value, DEEPEST_VALUE).split())
    return text if len(text) <= LONGEST_VALUE else f"{text[: LONGEST_VALUE - 3]}..."


def _as_toml(value: Any, depth: int) -> str:
    match value:
        case Typed() | int() if not isinstance(value, bool):
            return hex(value) if isinstance(value, int) and value.bit_length() > MOST_BITS else str(value)
        case bool() | str():
            return json.dumps(value)
        case list() | dict() if depth == 0:
            return "..."
        case list():
            return f"[{', '.join(_as_toml(one, depth - 1) for one in value)}]"
        case dict():
            pairs = (f"{key} = {_as_toml(one, depth - 1)}" for key, one in value.items())
            return f"{{ {', '.join(pairs)} }}"
    return str(value)  # a date or a time


def _keys(location: tuple[int | str, ...], data: Any) -> list[int | str]:
    """A place without the tags that pydantic inserts: the name of a form, and the kind or scheme of a table after the table.

    A key of that table may have the same name as the tag, so the tag is looked for only once, right after its table.
    """
    here, entered, found = data, False, list[int | str]()
    for key in location:
        if key in TAGS:
            continue
        if isinstance(here, dict) and entered and key in (here.get("kind"), here.get("scheme")):
            entered = False
            continue
        found.append(key)
        here, entered = _inside(here, key), True
    return found


def _inside(here: Any, key: int | str) -> Any:
    """The value of a key of a table or at an index of a list; None if it does not exist."""
    if isinstance(here, dict):
        return here.get(key)
    return here[key] if isinstance(here, list) and isinstance(key, int) and key < len(here) else None


def _value(location: tuple[int | str, ...], data: Any) -> Any:
    """The value at a place; for a missing key, the table that should contain it."""
    here = data
    for key in _keys(location, data):
        here = here.get(key, here) if isinstance(here, dict) else _inside(here, key) if isinstance(here, list) else here
    return here


def _position(location: tuple[int | str, ...], data: Any) -> list[int]:
    """The position of a place in the file, for comparison with others; a missing key is at the end of its table."""
    found: list[int] = []
    for key in _keys(location, data):
        if isinstance(data, dict):
            found.append(list(data).index(key) if key in data else len(data))
        elif isinstance(data, list) and isinstance(key, int):
            found.append(key)
        data = _inside(data, key)
    return found


def _place(location: tuple[int | str, ...], data: Any) -> str:
    """The dotted name of a place."""
    parts: list[str] = []
    here = data
    for key in _keys(location, data):
        if isinstance(here, dict):
            parts.append(str(key) if BARE_KEY.fullmatch(str(key)) else json.dumps(key))  # a quoted key may contain anything
        elif isinstance(here, list) and isinstance(key, int):
            parts[-1] += f" {key + 1}"
        here = _inside(here, key)
    return ".".join(parts)
