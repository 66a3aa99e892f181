"""The path of a number, ``plant.theta[0]``: its text, and its position in a case file and in Python's objects."""

from __future__ import annotations

import re
from dataclasses import dataclass, is_dataclass
from difflib import get_close_matches
from typing import Any

from barbalat import validate
from barbalat.problem.labels import Labels
from barbalat.protocols import Controller
from barbalat.validate import InputError

Tables = dict[str, Any]
"""The tables that the TOML parser returns for a case file."""
Key = str | int

_KEY = re.compile(r"([A-Za-z_][A-Za-z0-9_-]*)((?:\[\d+(?:,\d+)*\])*)$")
_LABEL = re.compile(r"\[([^\[\]]*)\]")
_ERROR_OF = re.compile(r"\b(\w+_e)\[(\d+)\]")
FILE_TABLES = {"disturbance": "plant", "unmatched": "plant", "output_disturbance": "plant", "input_gain": "uncertainty"}
"""Fields of a problem that are keys of a table of the case file, with that table."""
WRAPPED = "controller"
"""The field of a controller that contains another controller, as in ``Sampled``. Paths omit this field, as case files do."""


@dataclass(frozen=True)
class FieldPath:
    """Keys of tables and indices of lists, from the file's root to a number."""

    keys: tuple[Key, ...]

    @classmethod
    def parse(cls, text: str) -> FieldPath:
        """Raise InputError for an invalid path."""
        keys: list[Key] = []
        for part in text.split("."):
            found = _KEY.match(part)
            if found is None:
                raise InputError(f"a path must be keys and indices such as plant.theta[0], got {validate.show(text)}")
            keys += [found[1], *(int(index) for index in re.findall(r"\d+", found[2]))]
        return cls(tuple(keys))

    def __str__(self) -> str:
        return _text(self.keys)

    @property
    def structured(self) -> str:
        """The path in the structured names of FMI, in which both indices of a matrix entry are in one pair of brackets."""
        return str(self).replace("][", ",")

    @classmethod
    def of_field(cls, keys: tuple[Key, ...]) -> FieldPath:
        """The path of a number among the fields of a problem, of ``controller[i]`` or of the simulation."""
        table = FILE_TABLES.get(str(keys[0]))
        return cls(keys if table is None else (table, *keys))

    @property
    def field(self) -> tuple[Key, ...]:
        """The number's position among the fields of a problem, of ``controller[i]`` or of the simulation."""
        return self.keys[1:] if len(self.keys) > 1 and FILE_TABLES.get(str(self.keys[1])) == self.keys[0] else self.keys

    @property
    def vector(self) -> tuple[Key, ...]:
        """The path of the vector or matrix that contains the number, or of the number if there is none."""
        keys = self.keys
        while isinstance(keys[-1], int):
            keys = keys[:-1]
        return keys

    def entry(self, index: int) -> FieldPath:
        """The path to an entry of the list at this path."""
        return FieldPath((*self.keys, index))

    def of(self, tables: Tables) -> Any:
        """The value at this path; None if a table lacks the key, which may have a default. Raises InputError for a wrong
        index."""
        here: Any = tables
        for position, key in enumerate(self.keys):
            if isinstance(key, int):
                here = here[self._index(here, position)]
            elif isinstance(here, dict):
                if key not in here:
                    return None
                here = here[key]
            else:
                raise InputError(
                    f"{self} does not name a field: {_text(self.keys[:position])} is {validate.show(here)}, not a table"
                )
        return here

    def put(self, tables: Tables, value: float, *, said: FieldPath | None = None) -> None:
        """Put a number at this path, as an integer if the previous value was an integer or missing; missing tables are created.

        said  the path that a user gave, for the error if a formula or a text is there; by default this path

        Raises InputError if the path leads to a list or a table, whose entries are the numbers.
        """
        here: Any = tables
        for position, key in enumerate(self.keys[:-1]):
            if isinstance(key, int):
                here = here[self._index(here, position)]
            elif isinstance(here, dict):
                if key not in here and isinstance(self.keys[position + 1], int):
                    raise self._not_given(position, here)
                here = here.setdefault(key, {})
            else:
                raise InputError(
                    f"{self} does not name a field: {_text(self.keys[:position])} is {validate.show(here)}, not a table"
                )
        last: Any = self.keys[-1]
        if isinstance(last, int):
            self._index(here, len(self.keys) - 1)
        elif not isinstance(here, dict):
            raise InputError(f"{self} does not name a field: {_text(self.keys[:-1])} is {validate.show(here)}, not a table")
        old = here[last] if isinstance(last, int) else here.get(last)
        if isinstance(old, (list, dict)):
            entry = "entry" if isinstance(old, list) else "key"
            example = f"{self}[0]" if isinstance(old, list) else f"{self}.{next(iter(old), 'key')}"
            raise InputError(f"{self} is not a single number; name one {entry}, such as {example}")
        if isinstance(old, (str, bool)):
            formula = isinstance(old, str) and self.keys[0] in ("plant", "truth", "sensor") and "parameters" in tables
            instead = "a formula: vary the parameters in it" if formula else "not a number, and cannot be varied"
            raise InputError(f"{said or self} is {validate.show(old)}, {instead}")
        here[last] = int(value) if isinstance(old, int | None) and value.is_integer() else value

    def _not_given(self, position: int, table: Tables) -> InputError:
        """The error for a missing list, with the closest spelling in the table."""
        near = get_close_matches(str(self.keys[position]), [key for key, value in table.items() if isinstance(value, list)], n=1)
        meant = f"; did you mean {_text((*self.keys[:position], *near, *self.keys[position + 1 :]))!r}?" if near else ""
        place = _text(self.keys[: position + 1])
        return InputError(f"{self} does not name a field: {place} is not given; write it into the case first{meant}")

    def _index(self, here: Any, position: int) -> int:
        key, place = self.keys[position], _text(self.keys[:position])
        if not isinstance(here, list):
            said = "is not given; write it into the case first" if here in (None, {}) else f"is {validate.show(here)}, not a list"
            raise InputError(f"{self} does not name a field: {place} {said}")
        if not isinstance(key, int) or key >= len(here):
            raise InputError(f"{self} does not name a field: {place} has {validate.counted(len(here), 'entry')}, counted from 0")
        return key


def wrapped_in(part: Any, key: Key | None = None) -> Any:
    """The inner controller of a controller that contains another, if a path continues in it with ``key``; otherwise None."""
    own = vars(part) if is_dataclass(part) else {}
    inner = own.get(WRAPPED)
    if not isinstance(inner, Controller) or (key in own and not (key == WRAPPED and key in vars(inner))):
        return None
    return inner


def by_index(text: str, labels: Labels | None) -> str:
    """A path, a metric or a requirement with each state's label in brackets replaced by its index: ``max_abs_e[phi]``."""
    names = () if labels is None else labels.names
    return _LABEL.sub(lambda found: f"[{names.index(found[1])}]" if found[1] in names else found[0], text)


def by_label(text: str, labels: Labels | None) -> str:
    """The inverse of ``by_index`` for metrics of errors: ``max_abs_e[0]`` becomes ``max_abs_e[phi]``."""
    names = () if labels is None else labels.names
    return _ERROR_OF.sub(lambda found: f"{found[1]}[{names[int(found[2])]}]" if int(found[2]) < len(names) else found[0], text)


def copied(tables: Tables) -> Tables:
    """An independent copy of tables: only tables and lists are copied, because other values are immutable."""
    return {key: _copied(value) for key, value in tables.items()}


def _copied(part: Any) -> Any:
    if isinstance(part, dict):
        return copied(part)
    return [_copied(value) for value in part] if isinstance(part, list) else part


def _text(keys: tuple[Key, ...]) -> str:
    return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys).removeprefix(".")
