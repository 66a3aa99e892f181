"""Reads a case: a path or the name of a bundled case gives a validated Case, or an error of one clear sentence."""

from __future__ import annotations

import copy
import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from barbalat import budget
from barbalat.budget import Estimate
from barbalat.cases import user_controllers
from barbalat.cases.build import Case, Parts, build
from barbalat.cases.findings import BEYOND_RANGE, Typed, findings, several
from barbalat.cases.physical_tables import with_numbers
from barbalat.cases.schema import CASES, case_table, problem_posed
from barbalat.cases.table_models import Table
from barbalat.cases.typed_numbers import echo
from barbalat.cases.user_controllers import OwnFile
from barbalat.protocols import Controller
from barbalat.reading import contents
from barbalat.validate import InputError, hint, local_path


def bundled() -> dict[str, Path]:
    """The bundled cases: name -> file."""
    folder = Path(str(resources.files("barbalat.cases.bundled")))
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def text_to_start_from(name: str | None = None) -> str:
    """The text of a bundled case, or the commented template."""
    if name is None:
        return (resources.files("barbalat.cases") / "template.toml").read_text("utf-8")
    if name not in bundled():
        raise InputError(f"--from must be one of the bundled cases ({', '.join(bundled())}), got {name!r}{hint(name, bundled())}")
    return bundled()[name].read_text("utf-8")


DECIMAL_COMMA = re.compile(r"^\s*([\w.-]+)\s*=\s*([-+]?\d+),(\d+)\s*(?:#.*)?$", re.MULTILINE)
"""A key whose value is a number with a decimal comma, alone on its line."""
DIGITS = re.compile(r"[0-9_]+")
SINGLE_BRACKETS = re.compile(r"^\s*\[\s*controller\s*\]", re.MULTILINE)
"""The header of a single controller in single brackets. With a second controller this is not valid TOML."""


Keys = tuple[str | int, ...]
"""The place of a number in tables: keys of tables and indices of lists."""


@dataclass(frozen=True, eq=False)
class Variants:
    """Cases that differ from a first case in some numbers. Parts that do not depend on these numbers are neither checked nor
    built again."""

    table: Table
    folder: Path
    joining: tuple[Controller, ...]
    parts: Parts
    with_formulas: bool = False

    def at(self, numbers: Mapping[Keys, float]) -> Case | None:
        """The case with these numbers, checked like any other; None if one of them is not a plain number in the first case."""
        if self.with_formulas:  # numbers follow from formulas, so the tables are evaluated again
            return None
        table: Any = self.table
        for keys, value in numbers.items():
            table = _with_number(table, keys, value)
            if table is None:
                return None
        return build(table, self.folder, self.joining, self.parts)


def _with_number(part: Any, keys: Keys, value: float) -> Any:
    """A copy of checked tables with a different number at one place; None if there is no such number."""
    if not keys:
        return float(value) if type(part) is float and math.isfinite(value) else None
    first, rest = keys[0], keys[1:]
    if isinstance(part, list) and isinstance(first, int) and first < len(part):
        inner = _with_number(part[first], rest, value)
        return None if inner is None else [*part[:first], inner, *part[first + 1 :]]
    if not isinstance(part, Table) or first not in part.model_fields_set:
        return None
    inner = _with_number(vars(part)[first], rest, value)
    return None if inner is None else part.model_copy(update={str(first): inner})


@dataclass(frozen=True, eq=False)
class CaseText:
    """The text of a case file and everything needed to build the case, unchanged or with different numbers.

    folder  the base of relative paths
    source  name in messages
    own     a file with the user's controllers
    dt      the fixed step [s] that replaces a tolerance, if the text has one
    """

    text: str
    folder: Path = Path()
    source: str = "the case"
    own: OwnFile | None = None
    dt: float | None = None

    @classmethod
    def read(cls, case: str | Path, controllers: str | Path | None = None) -> CaseText:
        """Read a case file, or a bundled case by name; raises InputError if it can't be read."""
        path = bundled().get(str(case)) or local_path("the case", case)
        try:
            text = contents(path, "the case file", TEXT_BYTE).decode("utf-8-sig")
        except InputError:
            raise
        except FileNotFoundError:
            names = ", ".join(bundled())
            raise InputError(
                f"the case {str(case)!r} is neither a file nor a bundled case ({names}){hint(case, bundled())}"
            ) from None
        except (OSError, ValueError) as error:
            reason = (
                "it is not UTF-8 text" if isinstance(error, UnicodeDecodeError) else getattr(error, "strerror", None) or error
            )
            raise InputError(f"the case file {str(path)!r} cannot be read: {reason}") from None
        own = None if controllers is None else user_controllers.run(controllers)
        return cls(text, folder=path.parent, source=str(path), own=own)

    def data(self) -> dict[str, Any]:
        """The tables as TOML gives them, a new copy each time, with the step ``dt`` if it replaces a tolerance; raises InputError
        for text that is not TOML, or is nested too deeply."""
        require_readable(self.text, self.source)
        try:
            return _with_steps(tomllib.loads(self.text), self.dt)
        except RecursionError:
            raise InputError(f"{self.source} has too many nested tables or lists") from None
        except ValueError as error:
            if not isinstance(error, tomllib.TOMLDecodeError):  # Python rejects integers with so many digits
                raise InputError(f"{self.source}{self._too_long()} {BEYOND_RANGE}") from None
            twice = len(SINGLE_BRACKETS.findall(self.text)) > 1
            meant = "; each controller needs [[controller]], with two brackets" if twice else ""
            comma = DECIMAL_COMMA.search(self.text)
            if comma is not None and not twice:
                meant = f"; a number has a decimal point: {comma[1]} = {comma[2]}.{comma[3]}"
            raise InputError(f"{self.source} is not valid TOML: {error}{meant}") from None

    def _too_long(self) -> str:
        """The position of a number with more digits than Python reads, and the number of its digits."""
        found = max(DIGITS.finditer(self.text), key=lambda one: len(one[0]))
        line = self.text.count("\n", 0, found.start()) + 1
        return f", line {line}: a number of {len(found[0].replace('_', ''))} digits"

    def variants(self, data: dict[str, Any]) -> Variants:
        """Cases that differ in some numbers from the case with these tables; raises InputError if that case is invalid."""
        table, joining, raw = self._checked(data, changed=True)
        parts = Parts()
        build(table, self.folder, joining, parts, raw)
        return Variants(table, self.folder, joining, parts, with_formulas=raw is not None)

    def case(self, data: dict[str, Any] | None = None) -> Case:
        """The case, or the case with these tables in place of those of the text."""
        changed = data is not None
        data = self.data() if data is None else data
        table, joining, raw = self._checked(data, changed=changed)
        try:
            return build(table, self.folder, joining, raw=raw)
        except InputError:
            if changed:
                raise
            echo(table, tomllib.loads(self.text, parse_float=Typed))
            return build(table, self.folder, joining, raw=raw)  # raises the same error, now in the terms that the file uses

    def _checked(self, data: dict[str, Any], *, changed: bool) -> tuple[Table, tuple[Controller, ...], dict[str, Any] | None]:
        """The tables with checked types, the controllers that join those of the case, and the original tables.

        The last is None if they have neither parameters nor a truth.
        """
        problem = problem_posed(data)
        data, raw = with_numbers(data)
        further = user_controllers.schemes(user_controllers.named_in(data) - CASES[problem].keys(), self.own)
        if self.own is not None:
            user_controllers.require_spelling(
                user_controllers.named_in(data) - CASES[problem].keys() - further.keys(), self.own, CASES[problem]
            )
        joining = () if self.own is None else self.own.controllers(named=further)
        root = case_table(problem, tuple(further.items()), alone=not joining)
        try:
            table = root.model_validate(data)
        except ValidationError:
            as_typed = copy.deepcopy(data) if changed else tomllib.loads(self.text, parse_float=Typed)
            raise several(findings(root, data, as_typed)) from None
        return table, joining, raw


def _with_steps(tables: dict[str, Any], dt: float | None) -> dict[str, Any]:
    """The tables with fixed steps of ``dt`` [s] in place of a tolerance, if they have one."""
    simulation = tables.get("simulation")
    if dt is None or not isinstance(simulation, dict) or "tolerance" not in simulation:
        return tables
    kept = {key: value for key, value in simulation.items() if key not in ("tolerance", "solver")}
    return tables | {"simulation": kept | {"dt": dt}}


def load_case(case: str | Path, controllers: str | Path | None = None) -> Case:
    """Load a case file, or a bundled case by its name.

    controllers  a Python file whose controllers join those of the case and whose classes the case may name (see
                 ``user_controllers``). The file is executed

    Raises InputError, with one sentence, for a missing or unreadable file, text that is not TOML, unknown keys (with the closest
    known one), and everything that the constructors of the objects reject.
    """
    return CaseText.read(case, controllers).case()


def parse_case(text: str, folder: Path = Path(), source: str = "the case", own: OwnFile | None = None) -> Case:
    """Read a case from TOML text; relative paths in it start at ``folder``, and ``own`` is a file with the user's controllers."""
    return CaseText(text, folder, source, own).case()


TEXT_BYTE = Estimate(memory=100.0, seconds=5e-6)
"""Cost of each byte of a case file: the parser takes 0.1 to 1.1 us and up to 27 bytes, and the tables are read three times and
checked."""
PART_PAIR = Estimate(memory=4.0, seconds=5e-8)
"""Largest sum, over dotted keys, of the squared number of parts, because each part stores those before it: 35 MB and 0.1 s for
3,000 parts, and the text is read three times."""
MOST_NESTED = 200
"""Largest depth of nested lists or tables, including the nesting by dotted keys: each level takes two calls of the parser, and
Python allows a thousand."""

TOKEN = re.compile(
    r"""
      (?P<text>\"{3}(?:[^"\\]|\\.|"(?!""))*+(?:"{3}|\Z) | '{3}(?:[^']|'(?!''))*+(?:'{3}|\Z))   # of several lines
    | (?P<part>"(?:[^"\\\n]|\\.)*+" | '[^'\n]*+' | [\w+-]++)                                   # of a key, or a value
    | (?P<dot>[ \t]*+\.[ \t]*+)
    | (?P<open>[\[{]) | (?P<close>[\]}]) | (?P<equal>=)
    | (?P<comment>\#[^\n]*+)
    """,
    re.VERBOSE | re.DOTALL,
)


@dataclass(frozen=True)
class TomlSize:
    """``longest`` is the largest number of parts of a key; ``squares`` is the sum of their squares, ``equals`` counts keys with a
    value, and ``nested`` counts levels of brackets."""

    longest: int
    squares: int
    equals: int
    nested: int

    @classmethod
    def of(cls, text: str) -> TomlSize:
        """Count in one pass; a number with a point counts as two parts, which makes no difference."""
        longest = squares = equals = nested = deepest = parts = 0
        after, joined = -1, False  # the end of a key that may continue, and whether a point followed
        for found in TOKEN.finditer(text):
            kind, begin = found.lastgroup, found.start()
            if kind == "dot":
                joined, after = begin == after, found.end()
                continue
            if kind == "part":
                parts = parts + 1 if joined and begin == after else 1
                squares += 2 * parts - 1  # from (p - 1)^2 to p^2
                longest, after, joined = max(longest, parts), found.end(), False
                continue
            joined = False
            nested += (kind == "open") - (kind == "close")
            deepest = max(deepest, nested)
            equals += kind == "equal"
        return cls(longest, squares, equals, deepest)

    @property
    def pairs(self) -> int:
        """The number of steps a parser takes: the parts of each key and, for each value, the parts of its table's name."""
        return self.squares + self.equals * self.longest


def require_readable(text: str, source: str) -> None:
    """Raise InputError for text whose keys or nesting exceed the budget or Python's recursion limit."""
    size = TomlSize.of(text)
    if size.nested > MOST_NESTED:
        raise InputError(f"{source} has {size.nested} nested lists or tables; at most {MOST_NESTED} can be read")
    if size.longest > MOST_NESTED:
        raise InputError(f"{source} has a key of {size.longest} parts separated by dots; at most {MOST_NESTED} can be read")
    rest = size.pairs - size.longest**2
    budget.require(
        source, size.longest, lambda parts: PART_PAIR.times(parts**2 + rest),
        given=f"has a key of {size.longest} parts separated by dots, and to read it",
        fits=lambda parts: f"at most {parts} parts", what=f"reading {source}",
    )  # fmt: skip
