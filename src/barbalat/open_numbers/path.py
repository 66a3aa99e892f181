"""Places of numbers in a case file, as ``plant.theta[0]``: how they are written, what stands there, what is put there."""

from __future__ import annotations

import re
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from barbalat import validate
from barbalat.validate import InputError

Tables = dict[str, Any]
"""What TOML makes of a case file."""
Key = str | int

_KEY = re.compile(r"([A-Za-z_][A-Za-z0-9_-]*)((?:\[\d+\])*)$")


@dataclass(frozen=True)
class FieldPath:
    """Keys of tables and indices of lists, from the file's root to a number."""

    keys: tuple[Key, ...]

    @classmethod
    def parse(cls, text: str) -> FieldPath:
        """InputError for what is no path."""
        keys: list[Key] = []
        for part in text.split("."):
            found = _KEY.match(part)
            if found is None:
                raise InputError(f"a path must be keys and indices such as plant.theta[0], got {validate.show(text)}")
            keys += [found[1], *(int(index) for index in re.findall(r"\d+", found[2]))]
        return cls(tuple(keys))

    def __str__(self) -> str:
        return _text(self.keys)

    def entry(self, index: int) -> FieldPath:
        """The path to an entry of the list that stands here."""
        return FieldPath((*self.keys, index))

    def of(self, tables: Tables) -> Any:
        """What stands there; None where a table lacks the key, for which a default may stand in. InputError for a wrong index."""
        here: Any = tables
        for position, key in enumerate(self.keys):
            if isinstance(key, int):
                here = here[self._index(here, position)]
            elif isinstance(here, dict):
                if key not in here:
                    return None
                here = here[key]
            else:
                raise InputError(f"{self} names no field: {_text(self.keys[:position])} is {validate.show(here)}, not a table")
        return here

    def put(self, tables: Tables, value: float) -> None:
        """A number there, whole where a whole one or none stood; tables that are missing on the way are made.

        InputError where a list or a table stands there: its entries are the numbers.
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
                raise InputError(f"{self} names no field: {_text(self.keys[:position])} is {validate.show(here)}, not a table")
        last: Any = self.keys[-1]
        if isinstance(last, int):
            self._index(here, len(self.keys) - 1)
        elif not isinstance(here, dict):
            raise InputError(f"{self} names no field: {_text(self.keys[:-1])} is {validate.show(here)}, not a table")
        old = here[last] if isinstance(last, int) else here.get(last)
        if isinstance(old, (list, dict)):
            entry = "entry" if isinstance(old, list) else "key"
            example = f"{self}[0]" if isinstance(old, list) else f"{self}.{next(iter(old), 'key')}"
            raise InputError(f"{self} is not a number but has several; name one {entry}, as {example}")
        if isinstance(old, (str, bool)):
            raise InputError(f"{self} is {validate.show(old)}, not a number, and can't be varied")
        here[last] = int(value) if isinstance(old, int | None) and value.is_integer() else value

    def _not_given(self, position: int, table: Tables) -> InputError:
        """For a list that is not there, with the one of the table that is spelt most like it."""
        near = get_close_matches(str(self.keys[position]), [key for key, value in table.items() if isinstance(value, list)], n=1)
        meant = f"; did you mean {_text((*self.keys[:position], *near, *self.keys[position + 1 :]))!r}?" if near else ""
        place = _text(self.keys[: position + 1])
        return InputError(f"{self} names no field: {place} is not given: write it into the case first{meant}")

    def _index(self, here: Any, position: int) -> int:
        key, place = self.keys[position], _text(self.keys[:position])
        if not isinstance(here, list):
            said = "is not given: write it into the case first" if here in (None, {}) else f"is {validate.show(here)}, not a list"
            raise InputError(f"{self} names no field: {place} {said}")
        if not isinstance(key, int) or key >= len(here):
            raise InputError(f"{self} names no field: {place} has {validate.counted(len(here), 'entry')}, counted from 0")
        return key


def copied(tables: Tables) -> Tables:
    """Tables of their own with the same values: what TOML has are tables, lists, and what nobody changes."""
    return {key: _copied(value) for key, value in tables.items()}


def _copied(part: Any) -> Any:
    if isinstance(part, dict):
        return copied(part)
    return [_copied(value) for value in part] if isinstance(part, list) else part


def _text(keys: tuple[Key, ...]) -> str:
    return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys).removeprefix(".")
