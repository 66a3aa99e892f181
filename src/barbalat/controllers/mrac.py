"""Standard model reference adaptive control: eqs (3)-(4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from barbalat import validate
from barbalat.adaptation.projection import limit, project
from barbalat.controllers.base import check_common, initial_estimate, projection_box
from barbalat.problem import Known, ParameterBox
from barbalat.protocols import Value
from barbalat.validate import Array


class State(NamedTuple):
    """What the controller integrates."""

    theta_hat: Value  # (n,) estimate of theta


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations:
    """The law is driven by the tracking error."""

    b: Array
    k_0: float
    P: Array
    gamma: float
    theta_hat0: Array
    box: ParameterBox | None

    def initial(self) -> State:
        return State(self.theta_hat0)

    def control(self, state: State, x: Value, x_m: Value, r: Value) -> Value:
        return -state.theta_hat @ x + self.k_0 * r  # (3)

    def derivative(self, state: State, x: Value, x_m: Value, r: Value, u: Value) -> State:
        e = x - x_m
        theta_hat_dot = project(self.gamma * (e @ (self.P @ self.b)) * x, state.theta_hat, self.box)  # (4)
        return State(theta_hat_dot)

    def limit(self, state: State) -> State:
        return state._replace(theta_hat=limit(state.theta_hat, self.box))


@dataclass(frozen=True, eq=False, kw_only=True)
class Mrac:
    """u = -theta_hat'x + k_0 r with the Lyapunov law theta_hat' = proj(Gamma (e'P b) x).

    gamma       adaptive gain Gamma > 0, scalar
    theta_hat0  (n,), zero by default; inside the known set
    projection  onto the known set; by default on where one is given

    Source: eqs (3)-(4); Ioannou and Sun, Robust Adaptive Control, section 6.2.
    """

    gamma: float
    theta_hat0: Array | None = None
    projection: bool | None = None
    name: str = "MRAC"

    def __post_init__(self) -> None:
        check_common(self)
        object.__setattr__(self, "gamma", validate.positive("gamma", self.gamma))

    def bind(self, known: Known) -> Equations:
        box = projection_box(self.projection, known)
        return Equations(
            b=known.b,
            k_0=known.k_0,
            P=known.P,
            gamma=self.gamma,
            theta_hat0=initial_estimate(self.theta_hat0, box, known.n),
            box=box,
        )
