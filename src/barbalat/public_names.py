"""Public modules: each offers the names in its stub (``.pyi``) and imports a name when it is first used.

A stub is the only list of a module's names; it serves type checkers, ``dir``, ``__all__`` and the reference. Each of its lines is
one import: ``from .adaptation.laws.gradient import Gradient as Gradient``, or ``from . import laws as laws`` for a public module.
"""

from __future__ import annotations

import sys
from importlib import import_module
from os.path import dirname, isfile, join

TYPE_CHECKING = False  # typing and pathlib take longer to import than all of this
if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType
    from typing import Any

PACKAGE = "barbalat"


def public(module: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` for the public module with this ``__name__``."""
    places = places_of(module)
    names = sorted(places)

    def first_use(name: str) -> Any:
        if name not in places:
            raise _absent(sys._getframe(1))(_told(module, name), name=name)
        found = import_module(places[name])
        value = found if name in modules() and module == PACKAGE else getattr(found, name)
        vars(sys.modules[module])[name] = value
        return value

    return first_use, lambda: list(names), names


def modules() -> list[str]:
    """The names of the package's public modules, relative to the package."""
    return [name for name, place in places_of(PACKAGE).items() if place == f"{PACKAGE}.{name}"]


def places_of(module: str) -> dict[str, str]:
    """The names of a public module, each with the module from which it is imported; empty without a stub."""
    stem = join(dirname(__file__), *module.split(".")[1:])
    stub = next((file for file in (f"{stem}.pyi", join(stem, "__init__.pyi")) if isfile(file)), None)
    if stub is None:
        return {}
    package = module if stub.endswith("__init__.pyi") else module.rpartition(".")[0]
    with open(stub, encoding="utf-8") as text:
        lines = [line.split() for line in text if line.startswith("from ")]
    return {name: _absolute(place, name, package) for _, place, _, name, *_ in lines}


def _absolute(place: str, name: str, package: str) -> str:
    """The absolute module from which a line of a stub imports; ``from . import laws`` imports the module itself."""
    if place == ".":
        return f"{package}.{name}"
    inner = place.lstrip(".")
    outer = package.split(".")
    return ".".join([*outer[: len(outer) + 1 - (len(place) - len(inner))], inner])


def _absent(caller: FrameType) -> type[AttributeError | ImportError]:
    """Raise ImportError if the caller executes ``from ... import ...``, because Python would replace the text of an
    AttributeError."""
    from opcode import opmap

    return ImportError if caller.f_code.co_code[caller.f_lasti] == opmap["IMPORT_FROM"] else AttributeError


def _told(module: str, name: str) -> str:
    """The message for a name that a module lacks: where the name is, or which name is probably meant.

    Names that begin with an underscore get no suggestion: Python asks for ``__path__`` at every ``from``, and tools ask for
    others.
    """
    if name.startswith("_"):
        return f"{module} has no {name}"
    from barbalat.validate import nearest

    homes = {one: home for home in (PACKAGE, *(f"{PACKAGE}.{inner}" for inner in modules())) for one in places_of(home)}
    if name in homes:
        return f"{module} has no {name}: it is in {homes[name]}"
    meant = nearest(name, places_of(module)) or nearest(name, homes)
    return f"{module} has no {name}" + ("" if meant is None else f"; did you mean {homes[meant]}.{meant}?")
