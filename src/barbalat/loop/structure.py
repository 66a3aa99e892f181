"""The structure of equations: the parts of an object of any class, and all their properties except the numbers."""

from __future__ import annotations

import copy
from collections.abc import Callable, Hashable, Iterator
from dataclasses import fields, is_dataclass
from operator import attrgetter
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType, NoneType
from typing import Any

import numpy as np

DEEPEST_NESTING = 12
"""Largest depth of objects within objects. Deeper parts are compared as a whole, which also covers objects that contain
themselves."""

_WHOLE = {
    *(float, np.ndarray, NoneType, str, bool, int, bytes, type),
    *(FunctionType, BuiltinFunctionType, MethodType, ModuleType),
}
"""Classes without parts."""


def parts_of(part: Any) -> dict[Any, Any] | None:
    """An object's parts by name or index: fields, entries, attributes; ``None`` for an object without parts."""
    kind = type(part)
    if kind in _WHOLE:
        return None
    if isinstance(part, (tuple, list)):
        return dict(enumerate(part))
    if isinstance(part, dict):
        return dict(part)
    if (names := _field_names(kind)) is not None:
        return {name: getattr(part, name) for name in names}
    if isinstance(part, type) or not hasattr(part, "__dict__"):
        return None
    attributes: dict[str, Any] = vars(part)
    return attributes


_FIELDS: dict[type, tuple[str, ...] | None] = {}
"""The fields of a dataclass by class; ``None`` for any other class. Cached, because every member of an ensemble needs them."""


def _field_names(kind: type) -> tuple[str, ...] | None:
    if kind not in _FIELDS:
        _FIELDS[kind] = tuple(field.name for field in fields(kind)) if is_dataclass(kind) else None
    return _FIELDS[kind]


def with_parts(part: Any, parts: list[Any]) -> Any:
    """A copy with different parts, in the order of ``parts_of``."""
    if isinstance(part, tuple):
        return tuple(parts) if type(part) is tuple else type(part)(*parts)
    if isinstance(part, list):
        return parts
    named = dict(zip(parts_of(part) or {}, parts, strict=True))
    if isinstance(part, dict):
        return named
    twin = copy.copy(part)
    if is_dataclass(part) and hasattr(twin, "__dict__"):
        vars(twin).clear()  # this also copies cached values computed from the old parts
    for name, value in named.items():
        object.__setattr__(twin, name, value)
    return twin


def structure(part: Any, depth: int = 0) -> Iterator[Any]:
    """Everything about a part that is not a number, hashable: types, shapes, options."""
    if isinstance(part, np.ndarray):
        yield part.shape
        return
    if isinstance(part, float):
        return
    parts = parts_of(part) if depth < DEEPEST_NESTING else None
    if parts is None:
        yield part if isinstance(part, Hashable) else id(part)
        return
    yield type(part)
    for name, inner in parts.items():
        yield name
        yield from structure(inner, depth + 1)


def values_of(part: Any) -> tuple[Any, ...]:
    """The values of ``parts_of`` for an object with parts."""
    kind = type(part)
    if (found := _VALUES.get(kind)) is not None:
        return found(part)
    if (names := _field_names(kind)) is None:
        return part if isinstance(part, tuple) else tuple((parts_of(part) or {}).values())
    _VALUES[kind] = attrgetter(*names) if len(names) > 1 else lambda part: tuple(getattr(part, name) for name in names)
    return _VALUES[kind](part)


_VALUES: dict[type, Callable[[Any], tuple[Any, ...]]] = {}


def same_names(part: Any, other: Any) -> bool:
    """Whether two objects of the same class, both with or both without parts, have parts with the same names."""
    if _field_names(type(part)) is not None:
        return True
    parts, others = parts_of(part), parts_of(other)
    return (parts is None) == (others is None) and (parts is None or others is None or parts.keys() == others.keys())


def same_whole(part: Any, other: Any) -> bool:
    """Whether two objects without parts are equal; objects that can't be compared are equal only to themselves."""
    return part is other or (isinstance(other, Hashable) and bool(part == other))


def identical(part: Any, other: Any, depth: int = 0) -> bool:
    """Whether two parts agree in everything, bit for bit, so that everything computed from them is equal."""
    if part is other:
        return True
    if type(part) is not type(other):
        return False
    if isinstance(part, np.ndarray):
        return bool(part.shape == other.shape and part.dtype == other.dtype and part.tobytes() == other.tobytes())
    if isinstance(part, float):
        return bool(part.hex() == other.hex())
    if depth >= DEEPEST_NESTING or parts_of(part) is None:
        return same_whole(part, other)
    return same_names(part, other) and all(
        one is two or identical(one, two, depth + 1) for one, two in zip(values_of(part), values_of(other), strict=True)
    )


def comes_from_outside(part: Any, depth: int = 0) -> bool:
    """Whether a class or a function from outside the package is involved."""
    kind = type(part)
    if kind is FunctionType:
        return not (part.__module__ or "").startswith(_PACKAGE)
    if kind in _WHOLE or depth >= DEEPEST_NESTING or (_field_names(kind) is None and parts_of(part) is None):
        return False
    if kind not in _OWN:
        _OWN[kind] = kind in (tuple, list, dict) or kind.__module__.startswith(_PACKAGE)
    return not _OWN[kind] or any(comes_from_outside(inner, depth + 1) for inner in values_of(part))


_OWN: dict[type, bool] = {}
"""Whether a class belongs to the package or is a Python container; cached, because every member of an ensemble needs it."""
_PACKAGE = __name__.partition(".")[0] + "."
