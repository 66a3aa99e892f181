"""Plug-ins of the program: built-in ones are found by their folder, others by an entry point."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module, metadata
from pkgutil import iter_modules
from types import ModuleType

from barbalat.validate import InputError


def slices(home: str, group: str, module: str) -> Iterator[ModuleType]:
    """Yield the modules with this name from all packages inside ``home``, then from all packages that entry points of ``group``
    name.

    A distribution adds a plug-in with ``[project.entry-points."GROUP"]`` and ``name = "package"`` in its pyproject.toml. Raises
    InputError if an entry point can't be imported; the message names the distribution that declares it.
    """
    for package in packages_in(import_module(home)):
        yield import_module(f"{package}.{module}")
    for entry in sorted(metadata.entry_points(group=group), key=lambda one: one.name):
        try:
            yield import_module(f"{entry.value}.{module}")
        except ImportError as error:
            by = "" if entry.dist is None else f" of {entry.dist.name} {entry.dist.version}"
            raise InputError(
                f"the entry point {entry.name!r}{by} in the group {group} names {entry.value!r}, from which {module!r} can't be "
                f"imported: {error}"
            ) from error


def packages_in(package: ModuleType) -> list[str]:
    """The full names of the packages inside a package, in alphabetical order."""
    return sorted(f"{package.__name__}.{one.name}" for one in iter_modules(package.__path__) if one.ispkg)


def modules_in(package: str) -> list[ModuleType]:
    """Import and return all modules in a package's own folder, in alphabetical order."""
    found = import_module(package)
    return [
        import_module(name) for name in sorted(f"{package}.{one.name}" for one in iter_modules(found.__path__) if not one.ispkg)
    ]
