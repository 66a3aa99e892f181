"""Numbers that remember how they were typed, so that errors of constructors quote them as the case file writes them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Self

from barbalat.cases.findings import Typed
from barbalat.cases.keys import Given
from barbalat.cases.table_models import Table
from barbalat.validate import InputError

NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*\w)")
"""A number in a sentence."""


class TypedNumber(float):
    """A number that is shown as it was typed in the case file."""

    text: str

    @classmethod
    def of(cls, number: float, text: str) -> Self:
        made = cls(number)
        made.text = text
        return made

    def __repr__(self) -> str:
        return self.text


def echo(table: Table, as_typed: dict[str, Any]) -> None:
    """Give the numbers of a table and of its inner tables the texts in ``as_typed``."""
    for key in table.model_fields_set & vars(table).keys():
        own = table.recipe.keys.get(key)
        given = as_typed.get(key, None if own is None else as_typed.get(own.alias or ""))
        vars(table)[key] = _echoed(vars(table)[key], given)


def _echoed(value: Any, given: Any) -> Any:
    match value, given:
        case Table(), dict():
            echo(value, given)
        case list(), list() if len(value) == len(given):
            return [_echoed(one, other) for one, other in zip(value, given, strict=True)]
        case float(), Typed() | int():
            return TypedNumber.of(value, str(given))
    return value


@contextmanager
def in_the_files_words(given: Given) -> Iterator[None]:
    """Rewrites an InputError about the keys of a table with the numbers as typed, even if it shows them in converted form."""
    whole = dict(given)  # the builder removes keys
    try:
        yield
    except InputError as error:
        texts = _texts(_at(error.field, whole))
        sentences = (_in_these(texts, sentence) for sentence in error.sentences)
        raise InputError(*sentences, field=error.field, controller=error.controller) from None


def _at(field: str, given: Given) -> Any:
    """The value of a field, followed as deep as ``given`` goes; an object built from a table has no typed numbers."""
    here: Any = given
    for key in field.split("."):
        here = here[key] if isinstance(here, dict) and key in here else here
    return here


def _texts(value: Any) -> dict[str, str]:
    """Return a map from displayed numbers and lists to their typed form, if that is unique."""
    found: dict[str, set[str]] = {}
    for plain, typed in _shown(value):
        found.setdefault(plain, set()).add(typed)
    return {plain: one for plain, (one, *others) in found.items() if not others and one != plain}


def _shown(value: Any) -> Iterator[tuple[str, str]]:
    match value:
        case TypedNumber():
            yield repr(float(value)), value.text
        case list():
            yield repr(_plain(value)), repr(value)
    parts = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    for part in parts:
        yield from _shown(part)


def _plain(value: Any) -> Any:
    return (
        [_plain(one) for one in value] if isinstance(value, list) else float(value) if isinstance(value, TypedNumber) else value
    )


def _in_these(texts: dict[str, str], sentence: str) -> str:
    """Replace lists first, then single numbers."""
    for plain, typed in texts.items():
        if plain.startswith("["):
            sentence = sentence.replace(plain, typed)
    return NUMBER.sub(lambda found: texts.get(found[0], found[0]), sentence)
