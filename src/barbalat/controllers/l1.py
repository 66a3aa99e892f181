"""L1 adaptive control for measured states: eqs (5)-(8), an MRAC whose control passes a low-pass filter C(s)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from barbalat import validate
from barbalat.adaptation.projection import limit, project
from barbalat.controllers.base import check_common, initial_estimate, projection_box
from barbalat.linear import StateSpace, TransferFunction
from barbalat.problem import Known, ParameterBox
from barbalat.protocols import Value
from barbalat.validate import Array, InputError


class State(NamedTuple):
    """What the controller integrates."""

    theta_hat: Value  # (n,) estimate of theta
    x_hat: Value  # (n,) predictor
    filter: Value  # (order of C,) state of the filter C(s)


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations:
    """The law is driven by the prediction error."""

    A_m: Array
    b: Array
    k_0: float
    P: Array
    gamma: float
    C: StateSpace
    theta_hat0: Array
    x0: Array
    box: ParameterBox | None

    def initial(self) -> State:
        return State(self.theta_hat0, self.x0, np.zeros(self.C.order))

    def control(self, state: State, x: Value, x_m: Value, r: Value) -> Value:
        return self.C.output(state.filter, self.unfiltered_control(state, x, r))  # (5)

    def unfiltered_control(self, state: State, x: Value, r: Value) -> Value:
        return -state.theta_hat @ x + self.k_0 * r

    def derivative(self, state: State, x: Value, x_m: Value, r: Value, u: Value) -> State:
        x_tilde = x - state.x_hat
        theta_hat_dot = project(self.gamma * (x_tilde @ (self.P @ self.b)) * x, state.theta_hat, self.box)  # (7)
        x_hat_dot = self.A_m @ state.x_hat + self.b * (state.theta_hat @ x + u)  # (8)
        filter_dot = self.C.derivative(state.filter, self.unfiltered_control(state, x, r))
        return State(theta_hat_dot, x_hat_dot, filter_dot)

    def limit(self, state: State) -> State:
        return state._replace(theta_hat=limit(state.theta_hat, self.box))


@dataclass(frozen=True, eq=False, kw_only=True)
class L1Adaptive:
    """u = C(s)[-theta_hat'x + k_0 r], predictor x_hat, law theta_hat' = proj(Gamma (x_tilde'P b) x).

    gamma       adaptive gain Gamma > 0, scalar
    filter      C(s): stable, strictly proper, C(0) = 1; starts at rest. ``None`` means C = 1, which is the standard MRAC
    theta_hat0  (n,), zero by default; inside the known set
    projection  onto the known set; by default on where one is given

    Source: eqs (5)-(8); Hovakimyan and Cao, L1 Adaptive Control Theory, section 2.1.
    """

    gamma: float
    filter: TransferFunction | None
    theta_hat0: Array | None = None
    projection: bool | None = None
    name: str = "L1"

    def __post_init__(self) -> None:
        check_common(self)
        object.__setattr__(self, "gamma", validate.positive("gamma", self.gamma))
        if self.filter is not None:
            object.__setattr__(self, "filter", _admissible(TransferFunction.accept("filter", self.filter)))

    def bind(self, known: Known) -> Equations:
        box = projection_box(self.projection, known)
        return Equations(
            A_m=known.A_m,
            b=known.b,
            k_0=known.k_0,
            P=known.P,
            gamma=self.gamma,
            C=StateSpace.gain(1.0) if self.filter is None else self.filter.realise(),
            theta_hat0=initial_estimate(self.theta_hat0, box, known.n),
            x0=known.x0,
            box=box,
        )


def _admissible(C: TransferFunction) -> TransferFunction:
    """C(s) as the scheme asks for it: strictly proper, stable, C(0) = 1."""
    shown = f"num = {validate.show(C.num)}, den = {validate.show(C.den)}"
    if C.relative_degree < 1:
        raise InputError(f"filter must be strictly proper (degree of num below that of den), got {shown}")
    if not C.is_stable:
        raise InputError(f"filter must be stable, but a pole has real part {C.poles.real.max():.6g}: {shown}")
    if abs(C.dc_gain - 1) > 1e-9:  # coefficients are typed in decimal: a ratio of two of them carries that much
        raise InputError(f"filter must have unit DC gain, C(0) = 1, got {C.dc_gain:.9g}: {shown}")
    return C
