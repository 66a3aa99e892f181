"""What a tuning is for: one quantity, under constraints, over plants of the known set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from barbalat import validate
from barbalat.cases.build import Case
from barbalat.open_numbers.path import by_index
from barbalat.problem.labels import Labels
from barbalat.problem.modelling_error import DelayError, ModellingError
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.study.delay_search import LONGEST_DELAY
from barbalat.study.tradeoff import plants_of
from barbalat.tuning.quantity import Constraint, Origin, TunedQuantity
from barbalat.validate import InputError

DEFAULT_PLANTS = 4
"""The case's own and three more, as in a trade-off."""


@dataclass(frozen=True, kw_only=True)
class Aim:
    """quantity is made small, or large with ``maximize``; the constraints are kept.

    plants    the case's own and ``plants`` - 1 others of its known set, drawn by ``seed``; its own alone where there is none
    quantile  of the plants on which a constraint is kept and the quantity is reached: 1, the worst of them, by default
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
        """The aim that a person writes; components may go by their ``labels``."""
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
        """Of a certificate, those that are asked for."""
        return frozenset(one.key for one in self.quantities if one.origin is Origin.CERTIFICATE)

    @property
    def errors(self) -> tuple[ModellingError, ...]:
        """With which runs are made, each once."""
        return tuple(dict.fromkeys(error for one in self.quantities for error in one.errors))

    def asks(self, origin: Origin) -> bool:
        return any(one.origin is origin for one in self.quantities)

    @property
    def longest(self) -> float:
        """Delay that is tried [s]."""
        delays = [one for one in self.constraints if DelayError() in one.quantity.errors]
        asked = [one.requirement.limit for one in delays]
        return max([LONGEST_DELAY, *asked])

    def signed(self, value: float) -> float:
        """The quantity as what is made small."""
        return -value if self.maximize else value

    def family(self, case: Case) -> list[TrackingProblem]:
        """The case's problem with each of the plants."""
        problem = case.problem
        if self.plants == 1 or not isinstance(problem, Problem) or problem.uncertainty is None:
            return [problem]
        return list(plants_of(problem, problem.uncertainty, self.plants, self.seed))
