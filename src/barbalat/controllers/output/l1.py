"""The L1 output-feedback controller (19)-(21), and the linear controller to which it reduces inside its projection bounds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np

from barbalat import validate
from barbalat.controllers.l1 import require_low_pass
from barbalat.controllers.settings import Scheme
from barbalat.controllers.steps import Filter, SampledForm
from barbalat.linear.systems import StateSpace, TransferFunction, strictly_proper
from barbalat.problem.known_set import ParameterBox, limit, project
from barbalat.problem.output_feedback import OutputKnown
from barbalat.protocols import Sample, Value, kept
from barbalat.validate import InputError


@dataclass(frozen=True, eq=False)
class OutputPredictor(SampledForm):
    """Equation (21) as one implicit step of predictor and sigma, which exists for every gamma and T; the predictor receives sigma
    after projection.

    With y_next = y + T (-m y_mid + m (u + s) + w), where sigma estimates s, y_tilde = y - y_hat and sigma_tilde = sigma - s, V =
    y_tilde^2 + m sigma_tilde^2/gamma changes by at most -2 m T y_tilde^2 + 2 T y_tilde w, with y_tilde at the end of the sample.
    """

    continuous: Equations
    sample_time: float
    filter: Filter
    frozen: Value = None  # where it is true, sigma is held; None: never

    explicit: ClassVar[bool] = False

    @classmethod
    def of(cls, equations: Equations, T: float) -> OutputPredictor:
        return cls(equations, T, Filter.of(equations.C, T))

    def freezing(self, frozen: Value) -> OutputPredictor:
        return replace(self, frozen=frozen)

    def advance(self, state: State, before: Sample, u: Value, now: Sample) -> State:
        c, T, m = self.continuous, self.sample_time, self.continuous.m
        end = 1 / (1 + m * T)
        at_rest = end * (state.y_hat + T * m * ((now.x - before.x) / 2 + u + state.theta_hat))  # y_hat if sigma did not change
        moved = T * c.gamma * (now.x - at_rest) / (1 + T**2 * m * c.gamma * end)
        sigma = kept(self.frozen, state.theta_hat, limit(state.theta_hat + moved, c.estimate_set))
        y_hat = at_rest + end * T * m * (sigma - state.theta_hat)
        wanted = before.r - state.theta_hat[0], now.r - sigma[0]
        return state._replace(theta_hat=sigma, y_hat=y_hat, filter=self.filter.end(state.filter, *wanted))


class State(NamedTuple):
    """The controller's states."""

    theta_hat: Value  # (1,) sigma, the estimate of the difference between plant and model at the input
    y_hat: Value  # (1,) predictor
    filter: Value  # (order of C,)


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations:
    """The law is driven by the prediction error."""

    m: float
    gamma: float
    C: StateSpace
    estimate_set: ParameterBox | None

    def initial(self) -> State:
        return State(np.zeros(1), np.zeros(1), np.zeros(self.C.order))

    def control(self, state: State, y: Value, y_m: Value, r: Value) -> Value:
        return self.C.output(state.filter, r - state.theta_hat[0])  # (21)

    def derivative(self, state: State, y: Value, y_m: Value, r: Value, u: Value) -> State:
        return State(
            theta_hat=project(self.gamma * (y - state.y_hat), state.theta_hat, self.estimate_set),  # (21)
            y_hat=-self.m * state.y_hat + self.m * (u + state.theta_hat),  # (21)
            filter=self.C.derivative(state.filter, r - state.theta_hat[0]),
        )

    def limit(self, state: State) -> State:
        return state._replace(theta_hat=limit(state.theta_hat, self.estimate_set))

    def sampled(self, T: float) -> OutputPredictor:
        return OutputPredictor.of(self, T)


@dataclass(frozen=True, eq=False, kw_only=True)
class L1Output(Scheme):
    """u = C(s)[r - sigma], sigma' = proj(gamma (y - y_hat)), y_hat' = -m y_hat + m (u + sigma).

    m             pole of the model m/(s + m) [rad/s], > 0; the problem's reference model must be the same
    gamma         adaptive gain > 0
    filter        C(s): stable, strictly proper, C(0) = 1; starts at rest
    sigma_bound   |sigma| <= sigma_bound by projection, > 0; unbounded by default
    lipschitz     L of condition (20), used only by certificates; by default the slope found for f, or 0 without f
    design_plant  G(s) that the design assumes, for certificates; the plant itself by default

    Source: eqs (18)-(21); Cao and Hovakimyan, IEEE TAC 54(4), 2009; Hovakimyan and Cao, section 4.1.
    """

    m: float
    gamma: float
    filter: TransferFunction
    sigma_bound: float | None = None
    lipschitz: float | None = None
    design_plant: TransferFunction | None = None
    name: str = "L1 output"

    feedback: ClassVar[str] = "output"

    def __post_init__(self) -> None:
        validate.label("name", self.name)
        validate.freeze(
            self,
            m=validate.positive("m", self.m),
            gamma=validate.positive("gamma", self.gamma),
            filter=require_low_pass(TransferFunction.accept("filter", self.filter)),
        )
        if self.lipschitz is not None:
            validate.freeze(self, lipschitz=validate.not_negative("lipschitz", self.lipschitz))
        if self.sigma_bound is not None:
            validate.freeze(self, sigma_bound=validate.positive("sigma_bound", self.sigma_bound))
        if self.design_plant is not None:
            validate.freeze(self, design_plant=strictly_proper("design_plant", self.design_plant))

    def bind(self, known: OutputKnown) -> Equations:
        if not np.allclose(
            known.W_m.at(np.array([0.0, 1j * self.m])), self.G_m.at(np.array([0.0, 1j * self.m])), rtol=1e-9, atol=0
        ):
            raise InputError(
                f"the reference model must be m/(s + m) with m = {self.m:g}, got num = {validate.show(known.W_m.num)}, "
                f"den = {validate.show(known.W_m.den)}; l1-output-piecewise takes models of any order"
            )
        bound = self.sigma_bound
        estimate_set = None if bound is None else ParameterBox(lower=[-bound], upper=[bound])
        return Equations(m=self.m, gamma=self.gamma, C=self.filter.realise(), estimate_set=estimate_set)

    @property
    def G_m(self) -> TransferFunction:
        """The first-order reference model (19)."""
        return TransferFunction([self.m], [1.0, self.m])


class LinearEquivalent(NamedTuple):
    """u = feedforward[r] - feedback[y], with one denominator; a pole at s = 0 is the integral action."""

    feedforward: TransferFunction
    feedback: TransferFunction


def linear_equivalent(controller: L1Output) -> LinearEquivalent:
    """The linear controller to which the scheme reduces while sigma is inside its bounds.

    sigma = [gamma (s + m) y - gamma m u]/(s^2 + m s + gamma m) in u = C[r - sigma], C = N/D, gives
    u = N [(s^2 + m s + gamma m) r - gamma (s + m) y]/[(s^2 + m s + gamma m) D - gamma m N].
    """
    N, D, m, gamma = controller.filter.num, controller.filter.den, controller.m, controller.gamma
    observer = np.array([1.0, m, gamma * m])
    den = np.polysub(np.polymul(observer, D), gamma * m * N)
    den[-1] = 0.0  # C(0) = 1: the constant terms are equal, and their difference is rounding
    return LinearEquivalent(
        TransferFunction(np.polymul(observer, N), den), TransferFunction(gamma * np.polymul([1.0, m], N), den)
    )


def fast_limit(controller: L1Output) -> LinearEquivalent:
    """Return the limit of the controller for gamma -> infinity: u = C/((1 - C) G_m) [G_m r - y]."""
    N, D, m = controller.filter.num, controller.filter.den, controller.m
    den = np.polysub(D, N)
    den[-1] = 0.0
    return LinearEquivalent(TransferFunction(N, den), TransferFunction(np.polymul([1.0 / m, 1.0], N), den))
