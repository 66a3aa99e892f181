"""A case file with other numbers at some of its places."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from barbalat.cases.build import Case
from barbalat.cases.load import CaseText
from barbalat.problem.state_feedback import Problem
from barbalat.sweeps.known_set_draws import KNOWN_SET, over_known_set
from barbalat.sweeps.paths import FieldPath, Tables
from barbalat.sweeps.spread import Distribution, parse_distribution
from barbalat.sweeps.varied import Varied, VariedObjects
from barbalat.validate import Array, InputError


@dataclass(frozen=True, eq=False)
class VariedCase(Varied):
    """What stands at ``paths`` is given for each member; everything else is the file's."""

    text: CaseText
    paths: tuple[FieldPath, ...]

    @property
    def source(self) -> str:
        return self.text.text

    def at(self, values: Sequence[float] | Array) -> Case:
        """The case with these numbers, checked as any other; InputError where it can't be used."""
        return self.text.case(self.tables(values))

    def tables(self, values: Sequence[float] | Array) -> Tables:
        """Of the case file with these numbers."""
        tables = self._tables()
        for path, value in zip(self.paths, values, strict=True):
            path.put(tables, float(value))
        return tables

    def standing(self, path: FieldPath) -> object:
        """What the file has there; None where it has nothing."""
        return path.of(self._tables())

    def _tables(self) -> Tables:
        """A new copy."""
        return copy.deepcopy(self._given)

    @cached_property
    def _given(self) -> Tables:
        """As they are read, once."""
        return self.text.data() | self._by_theta()

    def _by_theta(self) -> Tables:
        """Plant and model by A_m and theta where the file has A, from which both follow, and theta varies."""
        tables = self.text.data()
        plant, model = (tables.get(name) for name in ("plant", "reference_model"))
        if not any(path.keys[:2] == THETA for path in self.paths) or not isinstance(plant, dict) or "A" not in plant:
            return {}
        if both := [str(path) for path in self.paths if path.keys[:2] in (("plant", "A"), *((MODEL, key) for key in FROM_A))]:
            raise InputError(f"{both[0]} and plant.theta can't both vary: theta follows from plant.A and the model's A_m")
        made = self.text.case().problem
        assert isinstance(made, Problem) and isinstance(model, dict)  # what has a plant.A
        theta = made.plant.theta if made.plant.inputs == 1 else made.plant.theta.reshape(-1, made.plant.inputs)
        by_theta = {key: value for key, value in plant.items() if key != "A"}
        by_theta |= {"A_m": made.plant.A_m.tolist(), "theta": theta.tolist()}
        return {"plant": by_theta, MODEL: {key: value for key, value in model.items() if key not in FROM_A}}


THETA = ("plant", "theta")
MODEL = "reference_model"
FROM_A = ("A_m", "poles")
"""Of the model, what goes with a plant's A."""


def sampled(source: CaseText | Case, given: Sequence[tuple[str, str | Distribution]]) -> dict[FieldPath, Distribution]:
    """Pairs of path and distribution; a vector over the case's known set becomes a distribution for each entry."""
    found: dict[FieldPath, Distribution] = {}
    for place, distribution in given:
        path = FieldPath.parse(place)
        if not isinstance(distribution, str):
            drawn: Mapping[FieldPath, Distribution] = {path: distribution}
        elif distribution == KNOWN_SET:
            drawn = _over_known_set(source, path)
        else:
            drawn = {path: _named(path, distribution)}
        if twice := [str(one) for one in drawn if one in found]:
            raise InputError(f"{twice[0]} is sampled twice")
        found |= drawn
    return found


def _over_known_set(source: CaseText | Case, path: FieldPath) -> Mapping[FieldPath, Distribution]:
    if isinstance(source, Case):
        return over_known_set(source, path, VariedObjects(source, (path,)).standing(path))
    return over_known_set(source.case(), path, VariedCase(source, (path,)).standing(path))


def _named(path: FieldPath, distribution: str) -> Distribution:
    try:
        return parse_distribution(distribution)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
