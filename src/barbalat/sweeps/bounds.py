"""Guarantees for members before they run: the bound on the error from a certificate, if one holds for all of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from barbalat.certificates.certify import certify
from barbalat.open_numbers.truth_paths import is_parameter
from barbalat.problem.known_set import KnownSet
from barbalat.problem.state_feedback import Problem
from barbalat.sweeps.study import Study
from barbalat.validate import Array

MOST_CERTIFIED = 64
"""Largest number of combinations of varied numbers other than theta that are certified, each in about a second."""
ERROR_BOUND = "error_bound"
"""A controller's column: the guaranteed bound on every |e|; NaN if there is none for the member."""


@dataclass(frozen=True, eq=False)
class _Certified:
    """The bound for one controller's members that differ only in theta (NaN if there is none), and its validity."""

    bound: float
    known: KnownSet | None
    for_its_theta: bool  # all members have the theta that was certified

    def holds(self, theta: Array) -> bool:
        return self.for_its_theta or (self.known is not None and self.known.contains(theta))


@dataclass(eq=False)
class Bounds:
    """The guaranteed ``error_bound`` of each member, over the whole known set if theta varies.

    A physical parameter that varies within its range moves theta within the set derived from it. A member whose theta is outside
    its known set has no bound. No member has a bound if the plan contains more than MOST_CERTIFIED combinations of the other
    numbers on which a controller depends. This is known before the sweep and does not depend on the order of the runs.
    """

    study: Study
    thetas: list[int] = field(init=False)
    parameters: list[int] = field(init=False)
    found: dict[tuple[int, bytes], _Certified] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        paths = self.study.plan.paths
        self.thetas = [i for i, path in enumerate(paths) if path.keys[:2] == ("plant", "theta")]
        apart = not self.study.varied.redesign
        self.parameters = [i for i, path in enumerate(paths) if apart and is_parameter(path)]

    def of(self, rows: Array) -> dict[str, Array]:
        """(M,) keyed by controller; rows (M, d)."""
        thetas = self._thetas(rows)
        return {name: self._of(place, rows, thetas) for place, name in enumerate(self.study.controllers)}

    @property
    def certificates(self) -> int:
        """The largest possible number of certificates: one for each controller and combination of the numbers other than theta
        on which it depends."""
        counts = (self._combinations(self._others(place)) for place in range(len(self.study.controllers)))
        return sum(count for count in counts if count <= MOST_CERTIFIED)

    @property
    def notes(self) -> list[str]:
        """Sentences on controllers whose errors are not compared with a bound, because too many numbers vary."""
        found = []
        for place, name in enumerate(self.study.controllers):
            count = self._combinations(self._others(place))
            if count > MOST_CERTIFIED:
                found.append(
                    f"{name}"
                    f": no bound is compared, since each of {count} combinations of numbers other than theta would need a "
                    f"separate certificate, but at most {MOST_CERTIFIED} are computed"
                )
        return found

    def _of(self, place: int, rows: Array, thetas: Array) -> Array:
        bounds, others = np.full(len(rows), np.nan), self._others(place)
        if self._combinations(others) > MOST_CERTIFIED:
            return bounds
        unique, which = np.unique(rows[:, others], axis=0, return_inverse=True)
        certified = [self._known(place, others, one) for one in unique]
        inside = self._in_ranges(rows)
        for member, (k, theta) in enumerate(zip(which.reshape(-1), thetas, strict=True)):
            if inside[member] and certified[k].holds(theta):
                bounds[member] = certified[k].bound
        return bounds

    def _others(self, place: int) -> list[int]:
        """Columns other than theta on which the loop of this controller depends, without the columns of other controllers."""
        paths = self.study.plan.paths
        concerned = (path.keys[0] != "controller" or path.keys[1] == place for path in paths)
        return [i for i, concerns in enumerate(concerned) if concerns and i not in (*self.thetas, *self.parameters)]

    def _in_ranges(self, rows: Array) -> Array:
        """(M,) whether the varied physical parameters are in the ranges from which the known set follows."""
        problem = self.study.example.problem
        inside = np.ones(len(rows), dtype=bool)
        for column in self.parameters:
            assert isinstance(problem, Problem) and problem.plant.physical is not None
            low, high = problem.plant.physical.ranges[str(self.study.plan.paths[column].keys[-1])]
            inside &= (low <= rows[:, column]) & (rows[:, column] <= high)
        return inside

    def _combinations(self, others: list[int]) -> int:
        """The number of distinct combinations; random draws count as distinct."""
        plan = self.study.plan
        varied = {plan.paths[i] for i in others}
        points = math.prod(axis.count for path, axis in plan.axes.items() if path in varied)
        return points * (plan.draws_each if varied & plan.draws.keys() else 1)

    def _known(self, place: int, others: list[int], values: Array) -> _Certified:
        key = place, values.tobytes()
        if key not in self.found:
            self.found[key] = self._certified(place, others, values)
        return self.found[key]

    def _certified(self, place: int, others: list[int], values: Array) -> _Certified:
        row = self.study.tried.middle.copy()
        row[others] = values
        case = self.study.varied.at(row)
        key = "error_bound_worst" if self.thetas or self.parameters else "error_bound"
        (certificate,) = certify(case.problem, [case.controllers[place]], case.simulation, keys=(key,)).values()
        entry = certificate.entry(key)
        known = case.problem.uncertainty if isinstance(case.problem, Problem) else None
        bound = np.nan
        if entry is not None and entry.kind == "guaranteed" and isinstance(entry.value, float):
            bound = entry.value
        return _Certified(bound, known, for_its_theta=not self.thetas)

    def _thetas(self, rows: Array) -> Array:
        """(M, n) each member's theta; n = 0 if theta does not vary."""
        problem = self.study.example.problem
        if not self.thetas or not isinstance(problem, Problem):
            return np.zeros((len(rows), 0))
        thetas = np.tile(problem.plant.theta, (len(rows), 1))
        for column in self.thetas:
            place, *of_input = map(int, self.study.plan.paths[column].keys[2:])  # theta row by row, in the order of the plant
            thetas[:, place * problem.plant.inputs + of_input[0] if of_input else place] = rows[:, column]
        return thetas
