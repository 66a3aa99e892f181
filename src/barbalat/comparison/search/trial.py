"""One tuning that was tried, and the plants on which tunings are judged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from barbalat.cases.build import Case
from barbalat.comparison.search.aim import Aim
from barbalat.comparison.search.quantity import Constraint
from barbalat.problem.modelling_error import DelayError, ModellingError
from barbalat.problem.tracking import TrackingProblem
from barbalat.run.kernel.metrics import Metrics
from barbalat.solvers.simulation import Simulation
from barbalat.study.delay_search import SCANNED_DELAYS, gains_scanned, scanned
from barbalat.study.ideal_benchmark import Ideals
from barbalat.validate import Array


@dataclass(eq=False)
class Trial:
    """One tuning.

    value     the quantity; None where it was not looked at or the case can't be made
    found     of each constraint, as far as it was looked at
    complete  whether everything was
    refused   why no case can be made of it
    undelayed, quiet  figures without a modelling error, on the plants and on those of the probes
    """

    row: Array
    case: Case | None = None
    value: float | None = None
    found: dict[Constraint, float | None] = field(default_factory=dict)
    score: float = np.inf
    complete: bool = False
    refused: str = ""
    undelayed: Metrics | None = None
    quiet: Metrics | None = None

    def meets(self, aim: Aim) -> bool:
        """Every constraint, and the quantity has a value."""
        whole = self.complete and self.value is not None and bool(np.isfinite(self.value))
        return whole and all(one.holds(self.found[one]) for one in aim.constraints)


@dataclass(eq=False)
class Plants:
    """The problems on which a case's controller is judged."""

    problems: list[TrackingProblem]
    ideals: dict[ModellingError, Ideals]
    longest: float

    @classmethod
    def of(
        cls,
        case: Case,
        aim: Aim,
        problems: Sequence[TrackingProblem] | None = None,
        sizes: Mapping[ModellingError, Array] | None = None,
    ) -> Plants:
        """Those of the aim, or others; for modelling errors of any size, or of these ``sizes`` alone."""
        given, simulation, longest = aim.family(case) if problems is None else list(problems), case.simulation, aim.longest
        if sizes is None:
            ideals = {error: _ideals(error, simulation, longest) for error in aim.errors}
        else:
            ideals = {error: Ideals(simulation, found, error) for error, found in sizes.items()}
        for one in ideals.values():
            one.find(given)
        return cls(given, ideals, longest)


def sizes_of(error: ModellingError, simulation: Simulation, longest: float) -> Array:
    """That are tried first: delays up to ``longest``, or factors on the gain."""
    return scanned(simulation, longest, SCANNED_DELAYS) if error == DelayError() else gains_scanned()


def _ideals(error: ModellingError, simulation: Simulation, longest: float) -> Ideals:
    if error == DelayError():
        return Ideals.over(simulation, longest)
    sizes = gains_scanned()
    return Ideals(simulation, np.geomspace(sizes[0], sizes[-1], GAINS_EXPLAINED), error)


GAINS_EXPLAINED = 16
"""Factors with which the loop that knows theta is run, 40 % apart: its error bends less than over the delays."""
