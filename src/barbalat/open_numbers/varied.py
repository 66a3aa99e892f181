"""A case with other numbers at some of its places: what a sweep asks of it, and one made of Python's objects."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.cases.build import Case
from barbalat.open_numbers.path import FieldPath, Key
from barbalat.validate import Array, InputError


class Varied(ABC):
    """What stands at ``paths`` is given for each member."""

    paths: tuple[FieldPath, ...]
    """Where the numbers stand that vary."""

    @property
    @abstractmethod
    def source(self) -> str:
        """What a store is compared with, beside the equations and their numbers."""

    @abstractmethod
    def at(self, values: Sequence[float] | Array) -> Case:
        """The case with these numbers, checked as any other; InputError where it can't be used."""


@dataclass(frozen=True, eq=False)
class VariedObjects(Varied):
    """Fields of a problem, of its controllers and of the simulation, by their names: ``controller[0].gamma``."""

    case: Case
    paths: tuple[FieldPath, ...]

    @property
    def source(self) -> str:
        return f"{self.case!r}"

    def standing(self, path: FieldPath) -> object:
        """What a field is; None where there is none."""
        first, *rest = path.keys
        apart = {"controller": self.case.controllers, "simulation": self.case.simulation}
        here: Any = apart.get(str(first), self.case.problem)
        try:
            for key in rest if first in apart else path.keys:
                here = here[key] if isinstance(key, int) else vars(here)[key]
        except (LookupError, TypeError):
            return None
        return here

    def at(self, values: Sequence[float] | Array) -> Case:
        problem, controllers, simulation = self.case.problem, self.case.controllers, self.case.simulation
        for path, value in zip(self.paths, values, strict=True):
            first, *rest = path.keys
            if first == "controller":
                controllers = _put(path, controllers, rest, float(value))
            elif first == "simulation":
                simulation = _put(path, simulation, rest, float(value))
            else:
                problem = _put(path, problem, list(path.keys), float(value))
        return Case(problem, controllers, simulation)


def _put(path: FieldPath, part: Any, keys: Sequence[Key], value: float) -> Any:
    """A copy of a part with another number at one place, made by its constructors; InputError where no number stands there."""
    if not keys:
        return _number(path, part, value)
    key, rest = keys[0], keys[1:]
    if isinstance(key, int):
        if not isinstance(part, (tuple, list, np.ndarray)):
            raise InputError(f"{path} names no field: [{key}] stands behind {validate.show(part)}, which has no entries")
        if key >= len(part):
            raise InputError(f"{path} names no field: it has {validate.counted(len(part), 'entry')}, counted from 0")
        entries = list(part)
        entries[key] = _put(path, part[key], rest, value)
        return np.array(entries) if isinstance(part, np.ndarray) else type(part)(entries)
    names = [one.name for one in fields(part) if one.init] if is_dataclass(part) else []
    if isinstance(part, type) or key not in names:
        known = ", ".join(names) or "none"
        raise InputError(f"{path} names no field: {type(part).__name__} has no {key!r}; its fields are {known}")
    return replace(part, **{key: _put(path, vars(part)[key], rest, value)})


def _number(path: FieldPath, old: Any, value: float) -> float:
    if isinstance(old, (bool, str)) or not isinstance(old, (int, float, np.integer, np.floating, type(None))):
        raise InputError(f"{path} is {validate.show(old)}, not one number, and can't be varied")
    return int(value) if isinstance(old, (int, np.integer)) and value.is_integer() else value
