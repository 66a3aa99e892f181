"""The keys of a table of a case file: the fields of the settings that it makes, and where it differs from them."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, field, fields
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, get_type_hints

REQUIRED = MISSING
"""Stands for a default where there is none."""

Given = dict[str, Any]
"""What the keys of one table say, tables among them already built; keys that were not given are absent."""


class Key(NamedTuple):
    """One key of a table."""

    type: Any  # as a field of settings would have it
    meaning: str
    default: Any = REQUIRED  # None where the settings' own default is no plain value
    alias: str | None = None  # a second spelling that is understood


class Context(NamedTuple):
    """What building a table needs beside the table itself."""

    folder: Path  # where relative paths start
    known: Any = None  # the problem's known part, for controllers
    others: Callable[[type], dict[str, Callable[[], Any]]] = lambda _: {}
    """The case's controllers of a class, by name, each with what makes it."""
    objects: Mapping[int, tuple[Any, Any]] = MappingProxyType({})
    """What tables were made into before, with the tables, by their identity; a dictionary takes further ones."""
    raw: dict[str, Any] | None = None  # the file's tables, where formulas of parameters stand in them
    judge: Any = None  # the case's, for the scales of states
    t_end: float = 0.0  # [s]


Make = Callable[[Given, Context], Any]
"""Makes a table's object from what was given."""


@dataclass(frozen=True, kw_only=True)
class Differences:
    """How the keys that make an object differ from the fields of its class.

    keys       those that are no fields, or not of the field's type
    required   fields that have a default in Python but must be given here; ``optional`` the other way round
    without    fields that no key gives
    make       the object from what was given; by default the class with that as keyword arguments
    """

    keys: Mapping[str, Key] = field(default_factory=dict)
    required: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    make: Make | None = None


@cache  # a sweep makes thousands of cases of one file
def _types_of(settings: type) -> dict[str, Any]:
    """The fields' types; what a class says of itself beside its fields may name types that are imported for checkers only."""
    names = {one.name for one in fields(settings)}
    found: dict[str, Any] = {}
    for kind in reversed(settings.__mro__):  # a field's type is named in the module of the class that has it
        own = {name: given for name, given in vars(kind).get("__annotations__", {}).items() if name in names}
        found |= get_type_hints(
            type(kind.__name__, (), {"__annotations__": own, "__module__": kind.__module__}), include_extras=True
        )
    return found


def keys_of(settings: type, differences: Differences) -> dict[str, Key]:
    """The keys from which an object of a class is made: name -> Key."""
    types, meanings = _types_of(settings), meanings_of(settings)
    found: dict[str, Key] = {}
    for one in fields(settings):
        if not one.init or one.name in differences.without:
            continue
        default = None if one.default_factory is not MISSING else one.default
        found[one.name] = Key(types[one.name], meanings.get(one.name, ""), default)
    found |= {name: found[name]._replace(default=REQUIRED) for name in differences.required}
    found |= {name: found[name]._replace(default=None) for name in differences.optional}
    return found | dict(differences.keys)


@cache
def meanings_of(settings: type) -> dict[str, str]:
    """What the docstrings of a class, and of those it is made from, say of its fields: name -> meaning."""
    found: dict[str, str] = {}
    for kind in reversed(settings.__mro__):
        found |= _meanings_in(kind.__doc__ or "")
    return found


def summary(settings: type) -> str:
    """The first paragraph of a docstring: what a kind, a law or a scheme is."""
    return inspect.cleandoc(settings.__doc__ or "").split("\n\n")[0]


def _meanings_in(docstring: str) -> dict[str, str]:
    """A docstring's lines "name  meaning", with their continuations further in."""
    found: dict[str, str] = {}
    names: list[str] = []
    for line in inspect.cleandoc(docstring).splitlines():
        row = re.match(r"(\w+(?:, \w+)*) {2,}(\S.*)$", line)
        if row:
            names = row[1].split(", ")
            found |= dict.fromkeys(names, row[2])
        elif line.startswith("    "):
            found |= {name: f"{found[name]} {line.strip()}" for name in names}
        else:
            names = []
    return found
