"""A case file with other numbers at some of its places."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

from barbalat.cases.build import Case
from barbalat.cases.load import CaseText
from barbalat.open_numbers.path import FieldPath, Tables, copied
from barbalat.open_numbers.varied import Varied
from barbalat.problem.state_feedback import Problem
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
