"""What a person makes by keyword arguments: the base of it, and how it is shown at a prompt."""

from __future__ import annotations

from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from barbalat.validate import MOST_SHOWN

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


class Settings:
    """The base of what is made by keyword arguments: one that there is not is told with the one that is meant, as in case files.

    It is a TypeError, as of any call that can't be.
    """

    __slots__ = ()

    def __new__(cls, *_: object, **given: object) -> Self:
        kind: type = cls
        known = _keywords(kind)
        if known is None or given.keys() <= known.keys():
            return super().__new__(cls)
        from difflib import get_close_matches

        unknown = next(name for name in given if name not in known)
        near = get_close_matches(unknown, known, n=1) or get_close_matches(unknown.lower(), known, n=1)
        meant = f"did you mean {near[0]!r}?" if near else f"known here: {', '.join(known)}"
        raise TypeError(f"{cls.__name__} has no keyword {unknown!r}; {meant}")


@cache
def _keywords(kind: type) -> dict[str, None] | None:
    """The names that a constructor takes, in its order; None of one, of somebody else's, that takes any."""
    from inspect import Parameter, getattr_static, signature

    _, *parameters = signature(getattr_static(kind, "__init__")).parameters.values()  # the first is self
    if any(one.kind is Parameter.VAR_KEYWORD for one in parameters):
        return None
    return {one.name: None for one in parameters}


def one_line(shown: DataclassInstance) -> str:
    """A dataclass at a prompt: on one line, without the fields that are as by default."""
    return f"{type(shown).__name__}({', '.join(f'{name}={text}' for name, text in given_of(shown).items())})"


def given_of(shown: DataclassInstance) -> dict[str, str]:
    """The fields that are not as by default, each as it is shown at a prompt."""
    found = {one: getattr(shown, one.name) for one in fields(shown) if one.init and one.repr}
    return {one.name: _at_a_prompt(value) for one, value in found.items() if not _is_default(one, value)}


def _is_default(one: Field[Any], value: Any) -> bool:
    default = one.default if one.default_factory is MISSING else one.default_factory()
    return value is default or (type(value) is type(default) and not isinstance(value, np.ndarray) and bool(value == default))


def _at_a_prompt(value: Any) -> str:
    if is_dataclass(value) and not isinstance(value, type) and isinstance(value, Settings):
        return one_line(value)
    if isinstance(value, tuple):
        return f"[{', '.join(map(_at_a_prompt, value))}]"
    if not isinstance(value, np.ndarray):
        return repr(value)
    return " ".join(np.array2string(value, separator=", ", threshold=MOST_SHOWN, edgeitems=2).split())
