"""The base class of objects that are constructed from keyword arguments, and how they are displayed at a prompt."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache
from inspect import Parameter, Signature, getattr_static, signature
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from barbalat.validate import MOST_SHOWN, counted, hint

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


class _SignatureOfInit:
    """The signature that ``help``, editors and the reference show: the signature of ``__init__``, since ``__new__`` takes
    anything."""

    def __get__(self, instance: object, kind: type) -> Signature:
        if instance is not None:
            raise AttributeError("__signature__")
        whole = signature(getattr_static(kind, "__init__"))
        return whole.replace(parameters=list(whole.parameters.values())[1:], return_annotation=Signature.empty)


class Settings:
    """The base class of objects that are constructed from keyword arguments, the first of which may also be positional. The error
    for a wrong call says which arguments are possible.

    For an unknown keyword the error suggests the closest one, as in case files. It is a TypeError, as for any wrong call.
    """

    __slots__ = ()
    __signature__ = _SignatureOfInit()

    def __new__(cls, *placed: object, **given: object) -> Self:
        kind: type = cls
        known = _parameters(kind)
        if known is not None and (placed or given):  # such a call comes from pickle or copy, or Python's own message suffices
            _require_known(cls.__name__, given, known)
            _require_places(cls.__name__, len(placed), given, known)
        return super().__new__(cls)


@cache
def _parameters(kind: type) -> dict[str, Parameter] | None:
    """A constructor's parameters by name, in order; None for a user-defined constructor that takes any."""
    _, *parameters = signature(getattr_static(kind, "__init__")).parameters.values()  # the first is self
    if any(one.kind in (Parameter.VAR_KEYWORD, Parameter.VAR_POSITIONAL) for one in parameters):
        return None
    return {one.name: one for one in parameters}


def _require_known(name: str, given: Mapping[str, object], known: Mapping[str, Parameter]) -> None:
    unknown = next((one for one in given if one not in known), None)
    if unknown is None:
        return
    raise TypeError(f"{name} has no keyword {unknown!r}" + (hint(unknown, known) or f"; known here: {', '.join(known)}"))


def _require_places(name: str, count: int, given: Mapping[str, object], known: Mapping[str, Parameter]) -> None:
    """Raise TypeError for too many positional arguments, or for a missing argument without a default."""
    places = [one.name for one in known.values() if one.kind is not Parameter.KEYWORD_ONLY]
    keywords = ", ".join(f"{one}=..." for one in known if one not in places)
    if count > len(places):
        taken = f"{', '.join(places)} without a keyword" if places else "nothing without a keyword"
        others = f"; give the others by theirs: {keywords}" if keywords else ""
        raise TypeError(f"{name} takes {taken}, got {counted(count, 'value')}{others}")
    told = {*places[:count], *given}
    lacking = [one.name for one in known.values() if one.default is Parameter.empty and one.name not in told]
    if lacking:
        call = ", ".join(filter(None, (", ".join(places), keywords)))
        raise TypeError(f"{name} needs {' and '.join(lacking)} too: {name}({call})")


def one_line(shown: DataclassInstance) -> str:
    """A dataclass as shown at a prompt: on one line, without the fields that have their defaults."""
    return f"{type(shown).__name__}({', '.join(f'{name}={text}' for name, text in given_of(shown).items())})"


def given_of(shown: DataclassInstance) -> dict[str, str]:
    """The fields that differ from their defaults, each as it is shown at a prompt."""
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
