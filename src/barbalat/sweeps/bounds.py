"""What is guaranteed of members before they run: a certificate's bound on the error, where one holds for all of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from barbalat.certificates.certify import certify
from barbalat.problem.known_set import KnownSet
from barbalat.problem.state_feedback import Problem
from barbalat.sweeps.study import Study
from barbalat.validate import Array

MOST_CERTIFIED = 64
"""Combinations of what varies besides theta that are certified, each in about a second."""
ERROR_BOUND = "error_bound"
"""A controller's column: the guaranteed bound of every |e|; NaN where none is guaranteed of that member."""


@dataclass(frozen=True, eq=False)
class _Certified:
    """Of members that differ in theta alone: bounds by controllers, and where they hold."""

    bounds: dict[str, float]
    known: KnownSet | None
    for_its_theta: bool  # theta is the same for all and was certified

    def holds(self, theta: Array) -> bool:
        return self.for_its_theta or (self.known is not None and self.known.contains(theta))


@dataclass(eq=False)
class Bounds:
    """Of each member the guaranteed ``error_bound``, over all of the known set where theta varies.

    A member whose theta lies outside of its own known set has none, nor has any where the plan has more than MOST_CERTIFIED
    combinations of other numbers: that is known before anything runs, whoever runs what first.
    """

    study: Study
    thetas: list[int] = field(init=False)
    others: list[int] = field(init=False)
    found: dict[bytes, _Certified] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        paths = self.study.plan.paths
        self.thetas = [i for i, path in enumerate(paths) if path.keys[:2] == ("plant", "theta")]
        self.others = [i for i in range(len(paths)) if i not in self.thetas]

    @cached_property
    def _too_many(self) -> bool:
        """Draws count as different from each other."""
        plan = self.study.plan
        others = {plan.paths[i] for i in self.others}
        points = math.prod(axis.count for path, axis in plan.axes.items() if path in others)
        return points * (plan.draws_each if others & plan.draws.keys() else 1) > MOST_CERTIFIED

    def of(self, rows: Array) -> dict[str, Array]:
        """(M,) by controllers; rows (M, d)."""
        none = {name: np.full(len(rows), np.nan) for name in self.study.controllers}
        if self._too_many:
            return none
        unique, which = np.unique(rows[:, self.others], axis=0, return_inverse=True)
        for one in unique:
            if one.tobytes() not in self.found:
                self.found[one.tobytes()] = self._certified(one)
        certified, which = [self.found[one.tobytes()] for one in unique], which.reshape(-1)
        inside = np.array([certified[k].holds(theta) for k, theta in zip(which, self._thetas(rows), strict=True)], dtype=bool)
        for name, values in none.items():
            bound = np.array([one.bounds.get(name, np.nan) for one in certified])[which]
            values[inside] = bound[inside]
        return none

    def _certified(self, others: Array) -> _Certified:
        row = self.study.tried.middle.copy()
        row[self.others] = others
        case = self.study.varied.at(row)
        key = "error_bound_worst" if self.thetas else "error_bound"
        certificates = certify(case.problem, case.controllers, case.simulation)
        found = {name: one.entry(key) for name, one in certificates.items()}
        bounds = {
            name: float(entry.value)
            for name, entry in found.items()
            if entry is not None and entry.kind == "guaranteed" and isinstance(entry.value, float)
        }
        known = case.problem.uncertainty if isinstance(case.problem, Problem) else None
        return _Certified(bounds, known, for_its_theta=not self.thetas)

    def _thetas(self, rows: Array) -> Array:
        """(M, n) each member's theta; n = 0 where none varies."""
        problem = self.study.example.problem
        if not self.thetas or not isinstance(problem, Problem):
            return np.zeros((len(rows), 0))
        thetas = np.tile(problem.plant.theta, (len(rows), 1))
        for column in self.thetas:
            place, *of_input = map(int, self.study.plan.paths[column].keys[2:])  # theta row by row, as the plant stores it
            thetas[:, place * problem.plant.inputs + of_input[0] if of_input else place] = rows[:, column]
        return thetas
