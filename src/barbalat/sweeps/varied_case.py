"""A case file with other numbers at some of its places."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from barbalat.cases.build import Case
from barbalat.cases.load import CaseText
from barbalat.problem.state_feedback import Problem
from barbalat.sweeps.known_set_draws import KNOWN_SET, over_known_set
from barbalat.sweeps.paths import FieldPath, Tables, copied
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

    @cached_property
    def _tables(self) -> Tables:
        return tables_with(self.text, self.paths)

    def tables_at(self, values: Sequence[float] | Array) -> Tables:
        """The file's tables with these numbers; InputError for a path that leads to none."""
        tables = copied(self._tables)
        for path, value in zip(self.paths, values, strict=True):
            path.put(tables, float(value))
        return tables

    def at(self, values: Sequence[float] | Array) -> Case:
        """The case with these numbers, checked as any other; InputError where it can't be used."""
        return self.text.case(self.tables_at(values))


def tables_with(text: CaseText, paths: Iterable[FieldPath]) -> Tables:
    """A case file's tables, in which ``paths`` stand.

    Where one of them is of theta and the plant is given by A, which theta follows from, A_m and that theta stand there instead.
    InputError where A, or what the model makes of it, is to vary as well.
    """
    tables, paths = text.data(), tuple(paths)
    plant, model = tables.get("plant"), tables.get("reference_model")
    of_theta = [path for path in paths if path.keys[:2] == THETA]
    if not of_theta or not isinstance(plant, dict) or not isinstance(model, dict) or "A" not in plant:
        return tables
    if both := [path for path in paths if path.keys[:2] in MATCHED]:
        raise InputError(f"{both[0]} and {of_theta[0]} can't both vary: with plant.A given, theta is what follows from it")
    problem = text.case().problem
    if isinstance(problem, Problem):
        plant |= {"A_m": problem.plant.A_m.tolist(), "theta": problem.plant.theta.tolist()}
        del plant["A"]
        tables["reference_model"] = {key: value for key, value in model.items() if key not in ("A_m", "poles")}
    return tables


THETA = ("plant", "theta")
MATCHED = (("plant", "A"), ("reference_model", "A_m"), ("reference_model", "poles"))
"""From which theta follows in a file that gives plant.A."""


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
    return over_known_set(source.case(), path, path.of(tables_with(source, [path])))


def _named(path: FieldPath, distribution: str) -> Distribution:
    try:
        return parse_distribution(distribution)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
