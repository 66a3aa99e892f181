"""L1 output feedback with the piecewise-constant law, for a stable, minimum-phase model of any order; always sampled.

One output determines x_hat - x in one direction only; the law acts only in this direction g, which satisfies c'g = 1. With A_m'P
+ P A_m = -I and g = P^-1 c/(c'P^-1 c), x_tilde - g c'x_tilde minimises the norm given by P, so the prediction error decreases at
every sample time. Without uncertainty, x_tilde[k+1] = e^(A_m T) (I - g c') x_tilde[k].
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np

from barbalat import validate
from barbalat.controllers.l1 import require_low_pass
from barbalat.controllers.l1_piecewise import PATENT_NOTE, input_directions
from barbalat.controllers.piecewise_filter import FilterStep, filter_step
from barbalat.controllers.piecewise_predictor import SPAN, memory_of, next_span, shared
from barbalat.controllers.settings import Scheme
from barbalat.controllers.tuning_grid import OutputTuningScale, TuningGrid
from barbalat.controllers.windup import applied, limits_of_predictor
from barbalat.linear.systems import StateSpace, TransferFunction, input_filter
from barbalat.linear.zero_order_hold import HeldSystem
from barbalat.problem.output_feedback import OutputKnown
from barbalat.protocols import Sample, Value, kept
from barbalat.roles import Role
from barbalat.validate import Array, InputError


class State(NamedTuple):
    """The discrete-time states; no parameter is estimated."""

    theta_hat: Value  # (0,)
    x_hat: Value  # (n,) predictor, in the coordinates of the model's controllable form
    sigma_hat: Value  # (n,) the uncertainty: at the input, and in the remaining directions
    filter: Value  # states of C(s), and of the inverse of the model
    span: Value  # () samples over which y_hat - y accumulates: 1 unless measurements are missed


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations:
    """The discrete-time equations; B = [b, b_um]."""

    sample_time: float
    model: HeldSystem  # over a sample, with B
    c: Array  # (n,)
    G: Array  # (n,): sigma_hat = -G (y_hat - y)
    g: Array  # (n,), c'g = 1: the direction in which the law corrects x_hat
    memory: float  # decay of the model per sample: its spectral radius
    filter: FilterStep
    limits: Array | None = None  # limits of the input, if the predictor receives sat(u)
    frozen: Value = None  # where it is true, sigma_hat is held; None: never

    roles: ClassVar[Mapping[str, Role]] = {
        "sigma_hat": Role.estimates("sigma", meaning="sigma_hat, the total disturbance of the plant"),
        "span": SPAN,
    }

    def initial(self) -> State:
        n = len(self.c)
        return State(np.zeros(0), np.zeros(n), np.zeros(n), np.zeros(len(self.filter.A)), np.ones(()))

    def control(self, state: State, y: Value, y_m: Value, r: Value) -> Value:
        return self.filter.output(state.filter, self._filtered(state.sigma_hat, r))[0]

    def advance(self, state: State, before: Sample, u: Value, now: Sample) -> State:
        acting = np.concatenate([applied(u, self.limits).reshape(1) + state.sigma_hat[:1], state.sigma_hat[1:]])
        x_hat = self.model.Phi @ state.x_hat + self.model.Gamma @ acting
        if self.frozen is not None:
            x_hat = kept(self.frozen, x_hat, kept(state.span > 1, self._measured_again(state, x_hat, now.x), x_hat))
        sigma_hat = kept(self.frozen, state.sigma_hat, -self.G * (self.c @ x_hat - now.x))
        wanted = self._filtered(state.sigma_hat, before.r), self._filtered(sigma_hat, now.r)
        span = next_span(self.frozen, state.span, self.memory)
        return State(state.theta_hat, x_hat, sigma_hat, self.filter.end(state.filter, *wanted), span)

    def _measured_again(self, state: State, x_hat: Value, y: Value) -> Value:
        """x_hat at the first measurement after missed ones, shifted so that y_hat - y is one sample's fraction of the error (see
        ``shared``)."""
        error, answered = self.c @ x_hat - y, -(self.G @ state.sigma_hat) / (self.G @ self.G)
        return x_hat + self.g * (shared(error, answered, state.span) - error)

    def freezing(self, frozen: Value) -> Equations:
        return replace(self, frozen=frozen)

    def _filtered(self, sigma_hat: Value, r: Value) -> Value:
        """The signals that pass through C(s): r - sigma_hat at the input, and the unmatched sigma_hat."""
        return np.concatenate([(r - sigma_hat[0]).reshape(1), sigma_hat[1:]])


@dataclass(frozen=True, eq=False)
class L1OutputPiecewiseConstant(Scheme):
    """u = C(s)[r - M(s)^-1 c'(sI - A_m)^-1 B sigma_hat], M = c'(sI - A_m)^-1 b the reference model, of any order.

    Predictor x_hat' = A_m x_hat + b u + B sigma_hat, exact at the samples; at each sample sigma_hat = -B^-1 Phi^-1 e^(A_m T) g
    (c'x_hat - y), Phi = A_m^-1 (e^(A_m T) - I), g = P^-1 c/(c'P^-1 c), A_m'P + P A_m = -I.

    sample_time  T [s]; a whole number of solver steps if these are fixed
    filter       C(s): stable, C(0) = 1, with a relative degree that is not below the model's; discretised by the trapezoidal
                 rule; starts at rest
    saturated_predictor  against windup: the predictor receives sat(u); off by default

    Source: Hovakimyan and Cao, L1 Adaptive Control Theory (2010), section 4.2; Cao and Hovakimyan, J. Guidance, Control, and
    Dynamics 32(3), 2009.
    """

    sample_time: float
    filter: TransferFunction
    _: KW_ONLY
    saturated_predictor: bool = False
    name: str = "L1 output, piecewise"

    feedback: ClassVar[str] = "output"
    patent: ClassVar[str] = PATENT_NOTE

    def __post_init__(self) -> None:
        validate.label("name", self.name)
        if self.filter is None:
            raise InputError.of(
                "filter",
                "must be a low-pass filter whose relative degree is at least that of the model, which rules out C = 1 "
                "(kappa = 0)",
            )
        validate.freeze(
            self,
            sample_time=validate.positive("sample_time", self.sample_time),
            filter=require_low_pass(TransferFunction.accept("filter", self.filter)),
        )

    @classmethod
    def output_knobs(cls, reach: OutputTuningScale) -> TuningGrid:
        T, order = reach.sample_time, reach.known.W_m.relative_degree
        return TuningGrid(
            scheme="L1 output, piecewise",
            values={"kappa": reach.times[reach.times >= T]},
            make=lambda kappa: cls(sample_time=T, filter=input_filter(kappa, order), saturated_predictor=reach.saturated),
            aims=("error_bound",),
        )

    def bind(self, known: OutputKnown) -> Equations:
        needed = known.W_m.relative_degree
        if self.filter.relative_degree < needed:
            raise InputError(
                f"filter must have a relative degree of at least {needed}, the reference model's: C(s) W_m(s)^-1 must be proper, "
                f"got {self.filter.relative_degree}"
            )
        model = known.W_m.realise()
        B, T = input_directions(model.B[:, None]), self.sample_time
        held, g = HeldSystem.of(model.A, B, T), observed_direction(model)
        return Equations(
            sample_time=T,
            model=held,
            c=model.C,
            G=np.linalg.solve(held.Gamma, held.Phi @ g),
            g=g,
            memory=memory_of(model.A, T),
            filter=filter_step(model.A, B, 1, self.filter, model.C[None], T),
            limits=limits_of_predictor(self.saturated_predictor, known),
        )


def observed_direction(model: StateSpace) -> Array:
    """g = P^-1 c/(c'P^-1 c)."""
    from scipy.linalg import solve_continuous_lyapunov

    P = solve_continuous_lyapunov(model.A.T, -np.eye(model.order))
    g = np.linalg.solve(P, model.C)
    return np.asarray(g / (model.C @ g))
