"""One tuning that was tried, and the plants on which tunings are judged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from barbalat.cases.build import Case
from barbalat.problem.tracking import TrackingProblem
from barbalat.run.metrics import Metrics
from barbalat.study.ideal_benchmark import Ideals
from barbalat.tuning.aim import Aim
from barbalat.tuning.quantity import Constraint, Origin
from barbalat.validate import Array


@dataclass(eq=False)
class Trial:
    """One tuning.

    value     the quantity; None where it was not looked at or the case can't be made
    found     of each constraint, as far as it was looked at
    complete  whether everything was
    refused   why no case can be made of it
    """

    row: Array
    case: Case | None = None
    value: float | None = None
    found: dict[Constraint, float | None] = field(default_factory=dict)
    score: float = np.inf
    complete: bool = False
    refused: str = ""
    undelayed: Metrics | None = None

    def meets(self, aim: Aim) -> bool:
        """Every constraint, and the quantity has a value."""
        whole = self.complete and self.value is not None and np.isfinite(self.value)
        return whole and all(one.holds(self.found[one]) for one in aim.constraints)


@dataclass(eq=False)
class Plants:
    """The problems on which a case's controller is judged."""

    problems: list[TrackingProblem]
    ideals: Ideals

    @classmethod
    def of(cls, case: Case, aim: Aim, problems: Sequence[TrackingProblem] | None = None) -> Plants:
        """Those of the aim, or others."""
        found = cls(aim.family(case) if problems is None else list(problems), Ideals.over(case.simulation, aim.longest))
        if aim.asks(Origin.DELAY):
            found.ideals.find(found.problems, range(len(found.problems)))
        return found
