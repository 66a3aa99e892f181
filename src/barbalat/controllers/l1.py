"""L1 adaptive control for measured states: eqs (5)-(8), an MRAC whose control passes a low-pass filter C(s)."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field
from typing import Any, NamedTuple

import numpy as np

from barbalat import validate
from barbalat.adaptation.learning import CompositeLearning
from barbalat.adaptation.lyapunov import Modifications
from barbalat.adaptation.modifications.dead_zone import DeadZone
from barbalat.adaptation.modifications.leakage import Leakage
from barbalat.controllers.knobs import Knobs, Reach
from barbalat.controllers.l1_sampled import Predictor
from barbalat.controllers.settings import Scheme, check_common, initial_estimate, projection_box
from barbalat.controllers.windup import applied, limits_of_predictor
from barbalat.linear.systems import StateSpace, TransferFunction, input_filter
from barbalat.problem.known_set import EstimateSet, Gain, gain, limit
from barbalat.problem.regressors import Uncertainty
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Value
from barbalat.roles import Role, within
from barbalat.validate import Array, InputError, Vector


class State(NamedTuple):
    """What the controller integrates."""

    theta_hat: Value  # (p,) estimate of theta, and of omega where the input gain is unknown
    x_hat: Value  # (n,) predictor
    filter: Value  # (order of C,) state of the filter C(s); (order of C, m) with m inputs
    memory: Any = ()  # of composite learning


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations:
    """The law is driven by the prediction error."""

    A_m: Array
    b: Array
    k_0: Array | float
    P: Array
    uncertainty: Uncertainty
    gamma: Gain
    C: StateSpace
    theta_hat0: Array
    x0: Array
    box: EstimateSet | None
    modifications: Modifications = field(default_factory=Modifications)
    limits: Array | None = None  # of the input, where the predictor is fed with what is left of u

    @property
    def roles(self) -> dict[str, Role]:
        return within("memory", self.modifications)

    def initial(self) -> State:
        inputs = self.uncertainty.inputs
        at_rest = np.zeros(self.C.order if inputs == 1 else (self.C.order, inputs))
        return State(self.theta_hat0, self.x0, at_rest, self.modifications.initial(self.b, self.x0, len(self.theta_hat0)))

    def control(self, state: State, x: Value, x_m: Value, r: Value) -> Value:
        return self.C.output(state.filter, self.filter_input(state, x, r))  # (5)

    def filter_input(self, state: State, x: Value, r: Value) -> Value:
        """What C(s) filters. With an unknown gain u = C/(1 - C)[-theta_hat'phi - omega_hat u + k_0 r] stands for (5)."""
        theta_hat, omega_hat = self.uncertainty.split(state.theta_hat)
        wanted = -self.uncertainty.phi(x).T @ theta_hat + np.dot(self.k_0, r)
        if not self.uncertainty.gain_unknown:
            return wanted
        if self.C.order == 0:
            return wanted / omega_hat  # C = 1
        return wanted - omega_hat * self.C.output(state.filter, 0 * wanted)

    def applied(self, u: Value) -> Value:
        """What the predictor is fed with."""
        return applied(u, self.limits)

    def regressor_at(self, state: State, x: Value, u: Value) -> Value:
        return self.uncertainty.with_input(x, self.applied(u))

    def derivative(self, state: State, x: Value, x_m: Value, r: Value, u: Value) -> State:
        x_tilde = x - state.x_hat
        law, u = self.modifications, self.applied(u)
        phi, known = self.uncertainty.with_input(x, u), self.uncertainty.known_input(u)
        theta_hat_dot = law.rate(self.gamma, x_tilde, self.P, self.b, phi, state.theta_hat, state.memory, self.box)  # (7)
        x_hat_dot = self.A_m @ state.x_hat + np.dot(self.b, phi.T @ state.theta_hat + known)  # (8)
        filter_dot = self.C.derivative(state.filter, self.filter_input(state, x, r))
        return State(theta_hat_dot, x_hat_dot, filter_dot, law.memory_rates(state.memory, self.A_m, self.b, x, phi, known))

    def limit(self, state: State) -> State:
        return state._replace(theta_hat=limit(state.theta_hat, self.box))

    def sampled(self, T: float) -> Predictor:
        return Predictor.of(self, T)


@dataclass(frozen=True, eq=False)
class L1Adaptive(Scheme):
    """u = C(s)[-theta_hat'x + k_0 r], predictor x_hat, law theta_hat' = proj(Gamma (x_tilde'P b) x).

    gamma       adaptive gain Gamma > 0: a number, a diagonal (p,) or an s.p.d. matrix (p, p)
    filter      C(s): stable, strictly proper, C(0) = 1; starts at rest. ``None`` means C = 1, which is the standard MRAC
    theta_hat0  (p,), zero by default; inside the known set
    projection  onto the known set; by default on where one is given. An unknown input gain's estimate is always projected
    leakage, dead_zone  modifications of the law, none by default: see ``adaptation.lyapunov``
    learning    a memory of past data; none by default
    saturated_predictor  against windup: the predictor is fed with sat(u), times omega_hat where the input gain is unknown, so
                that x_tilde does not see the limit; off by default

    Source: eqs (5)-(8); Hovakimyan and Cao, L1 Adaptive Control Theory, section 2.1.
    """

    gamma: float | Array
    filter: TransferFunction | None
    _: KW_ONLY
    theta_hat0: Vector | None = None
    projection: bool | None = None
    leakage: Leakage | None = None
    dead_zone: DeadZone | None = None
    learning: CompositeLearning | None = None
    saturated_predictor: bool = False
    name: str = "L1"

    def __post_init__(self) -> None:
        check_common(self)
        object.__setattr__(self, "gamma", gain.accept("gamma", self.gamma))
        Modifications.of(self)  # refuses what can't go together
        if self.filter is not None:
            object.__setattr__(self, "filter", require_low_pass(TransferFunction.accept("filter", self.filter)))

    @classmethod
    def knobs(cls, reach: Reach) -> Knobs:
        return Knobs(
            scheme="L1-AC",
            values={"kappa": reach.times, "gamma": reach.gains(1e-7, reach.density)},
            make=lambda kappa, gamma: cls(
                gamma=gamma,
                filter=input_filter(kappa),
                theta_hat0=reach.theta_hat0,
                saturated_predictor=reach.saturated,
                name="L1-AC",
            ),
            aims=("condition", "error_bound"),
        )

    def bind(self, known: Known) -> Equations:
        gamma = Gain(self.gamma)
        gamma.require_size("gamma", known.parameters)
        modifications = Modifications.of(self)
        modifications.require_fit(known.inputs)
        box = projection_box(self.projection, known)
        return Equations(
            A_m=known.A_m,
            b=known.b,
            k_0=known.k_0,
            P=known.P,
            uncertainty=known.uncertainty,
            gamma=gamma,
            C=self._filter(unknown_gain=known.uncertainty.gain_unknown),
            theta_hat0=initial_estimate(self.theta_hat0, box, known),
            x0=known.x0,
            box=box,
            modifications=modifications,
            limits=limits_of_predictor(self.saturated_predictor, known),
        )

    def _filter(self, *, unknown_gain: bool) -> StateSpace:
        """C(s), or C/(1 - C), which is C with its output fed back to its input, around an unknown gain."""
        if self.filter is None:
            return StateSpace.gain(1.0)
        C = self.filter.realise()
        return StateSpace(C.A + np.outer(C.B, C.C), C.B, C.C, 0.0) if unknown_gain else C


def require_low_pass(C: TransferFunction) -> TransferFunction:
    """C(s) as the scheme asks for it: strictly proper, stable, C(0) = 1."""
    shown = f"num = {validate.show(C.num)}, den = {validate.show(C.den)}"
    if C.relative_degree < 1:
        raise InputError(f"filter must be strictly proper (degree of num below that of den), got {shown}")
    if not C.is_stable:
        raise InputError(f"filter must be stable, but a pole has real part {C.poles.real.max():.6g}: {shown}")
    if abs(C.dc_gain - 1) > 1e-9:  # coefficients are typed in decimal: a ratio of two of them carries that much
        raise InputError(f"filter must have unit DC gain, C(0) = 1, got {C.dc_gain:.9g}: {shown}")
    return C
