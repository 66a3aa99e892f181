"""Reading a case: a path or a bundled name in, a validated Case out, or one clear sentence."""

from __future__ import annotations

import copy
import re
import tomllib
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from barbalat.cases import outside
from barbalat.cases.build import Case, build
from barbalat.cases.echoes import echo
from barbalat.cases.findings import Typed, findings, several
from barbalat.cases.outside import OwnFile
from barbalat.cases.schema import CASES, case_table, problem_posed
from barbalat.cases.toml_size import TEXT_BYTE, require_readable
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
SINGLE_BRACKETS = re.compile(r"^\s*\[\s*controller\s*\]", re.MULTILINE)
"""The head of the only controller of a case: a second one makes it no TOML."""


@dataclass(frozen=True, eq=False)
class CaseText:
    """The text of a case file with what is needed to make the case of it, as it stands or with other numbers.

    folder  where relative paths in it start
    source  what it is called in messages
    own     a file with the user's controllers
    """

    text: str
    folder: Path = Path()
    source: str = "the case"
    own: OwnFile | None = None

    @classmethod
    def read(cls, case: str | Path, controllers: str | Path | None = None) -> CaseText:
        """A case file, or a bundled case by its name; InputError for one that can't be read."""
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
        own = None if controllers is None else outside.run(controllers)
        return cls(text, folder=path.parent, source=str(path), own=own)

    def data(self) -> dict[str, Any]:
        """The tables as TOML has them, a new copy each time; InputError for text that is not TOML, or is nested too deeply."""
        require_readable(self.text, self.source)
        try:
            return tomllib.loads(self.text)
        except RecursionError:
            raise InputError(f"{self.source} has tables or lists inside each other, too many to be read") from None
        except ValueError as error:
            twice = len(SINGLE_BRACKETS.findall(self.text)) > 1
            meant = "; each controller stands under [[controller]], with two brackets" if twice else ""
            comma = DECIMAL_COMMA.search(self.text)
            if comma is not None and not twice:
                meant = f"; a number has a decimal point: {comma[1]} = {comma[2]}.{comma[3]}"
            raise InputError(f"{self.source} is not valid TOML: {error}{meant}") from None

    def case(self, data: dict[str, Any] | None = None) -> Case:
        """The case, or the one that the text would be with these tables instead of its own."""
        changed = data is not None
        data = self.data() if data is None else data
        problem = problem_posed(data)
        further = outside.schemes(outside.named_in(data) - CASES[problem].keys(), self.own)
        if self.own is not None:
            outside.require_spelling(outside.named_in(data) - CASES[problem].keys() - further.keys(), self.own, CASES[problem])
        joining = () if self.own is None else self.own.controllers(named=further)
        root = case_table(problem, tuple(further.items()), alone=not joining)
        try:
            table = root.model_validate(data)
        except ValidationError:
            as_typed = copy.deepcopy(data) if changed else tomllib.loads(self.text, parse_float=Typed)
            raise several(findings(root, data, as_typed)) from None
        try:
            return build(table, self.folder, joining)
        except InputError:
            if changed:
                raise
            echo(table, tomllib.loads(self.text, parse_float=Typed))
            return build(table, self.folder, joining)  # is refused once more, in the words of the file


def load_case(case: str | Path, controllers: str | Path | None = None) -> Case:
    """Load a case file, or a bundled case by its name.

    controllers  a Python file whose controllers join the case's and whose classes the case may name: see ``outside``. It is run

    Raises InputError, with one sentence, for a missing or unreadable file, text that is not TOML, unknown keys (with the
    nearest known one), and everything that the objects' constructors refuse.
    """
    return CaseText.read(case, controllers).case()


def parse_case(text: str, folder: Path = Path(), source: str = "the case", own: OwnFile | None = None) -> Case:
    """Read a case from TOML text; relative paths in it start at ``folder``, and ``own`` is a file with the user's controllers."""
    return CaseText(text, folder, source, own).case()
