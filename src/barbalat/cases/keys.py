"""The keys of a case file's tables: the fields of the settings that are built from the tables, and the exceptions."""

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
"""Represents a missing default."""

Given = dict[str, Any]
"""The values of the keys of one table, with tables already built; missing keys are absent."""


class Key(NamedTuple):
    """One key of a table."""

    type: Any  # the type as a field of settings would declare it
    meaning: str
    default: Any = REQUIRED  # None if the default of the settings is not a plain value
    alias: str | None = None  # an accepted alternative spelling


class Context(NamedTuple):
    """What building a table needs in addition to the table itself."""

    folder: Path  # the base of relative paths
    known: Any = None  # the known part of the problem, for controllers
    others: Callable[[type], dict[str, Callable[[], Any]]] = lambda _: {}
    """The case's controllers of a class, by name, each with its builder."""
    objects: Mapping[int, tuple[Any, Any]] = MappingProxyType({})
    """The objects already built, with their tables, by the ids of the tables; new objects are added to the dictionary."""
    raw: dict[str, Any] | None = None  # tables of the file, if they contain formulas of parameters
    judge: Any = None  # judge of the case, for the scales of states
    t_end: float = 0.0  # [s]


Make = Callable[[Given, Context], Any]
"""Makes the object of a table from the given values."""


@dataclass(frozen=True, kw_only=True)
class Differences:
    """The differences between the keys that make an object and the fields of its class.

    keys       keys that are not fields, or have a different type than the field
    required   fields that have a default in Python but must be given here; ``optional`` is the opposite
    without    fields that have no key
    make       makes the object from the given values; by default, the class is called with the values as keyword arguments
    """

    keys: Mapping[str, Key] = field(default_factory=dict)
    required: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    make: Make | None = None


@cache  # a sweep makes thousands of cases from one file
def _types_of(settings: type) -> dict[str, Any]:
    """The types of the fields only, because other annotations of the class may use names that are imported only for type
    checkers."""
    names = {one.name for one in fields(settings)}
    found: dict[str, Any] = {}
    for kind in reversed(settings.__mro__):  # the type of a field is resolved in the module of the class that declares it
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
    """The meanings of fields, from the docstrings of a class and its bases: name -> meaning."""
    found: dict[str, str] = {}
    for kind in reversed(settings.__mro__):
        found |= _meanings_in(kind.__doc__ or "")
    return found


def summary(settings: type) -> str:
    """The first paragraph of a docstring, which says what a kind, a law or a scheme is."""
    return inspect.cleandoc(settings.__doc__ or "").split("\n\n")[0]


def _meanings_in(docstring: str) -> dict[str, str]:
    """A docstring's lines "name  A docstring's lines "name :: meaning", with their indented continuations."""
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
