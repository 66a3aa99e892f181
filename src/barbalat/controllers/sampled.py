"""Any controller in the form for a flight computer, which measures at sample times and holds the control in between."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, replace
from typing import Any, ClassVar

from barbalat import validate
from barbalat.controllers.settings import Scheme
from barbalat.controllers.steps import SampledForm
from barbalat.protocols import Controller, Discretizable, Equations, Sample, SampledEquations, Value, feedback_of
from barbalat.validate import InputError

DISCRETIZATIONS = ("midpoint", "euler")


@dataclass(frozen=True, eq=False)
class Euler(SampledForm):
    """The continuous equations with an explicit Euler step per sample: a common choice, which may chatter."""

    continuous: Equations
    sample_time: float

    explicit: ClassVar[bool] = True

    def advance(self, state: Any, before: Sample, u: Value, now: Sample) -> Any:
        rates = self.continuous.derivative(state, *before, u)
        return self.continuous.limit(_moved(state, rates, self.sample_time))


def _moved(state: Any, rates: Any, T: float) -> Any:
    """Return state + T rates; nested NamedTuples are traversed."""
    if not isinstance(state, tuple):
        return state + T * rates
    parts = [_moved(old, rate, T) for old, rate in zip(state, rates, strict=True)]
    return type(state)(*parts)


@dataclass(frozen=True, eq=False)
class Sampled(Scheme):
    """A controller that acts every ``sample_time`` and holds u in between.

    controller      any scheme
    sample_time     [s]; a whole number of solver steps if these are fixed
    discretization  "midpoint", whose Lyapunov function does not grow for any gain or sample time (docs/sampled.md), or "euler"

    The midpoint form of MRAC has a predictor, as in L1-AC, and is driven by the prediction error. In continuous time that
    predictor is the model; in sampled form it agrees with the model to within an error of order sample_time. Raises InputError.
    """

    controller: Controller
    sample_time: float
    _: KW_ONLY
    discretization: str = "midpoint"

    def __post_init__(self) -> None:
        if not isinstance(self.controller, Controller) or isinstance(self.controller, (type, Sampled)):  # type: ignore[redundant-expr]
            raise InputError(f"controller must be a continuous controller, got {validate.show(self.controller)}")
        validate.freeze(self, sample_time=validate.positive("sample_time", self.sample_time))
        if self.discretization not in DISCRETIZATIONS:
            raise InputError(f"discretization must be 'midpoint' or 'euler', got {validate.show(self.discretization)}")

    @property
    def name(self) -> str:
        return self.controller.name

    @property
    def feedback(self) -> str:
        """The fed-back signal: "state" or "output"."""
        return feedback_of(self.controller)

    def bind(self, known: object) -> SampledEquations:
        equations, T = self.controller.bind(known), self.sample_time
        if isinstance(equations, SampledEquations):
            raise InputError(
                f"controller must be a continuous controller, but {self.name} is already sampled", controller=self.name
            )
        if self.discretization == "euler":
            return Euler(equations, T)
        if not isinstance(equations, Discretizable):
            raise InputError(
                f"discretization = 'midpoint' is not available for {self.name}: give discretization = 'euler'",
                controller=self.name,
            )
        return equations.sampled(T)

    @property
    def law_step(self) -> float | None:
        return self.sample_time if self.discretization == "euler" else None

    def refined(self, factor: int) -> Sampled:
        return replace(self, sample_time=self.sample_time / factor) if self.discretization == "euler" else self
