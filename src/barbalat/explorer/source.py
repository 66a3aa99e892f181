"""The source of the case of an explorer, from which the case is also written out again: the text of a case file, or Python
objects."""

from __future__ import annotations

import json
import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from typing import Any

from barbalat.cases.build import Case
from barbalat.cases.load import CaseText
from barbalat.open_numbers import truth_paths
from barbalat.open_numbers.numbers import in_case, in_tables
from barbalat.open_numbers.path import FieldPath
from barbalat.open_numbers.varied import VariedCase, VariedObjects
from barbalat.validate import InputError

Segment = str | dict[str, Any]
"""A part of a copied text: fixed text, or a value that the page inserts (a number, a controller's projection, the solver)."""
COPY_NOTE = "# copied from a page of barbalat explore; with fused = false the results are bit-identical to those of the page"
OWN_NOTE = "# some controllers of the page are in a separate file: --controllers"


class Source(ABC):
    """A case that can be built with different numbers, always without fused multiply-adds."""

    @abstractmethod
    def numbers(self) -> Iterator[tuple[FieldPath, float]]:
        """Yield every number and its location."""

    @abstractmethod
    def at(self, numbers: Mapping[FieldPath, float], toggled: Sequence[int] = ()) -> Case:
        """Return the case with different numbers and with the projection of some controllers switched. Raises InputError if the
        case is not valid."""

    @abstractmethod
    def projected(self, i: int) -> bool:
        """Whether the i-th controller's projection is on in the case, explicitly or by default."""

    @property
    def own_file(self) -> str | None:
        """The name of the user's file whose controllers join the case. It has no folder, because pages are sent to others."""
        return None

    @abstractmethod
    def case_file(self, slots: Sequence[FieldPath], switched: Sequence[int]) -> list[Segment] | None:
        """Return the text of a case file with placeholders for these numbers and switches; None if the case has no file."""


@dataclass(frozen=True, eq=False)
class TextSource(Source):
    """The text of a case file. Controllers from the user's file follow those of the text and have no numbers in it."""

    text: CaseText

    @cached_property
    def _read(self) -> dict[str, Any]:
        return self.text.data()

    @cached_property
    def _in_tables(self) -> int:
        """The number of controllers in the text."""
        return len(self._read.get("controller", []))

    @property
    def own_file(self) -> str | None:
        return None if self.text.own is None else self.text.own.path.name

    def _tables(self) -> dict[str, Any]:
        tables = truth_paths.with_own_input(self._read)
        simulation = tables.get("simulation")
        if isinstance(simulation, dict):
            simulation["fused"] = False
        return tables

    def numbers(self) -> Iterator[tuple[FieldPath, float]]:
        return in_tables(self._tables())

    def at(self, numbers: Mapping[FieldPath, float], toggled: Sequence[int] = ()) -> Case:
        key = tuple(toggled)
        if key not in self._varied:
            tables = self._tables()
            for i in toggled:
                if i >= self._in_tables:
                    raise InputError("a controller from a user's file has no projection that can be switched on or off")
                tables["controller"][i]["projection"] = not self.projected(i)
            self._varied[key] = VariedCase(self.text, (), tables)
        return self._varied[key].with_numbers(numbers)

    @cached_property
    def _varied(self) -> dict[tuple[int, ...], VariedCase]:
        """The cases, by the controllers whose projection is switched."""
        return {}

    def projected(self, i: int) -> bool:
        return i < self._in_tables and bool(self._read["controller"][i].get("projection", True))

    def case_file(self, slots: Sequence[FieldPath], switched: Sequence[int]) -> list[Segment]:
        tables, marks = self._tables(), list[dict[str, Any]]()
        own = truth_paths.own_keys(tables)

        def mark(segment: dict[str, Any]) -> str:
            marks.append(segment)
            return f"\0{len(marks) - 1}\0"

        for i, path in enumerate(slots):
            place = truth_paths.place(tables, path, redesign=None, own=own)
            here: Any = tables
            for key in place.keys[:-1]:
                here = here[key] if isinstance(key, int) else here.setdefault(key, {})
            here[place.keys[-1]] = mark({"number": i})
        for i in switched:
            tables["controller"][i]["projection"] = mark({"projection": i})
        tables["simulation"]["solver"] = mark({"solver": True})
        note = COPY_NOTE if self.own_file is None else f"{COPY_NOTE}\n{OWN_NOTE} {self.own_file}"
        parts = re.split(r'"\\u0000(\d+)\\u0000"', f"{note}\n{toml(tables)}")
        return [part if k % 2 == 0 else marks[int(part)] for k, part in enumerate(parts)]


def toml(tables: Mapping[str, Any]) -> str:
    """Write tables as TOML, with a section for each table of the root and with inner tables inline."""
    lines = [f"{_key(key)} = {_value(value)}" for key, value in tables.items() if not _is_section(value)]
    for key, value in tables.items():
        if _is_section(value):
            many = isinstance(value, list)
            for one in value if many else [value]:
                lines += ["", f"[[{_key(key)}]]" if many else f"[{_key(key)}]"]
                lines += [f"{_key(name)} = {_value(inner)}" for name, inner in one.items()]
    return "\n".join(lines) + "\n"


def _is_section(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and bool(value) and isinstance(value[0], dict))


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name)


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_key(name)} = {_value(inner)}" for name, inner in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_value, value)) + "]"
    if isinstance(value, str):
        return json.dumps(value).replace("\x7f", "\\u007f")  # TOML also reads JSON's escapes
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value)  # inf and nan are spelled as in TOML


@dataclass(frozen=True, eq=False)
class ObjectSource(Source):
    """A problem, controllers and a simulation."""

    case: Case

    def numbers(self) -> Iterator[tuple[FieldPath, float]]:
        return in_case(self.case)

    def at(self, numbers: Mapping[FieldPath, float], toggled: Sequence[int] = ()) -> Case:
        return VariedObjects(self._switched(tuple(toggled)), tuple(numbers)).at(list(numbers.values()))

    def _switched(self, toggled: tuple[int, ...]) -> Case:
        if toggled not in self._cases:
            simulation, controllers = replace(self.case.simulation, fused=False), list(self.case.controllers)
            for i in toggled:
                controllers[i] = _switched(controllers[i], not self.projected(i))
            self._cases[toggled] = Case(self.case.problem, tuple(controllers), simulation)
        return self._cases[toggled]

    @cached_property
    def _cases(self) -> dict[tuple[int, ...], Case]:
        """The cases, by the controllers whose projection is switched."""
        return {}

    def projected(self, i: int) -> bool:
        controller: Any = self.case.controllers[i]
        return "projection" in vars(controller) and controller.projection is not False

    def case_file(self, slots: Sequence[FieldPath], switched: Sequence[int]) -> None:
        return None


def _switched(controller: Any, projection: bool) -> Any:
    if not is_dataclass(controller) or "projection" not in {one.name for one in fields(controller)}:
        raise InputError(f"{validate_name(controller)} has no projection that can be switched on or off")
    return replace(controller, projection=projection)  # type: ignore[type-var]


def validate_name(controller: Any) -> str:
    """Return the name of any object, for a message."""
    return type(controller).__name__
