"""Any controller as a flight computer runs it: measured at its sample times, its control held in between."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from barbalat import validate
from barbalat.controllers import l1, linear_feedback, mrac, robust_mrac
from barbalat.controllers.l1_sampled import Predictor
from barbalat.controllers.output import l1 as output_l1
from barbalat.controllers.output import linear as output_linear
from barbalat.controllers.output import mrac as output_mrac
from barbalat.controllers.output import mrac_sampled as output_midpoint
from barbalat.controllers.output.l1_sampled import OutputPredictor
from barbalat.controllers.robust_mrac_sampled import Estimator
from barbalat.controllers.tustin import Tustin
from barbalat.linear.systems import StateSpace
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Controller, Equations, Sample, SampledEquations, Value
from barbalat.validate import InputError

DISCRETIZATIONS = ("midpoint", "euler")


@dataclass(frozen=True, eq=False)
class Euler:
    """The continuous equations with explicit Euler steps from sample to sample: what is often done, and what chatters."""

    continuous: Equations
    sample_time: float

    def initial(self) -> NamedTuple:
        return self.continuous.initial()

    def control(self, state: Any, x: Value, x_m: Value, r: Value) -> Value:
        return self.continuous.control(state, x, x_m, r)

    def advance(self, state: Any, before: Sample, u: Value, now: Sample) -> Any:
        rates = self.continuous.derivative(state, *before, u)
        return self.continuous.limit(_moved(state, rates, self.sample_time))


def _moved(state: Any, rates: Any, T: float) -> Any:
    """state + T rates, through nested NamedTuples."""
    if not isinstance(state, tuple):
        return state + T * rates
    parts = [_moved(old, rate, T) for old, rate in zip(state, rates, strict=True)]
    return type(state)(*parts)


@dataclass(frozen=True, eq=False, kw_only=True)
class Sampled:
    """A controller that acts every ``sample_time`` and holds u in between, while the plant moves on.

    controller      any of the schemes
    sample_time     [s], a whole number of solver steps
    discretization  "midpoint", whose Lyapunov function no gain and no sample time can make grow (docs/sampled.md), or "euler"

    The MRAC's midpoint form has a predictor, as the L1-AC has, and is driven by the prediction error: in continuous time that
    predictor is the model, and sampled it stays with it to the order of sample_time. Raises InputError.
    """

    controller: Controller
    sample_time: float
    discretization: str = "midpoint"

    def __post_init__(self) -> None:
        if not isinstance(self.controller, Controller) or isinstance(self.controller, (type, Sampled)):
            raise InputError(f"controller must be a continuous controller, got {validate.show(self.controller)}")
        validate.freeze(self, sample_time=validate.positive("sample_time", self.sample_time))
        if self.discretization not in DISCRETIZATIONS:
            raise InputError(f"discretization must be 'midpoint' or 'euler', got {validate.show(self.discretization)}")

    @property
    def name(self) -> str:
        return self.controller.name

    @property
    def feedback(self) -> str:
        """What is fed back: "state" or "output"."""
        return getattr(self.controller, "feedback", "state")

    def bind(self, known: Known) -> SampledEquations:
        equations, T = self.controller.bind(known), self.sample_time
        if self.discretization == "euler":
            return Euler(equations, T)  # type: ignore[arg-type]
        match equations:
            case l1.Equations():
                return Predictor.of(equations, T)
            case mrac.Equations():
                return Predictor.of(_with_predictor(equations, known), T, equations.windup)
            case robust_mrac.Equations():
                return Estimator.of(equations, T)
            case output_l1.Equations():
                return OutputPredictor.of(equations, T)
            case output_mrac.Equations():
                return output_midpoint.OutputEstimator.of(equations, T)
            case linear_feedback.Equations() | output_linear.Equations():
                return Tustin.of(equations, T)
        raise InputError(f"discretization = 'midpoint' is not available for {self.name}; 'euler' is")


def _with_predictor(equations: mrac.Equations, known: Known) -> l1.Equations:
    """The MRAC as L1-AC with C = 1: its predictor is then the model, with ``limits`` the model adapted to them."""
    return l1.Equations(
        A_m=known.A_m,
        b=known.b,
        k_0=known.k_0,
        P=known.P,
        uncertainty=known.uncertainty,
        gamma=equations.gamma,
        C=StateSpace.gain(1.0),
        theta_hat0=equations.theta_hat0,
        x0=known.x0,
        box=equations.box,
        modifications=equations.modifications,
        limits=equations.limits,
    )
