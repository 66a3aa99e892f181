"""The aim of a tuning, which is one quantity under constraints over plants of the known set, and the result of a trial."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.cases.build import Case
from barbalat.comparison.plants import one_plant_because, plants_of
from barbalat.comparison.search.quantity import LINEAR_DELAYS, Constraint, Origin, TunedQuantity
from barbalat.open_numbers.path import by_index
from barbalat.problem.labels import Labels
from barbalat.problem.modelling_error import DelayError, ModellingError
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.solvers.simulation import Simulation
from barbalat.study.delay_margin import SCANNED_DELAYS, gains_scanned, longest_delay, scanned
from barbalat.study.finer_step import PlainRun
from barbalat.study.ideal_benchmark import SIZES_TRIED, Ideals, Undelayed
from barbalat.validate import Array, InputError

DEFAULT_PLANTS = 4
"""Default number of plants: the plant of the case and three more, as in a trade-off."""


HELD_OUT_PLANTS = 32
"""Number of validation plants. If one plant in ten fails, the probability that no validation plant fails is 3 %."""


@dataclass(frozen=True, kw_only=True)
class Aim:
    """The aim of a tuning. The quantity is minimised, or maximised with ``maximize``, under the constraints.

    plants    number of plants: the plant of the case and others drawn from its known set with ``seed``; without a set, only the
              plant of the case
    quantile  fraction of the plants on which a constraint is met and the quantity is reached; by default 1, which means the worst
              plant
    """

    quantity: TunedQuantity
    maximize: bool = False
    constraints: tuple[Constraint, ...] = ()
    plants: int = DEFAULT_PLANTS
    quantile: float = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        validate.whole("plants", self.plants, least=1)
        validate.whole("seed", self.seed, least=0)
        if not 0 < validate.number("quantile", self.quantile) <= 1:
            raise InputError(f"quantile must be above 0 and at most 1, got {self.quantile:g}")

    @classmethod
    def of(
        cls,
        objective: str,
        subject_to: Sequence[str],
        *,
        maximize: bool,
        plants: int,
        quantile: float,
        seed: int,
        labels: Labels | None = None,
    ) -> Aim:
        """Parse the aim from a user's text. Components may be named by their ``labels``."""
        return cls(
            quantity=TunedQuantity(by_index(objective, labels), larger_is_worse=not maximize),
            maximize=maximize,
            constraints=tuple(Constraint.parse(by_index(text, labels)) for text in subject_to),
            plants=plants,
            quantile=quantile,
            seed=seed,
        )

    @property
    def quantities(self) -> tuple[TunedQuantity, ...]:
        return (self.quantity, *(one.quantity for one in self.constraints))

    @property
    def keys(self) -> frozenset[str]:
        """The required keys of a certificate."""
        return frozenset(one.key for one in self.quantities if one.origin is Origin.CERTIFICATE)

    @property
    def errors(self) -> tuple[ModellingError, ...]:
        """The modelling errors of the runs, without duplicates."""
        return tuple(dict.fromkeys(error for one in self.quantities for error in one.errors))

    def asks(self, origin: Origin) -> bool:
        return any(one.origin is origin for one in self.quantities)

    @property
    def asks_linear_delays(self) -> bool:
        """Whether a delay margin of a linear loop, which ignores limits, is required."""
        return any(key in LINEAR_DELAYS for key in self.keys)

    @property
    def longest(self) -> float:
        """The required delay [s], or 0."""
        delays = [one for one in self.constraints if DelayError() in one.quantity.errors]
        asked = [one.requirement.limit for one in delays]
        return max([0.0, *asked])

    def signed(self, value: float) -> float:
        """Return the quantity with the sign for minimisation."""
        return -value if self.maximize else value

    def family(self, case: Case) -> list[TrackingProblem]:
        """Return the problem of the case with each of the plants."""
        problem = case.problem
        if self.plants == 1 or not isinstance(problem, Problem) or problem.uncertainty is None:
            return [problem]
        return list(plants_of(problem, problem.uncertainty, self.plants, self.seed))

    def unseen(self, problem: TrackingProblem) -> list[Problem]:
        """Return the problem with validation plants, drawn with a different seed; none without a known set, or if the truth is a
        single plant."""
        if not isinstance(problem, Problem) or problem.uncertainty is None or one_plant_because(problem) is not None:
            return []
        return plants_of(problem, problem.uncertainty, HELD_OUT_PLANTS + 1, self.seed + 1)[1:]


@dataclass(eq=False)
class Trial:
    """One tuning.

    value     the quantity; None if it was not evaluated or the case cannot be built
    found     the value of each evaluated constraint
    complete  whether everything was evaluated
    refused   the reason why no case can be built
    undelayed  the runs on the plants, without a modelling error
    """

    row: Array
    case: Case | None = None
    value: float | None = None
    found: dict[Constraint, float | None] = field(default_factory=dict)
    score: float = np.inf
    complete: bool = False
    refused: str = ""
    undelayed: Undelayed | None = None

    def meets(self, aim: Aim) -> bool:
        """Return whether every constraint is met and the quantity has a value."""
        whole = self.complete and self.value is not None and bool(np.isfinite(self.value))
        return whole and all(one.holds(self.found[one]) for one in aim.constraints)


@dataclass(eq=False)
class Plants:
    """The problems on which the controller of a case is judged."""

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
        """Return the plants of the aim, or the given ones, for modelling errors of any size or only of these ``sizes``."""
        given, simulation = aim.family(case) if problems is None else list(problems), case.simulation
        longest = max(aim.longest, longest_delay(simulation))
        if sizes is None:
            ideals = {error: _ideals(error, simulation, longest) for error in (DelayError(), *aim.errors)}
        else:
            ideals = {error: Ideals(simulation, found, error) for error, found in sizes.items()}
        return cls(given, ideals, longest)


def sizes_of(error: ModellingError, simulation: Simulation, longest: float) -> Array:
    """Return the sizes that are tried first, which are delays up to ``longest`` or factors on the gain."""
    return scanned(simulation, longest, SCANNED_DELAYS) if error == DelayError() else gains_scanned()


def _ideals(error: ModellingError, simulation: Simulation, longest: float) -> Ideals:
    if error == DelayError():
        return Ideals.over(simulation, longest)
    sizes = gains_scanned()
    return Ideals(simulation, np.geomspace(sizes[0], sizes[-1], SIZES_TRIED), error)


@dataclass(frozen=True, kw_only=True)
class StepCheck:
    """The results for a tuning with the ``refined`` simulation, or with another one.

    how      the simulation in words
    value    the aim's metric with the finer step; None if no run gives it
    broken   sentences on constraints that are violated with the finer step
    changed  sentences on metrics that differ with the finer step
    plain    the run of the tuning without a modelling error, at the step of the case
    instead  why the simulation is not the one that was asked for, if it is not
    """

    simulation: Simulation
    how: str
    value: float | None
    broken: tuple[str, ...]
    changed: tuple[str, ...]
    plain: PlainRun
    instead: str | None = None

    @property
    def holds(self) -> bool:
        """Whether every constraint is met at the finer step too."""
        return not self.broken

    @property
    def sentences(self) -> list[str]:
        """Sentences on the limitations of the result. If nothing has changed, the first one says so."""
        said = [*self.broken, *self.changed]
        if not said and self.plain.settles:
            said = [f"{self.how} confirms it"]
        return [*said, *filter(None, [self.instead]), *self.plain.sentences]

    def as_json(self) -> dict[str, Any]:
        return {
            **self.simulation.step_as_json(),
            "value": self.value if self.value is not None and np.isfinite(self.value) else None,
            "holds": self.holds,
            "sentences": self.sentences,
            **self.plain.as_json(),
        }
