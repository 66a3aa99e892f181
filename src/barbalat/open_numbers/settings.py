"""Settings of a controller or a plant that are numbers, whatever class it is of, and the whole with another value of one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from barbalat.loop.structure import parts_of
from barbalat.protocols import Controller
from barbalat.validate import Array

Rebuild = Callable[[Any], Any]
"""A whole with another part, of that part."""
GAINS = ("gamma", "covariance0")
"""What laws call the gain that they begin with."""


def gain_of(controller: Controller) -> tuple[str, float, Rebuild] | None:
    """The controller's gain, where it has one for all estimates: its setting, its value, and the controller with another one."""
    return next((one for one in numbers(controller) if one[0].rpartition(".")[2] in GAINS), None)


def settable(part: Any, name: str) -> bool:
    """Whether a field is given by whoever makes the object."""
    return any(field.name == name and field.init for field in fields(part))


def numbers(part: Any) -> Iterator[tuple[str, float, Rebuild]]:
    """Settings that are numbers or entries of arrays, by their places, and the whole with another value of each."""
    for name, inner in (parts_of(part) or {}).items() if is_dataclass(part) else ():
        if not settable(part, name):
            continue

        def put(value: Any, name: str = name) -> Any:
            return replace(part, **{name: value})

        if isinstance(inner, float):
            yield name, inner, put
        elif isinstance(inner, np.ndarray):
            yield from _entries(name, inner, put)
        elif isinstance(inner, tuple):
            for i, one in enumerate(inner):
                yield from _below(f"{name}[{i + 1}]", one, _after(put, _in_place(inner, i)))
        else:
            yield from _below(name, inner, put)


def _below(name: str, part: Any, put: Rebuild) -> Iterator[tuple[str, float, Rebuild]]:
    for inner, value, rebuilt in numbers(part):
        yield f"{name}.{inner}", value, _after(put, rebuilt)


def _entries(name: str, array: Array, put: Rebuild) -> Iterator[tuple[str, float, Rebuild]]:
    for place, value in np.ndenumerate(array):

        def with_entry(v: float, place: tuple[int, ...] = place) -> Array:
            other = array.copy()
            other[place] = v
            return other

        text = ",".join(str(i + 1) for i in place)
        yield (f"{name}[{text}]" if place else name), float(value), _after(put, with_entry)


def _in_place(whole: tuple[Any, ...], i: int) -> Rebuild:
    def with_other(part: Any) -> tuple[Any, ...]:
        return (*whole[:i], part, *whole[i + 1 :])

    return with_other


def _after(put: Rebuild, rebuilt: Rebuild) -> Rebuild:
    def both(value: Any) -> Any:
        return put(rebuilt(value))

    return both
