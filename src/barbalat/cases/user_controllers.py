"""Controllers from outside the package: a file that the user names, and installed packages that declare them.

No part of a case file is executed. A Python file is executed if the user gives it (``--controllers``); an installed package's
class is imported if a case names it and the package has registered it in the entry-point group ``barbalat.controllers``.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterable, Mapping, Set
from dataclasses import dataclass, fields, is_dataclass, replace
from difflib import get_close_matches
from importlib.machinery import SourceFileLoader
from importlib.metadata import entry_points
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from types import ModuleType
from typing import Any

from barbalat import budget
from barbalat.budget import Estimate
from barbalat.cases.schema import table_of
from barbalat.loop.user_errors import Subject, telling_user_errors
from barbalat.protocols import Controller
from barbalat.validate import InputError, local_path, show

ENTRY_POINT_GROUP = "barbalat.controllers"
"""The group of entry points: scheme = "package:Class"."""
LIST_NAME = "CONTROLLERS"
"""The name of the list of controllers in a file."""
SOURCE_BYTE = Estimate(memory=200.0, seconds=2e-6)
"""Cost of each byte of a Python file to compile; the run of the file has no limit."""


@dataclass(frozen=True, eq=False)
class OwnFile:
    """A user's file after its execution.

    kept  the indices of its controllers that join a case; None for all
    """

    path: Path
    module: ModuleType
    kept: tuple[int, ...] | None = None

    def alone(self, i: int) -> OwnFile:
        """Return the file in a form in which only its i-th controller joins a case, or none if i is negative."""
        return replace(self, kept=(i,) if i >= 0 else ())

    @property
    def classes(self) -> dict[str, type]:
        """The controller classes that the file defines, keyed by name."""
        found = {name: kind for name, kind in vars(self.module).items() if isinstance(kind, type) and "bind" in dir(kind)}
        return {name: kind for name, kind in found.items() if kind.__module__ == self.module.__name__}

    def controllers(self, named: Mapping[str, type]) -> tuple[Controller, ...]:
        """Return the controllers that join a case: the list, or all controllers made at module level; ``named`` are classes in
        the case.

        If there are none and the case names none, return instances of the classes that need no settings.
        """
        if self.kept is None:
            return self._all(named)
        found = self._all(named) if self.kept else ()
        return tuple(found[i] for i in self.kept)

    def _all(self, named: Mapping[str, type]) -> tuple[Controller, ...]:
        have = vars(self.module)
        if LIST_NAME in have:
            return self._listed(have[LIST_NAME])
        made = {id(part): part for part in have.values() if isinstance(part, Controller) and not isinstance(part, type)}
        if made or named:
            return tuple(made.values())
        found = tuple(self._made(kind) for kind in self.classes.values() if _needs_nothing(kind))
        if not found:
            known = f', or name one of its classes in the case file: scheme = "{min(self.classes)}"' if self.classes else ""
            raise InputError(f"{str(self.path)!r} contains no controllers: add a list {LIST_NAME} = [MyLaw(...), ...]{known}")
        return found

    def _listed(self, given: Any) -> tuple[Controller, ...]:
        if not isinstance(given, (list, tuple)) or not given:
            raise InputError(f"{LIST_NAME} in {str(self.path)!r} must be a list of controllers, got {show(given)}")
        return tuple(self._made(one) if isinstance(one, type) else one for one in given)

    def _made(self, kind: type) -> Controller:
        with telling_user_errors(Subject(f"{kind.__name__}() in {str(self.path)!r}")):
            controller: Controller = kind()
        return controller


def _needs_nothing(kind: type) -> bool:
    try:
        inspect.signature(kind).bind()
    except TypeError:
        return False
    return True


def run(path: str | Path) -> OwnFile:
    """Execute a Python file; raises InputError if it can't be read or, with the line, if its code fails."""
    path = local_path("--controllers", path)
    if not path.is_file():
        raise InputError(f"--controllers: {str(path)!r} is not a file")
    size = path.stat().st_size
    name = f"--controllers: {str(path)!r}"
    budget.require(name, size, SOURCE_BYTE.times, given=f"has {size} bytes and", fits=lambda n: f"at most {n} bytes")
    name = f"controllers_in_{path.stem}"  # a separate module name, not that of an installed module
    loader = SourceFileLoader(name, str(path))
    spec = spec_from_loader(name, loader)
    assert spec is not None
    module = sys.modules[name] = module_from_spec(spec)
    folder = str(path.resolve().parent)
    sys.path.append(folder)  # for files in the same folder; last, so that they replace no installed package
    try:
        with telling_user_errors(Subject(f"--controllers: {str(path)!r}")):
            loader.exec_module(module)
    finally:
        sys.path.remove(folder)
    return OwnFile(path, module)


def named_in(case: Mapping[str, Any]) -> set[str]:
    """The schemes that a case file names, before anything in it is checked."""
    tables = case.get("controller")
    given = [table.get("scheme") for table in tables if isinstance(table, dict)] if isinstance(tables, list) else []
    return {name for name in given if isinstance(name, str)}


def schemes(names: Set[str], own: OwnFile | None) -> dict[str, type]:
    """The settings classes of schemes from outside the package: from the user's file or from an installed package."""
    found = {} if own is None else {name: kind for name, kind in own.classes.items() if name in names}
    for name in sorted(names - found.keys()):
        for entry in entry_points(group=ENTRY_POINT_GROUP, name=name):
            with telling_user_errors(Subject(f"the scheme {name!r} of {entry.value!r}")):
                found[name] = entry.load()
    for name, kind in found.items():
        _require_settings(name, kind)
    return found


def require_spelling(unknown: Set[str], own: OwnFile, known: Iterable[str]) -> None:
    """Raise InputError for a scheme whose spelling is close to a class of the user's file, and to no other known scheme."""
    for name in sorted(unknown):
        near = get_close_matches(name, own.classes, n=1)
        if near and not get_close_matches(name.lower(), known, n=1):
            raise InputError(f"scheme {name!r} is not a class of {str(own.path)!r}; did you mean {near[0]!r}?")


def _require_settings(name: str, kind: Any) -> None:
    """Raise InputError for a class that a table of a case file cannot make."""
    if not (isinstance(kind, type) and is_dataclass(kind) and "name" in {field.name for field in fields(kind)}):
        raise InputError(
            f"the scheme {name!r} must be a dataclass with a field called name, so that a case file can give its settings, got "
            f"{show(kind)}"
        )
    try:
        table_of(kind, "scheme", name)
    except (TypeError, NameError) as error:
        raise InputError(
            f"the scheme {name!r}: its fields must be float, int, bool, str, or Vector and Matrix of barbalat.validate, so that "
            f"a case file can give them; {error}"
        ) from None
