"""A case with different numbers at some paths, in the tables of a case file or in Python objects."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.cases.build import Case
from barbalat.cases.load import CaseText, Variants
from barbalat.open_numbers import truth_paths
from barbalat.open_numbers.path import WRAPPED, FieldPath, Key, Tables, copied, wrapped_in
from barbalat.problem.observer import FixedObserver
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError


class Varied(ABC):
    """Base of both forms: the values at ``paths`` are given for each member."""

    paths: tuple[FieldPath, ...]
    """The paths of the varied numbers."""
    redesign: bool | None
    """Whether the design follows the plant's numbers (see ``truth_paths.put``)."""

    @property
    @abstractmethod
    def source(self) -> str:
        """The data with which a store is compared, in addition to the equations and their numbers."""

    @abstractmethod
    def at(self, values: Sequence[float] | Array) -> Case:
        """The case with these numbers, checked like any other; raises InputError if the case can't be used."""


@dataclass(frozen=True, eq=False)
class VariedObjects(Varied):
    """Fields of a problem, of its controllers and of the simulation, by name: ``controller[0].gamma``."""

    case: Case
    paths: tuple[FieldPath, ...]
    redesign: bool | None = None

    @classmethod
    def around(
        cls, problem: TrackingProblem, controller: Controller, simulation: Simulation, paths: tuple[FieldPath, ...] = ()
    ) -> VariedObjects:
        """One controller on a problem, whether or not there is a case file for it."""
        return cls(Case(problem, (controller,), simulation), paths)

    @property
    def source(self) -> str:
        return f"{self.case!r}"

    def standing(self, path: FieldPath) -> object:
        """The value of a field; None if there is no such field."""
        if truth_paths.is_parameter(path):
            problem = self.case.problem
            physical = problem.plant.physical if isinstance(problem, Problem) else None
            return None if physical is None else physical.nominal.get(str(path.keys[-1]))
        first, *rest = path.field
        apart = {"controller": self.case.controllers, "simulation": self.case.simulation}
        here: Any = apart.get(str(first), self.case.problem)
        try:
            for key in rest if first in apart else path.field:
                here = wrapped_in(here, key) or (here.design if isinstance(here, FixedObserver) else here)
                here = here[key] if isinstance(key, int) else vars(here)[key]
        except (LookupError, TypeError):
            return None
        return here

    def at(self, values: Sequence[float] | Array) -> Case:
        problem, controllers, simulation = self.case.problem, self.case.controllers, self.case.simulation
        own = truth_paths.own_keys(problem) if isinstance(problem, Problem) else frozenset()
        of: dict[str, list[Place]] = {"controller": [], "simulation": [], "problem": []}
        for path, value in zip(self.paths, map(float, values), strict=True):
            first, *rest = path.field
            moved = isinstance(problem, Problem) and truth_paths.placed(problem, path, value, redesign=self.redesign, own=own)
            if moved:
                problem = moved
            elif first in ("controller", "simulation"):
                of[str(first)].append((path, tuple(rest), value))
            else:
                of["problem"].append((path, path.field, value))
        controllers, simulation = _put(controllers, of["controller"]), _put(simulation, of["simulation"])
        problem = _put(problem, of["problem"])
        if self.redesign and isinstance(problem, Problem) and problem.fixed_observer is not None:
            problem = replace(problem, observer=problem.fixed_observer.design)
        return Case(problem, controllers, simulation, judge=self.case.judge)


Place = tuple[FieldPath, tuple[Key, ...], float]
"""The whole path of a number, its keys from some part on, and its value."""


def _put(part: Any, places: Sequence[Place]) -> Any:
    """A copy of a part with different numbers at some places, all passed to its constructors at once; raises InputError if one of
    these places contains no number."""
    if not places:
        return part
    for path, keys, value in places:
        if not keys:
            return _number(path, part, value)
    if isinstance(part, FixedObserver):
        return _put(part.design, places)  # the problem designs it again
    by_key: dict[Key, list[Place]] = {}
    for path, keys, value in places:
        by_key.setdefault(keys[0], []).append((path, keys, value))
    if isinstance(part, (tuple, list, np.ndarray)) or any(isinstance(key, int) for key in by_key):
        return _with_entries(part, by_key)
    changed: dict[str, Any] = {}
    within: list[Place] = []
    names = [one.name for one in fields(part) if one.init] if is_dataclass(part) else []
    for key, some in by_key.items():
        if not isinstance(part, type) and wrapped_in(part, key) is not None:
            within += some
        elif isinstance(part, type) or key not in names:
            known = ", ".join(names) or "none"
            raise InputError(f"{some[0][0]} does not name a field: {type(part).__name__} has no {key!r}; its fields are {known}")
        else:
            changed[str(key)] = _put(vars(part)[str(key)], [(path, keys[1:], value) for path, keys, value in some])
    if within:
        changed[WRAPPED] = _put(wrapped_in(part, within[0][1][0]), within)
    return replace(part, **changed)


def _with_entries(part: Any, by_key: dict[Key, list[Place]]) -> Any:
    entries = list(part) if isinstance(part, (tuple, list, np.ndarray)) else []
    for key, some in by_key.items():
        path = some[0][0]
        if not isinstance(part, (tuple, list, np.ndarray)):
            raise InputError(f"{path} does not name a field: [{key}] follows {validate.show(part)}, which has no entries")
        if not isinstance(key, int):
            raise InputError(f"{path} does not name a field: {type(part).__name__} has no {key!r}; it has no fields")
        if key >= len(part):
            raise InputError(f"{path} does not name a field: it has {validate.counted(len(part), 'entry')}, counted from 0")
        entries[key] = _put(part[key], [(path, keys[1:], value) for path, keys, value in some])
    return np.array(entries) if isinstance(part, np.ndarray) else type(part)(entries)


def _number(path: FieldPath, old: Any, value: float) -> float:
    if isinstance(old, (bool, str)) or not isinstance(old, (int, float, np.integer, np.floating, type(None))):
        raise InputError(f"{path} is {validate.show(old)}, not a single number, and cannot be varied")
    return int(value) if isinstance(old, (int, np.integer)) and value.is_integer() else value


@dataclass(frozen=True, eq=False)
class VariedCase(Varied):
    """The values at ``paths`` are given for each member; everything else comes from the file, or from the given ``tables``."""

    text: CaseText
    paths: tuple[FieldPath, ...]
    tables: Tables | None = None
    redesign: bool | None = None

    @property
    def source(self) -> str:
        return self.text.text + ("\n# redesigned for each member" if self.redesign else "")

    @cached_property
    def _tables(self) -> Tables:
        return tables_with(self.text, self.paths) if self.tables is None else self.tables

    def tables_at(self, values: Sequence[float] | Array) -> Tables:
        """The file's tables with these numbers; raises InputError for a path that leads nowhere."""
        return self._with(dict(zip(self.paths, map(float, values), strict=True)))

    def at(self, values: Sequence[float] | Array) -> Case:
        return self.with_numbers(dict(zip(self.paths, map(float, values), strict=True)))

    def with_numbers(self, numbers: Mapping[FieldPath, float]) -> Case:
        """The case with these numbers, checked like any other; raises InputError if the case can't be used."""
        if (moved := self._moved(numbers)) is not None:
            return moved
        if not self._variants:  # made with the first numbers, since the file may lack their tables
            self._variants.append(self.text.variants(self._with(numbers)))
        found = self._variants[0].at({path.keys: value for path, value in numbers.items()})
        return self.text.case(self._with(numbers)) if found is None else found

    def _moved(self, numbers: Mapping[FieldPath, float]) -> Case | None:
        """The case if it differs from the first case only in parameters of the truth, so that the design can be reused."""
        of_the_truth = bool(numbers) and all(map(truth_paths.is_parameter, numbers))
        if self.redesign or not of_the_truth:
            return None
        found = VariedObjects(self._unmoved, tuple(numbers), self.redesign).at(list(numbers.values()))
        return replace(found, equations=self._unmoved.equations)

    def _with(self, numbers: Mapping[FieldPath, float]) -> Tables:
        tables = copied(self._tables)
        own = truth_paths.own_keys(tables)
        for path, value in numbers.items():
            truth_paths.put(tables, path, value, redesign=self.redesign, own=own)
        return tables

    @cached_property
    def _unmoved(self) -> Case:
        """The case with the numbers in the tables."""
        return self.text.case(copied(self._tables))

    @cached_property
    def _variants(self) -> list[Variants]:
        """Empty until a case could be built."""
        return []


def tables_with(text: CaseText, paths: Iterable[FieldPath]) -> Tables:
    """The tables of a case file in a form that contains ``paths``.

    If one path is in theta and the plant is given by A, from which theta follows, then A is replaced by A_m and that theta.
    Raises InputError if A, or a number that follows from it, is to vary as well.
    """
    tables, paths = text.data(), tuple(paths)
    plant, model = tables.get("plant"), tables.get("reference_model")
    of_theta = [path for path in paths if path.keys[:2] == THETA]
    if not of_theta or not isinstance(plant, dict) or not isinstance(model, dict) or "A" not in plant:
        return tables
    if truth_paths.PARAMETERS in tables:
        raise InputError(
            f"{of_theta[0]} is not simulated, since theta follows from the parameters: vary these, such as "
            f"parameters.{next(iter(tables[truth_paths.PARAMETERS]), 'NAME')}=between"
        )
    if both := [path for path in paths if path.keys[:2] in MATCHED]:
        raise InputError(f"{both[0]} and {of_theta[0]} cannot both vary: with plant.A given, theta follows from it")
    problem = text.case().problem
    if isinstance(problem, Problem):
        plant |= {"A_m": problem.plant.A_m.tolist(), "theta": problem.plant.theta.tolist()}
        del plant["A"]
        tables["reference_model"] = {key: value for key, value in model.items() if key not in ("A_m", "poles")}
    return tables


THETA = ("plant", "theta")
MATCHED = (("plant", "A"), ("reference_model", "A_m"), ("reference_model", "poles"))
"""The keys from which theta follows in a file that gives plant.A."""
