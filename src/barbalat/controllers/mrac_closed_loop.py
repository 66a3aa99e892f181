"""MRAC with a closed-loop reference model, into which the error is fed back. The transients oscillate less at high gain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np

from barbalat import validate
from barbalat.controllers.settings import Scheme, check_common, initial_estimate, projection_set, require_taken
from barbalat.controllers.tuning_grid import TuningGrid, TuningScale
from barbalat.linear.conditions import require_hurwitz
from barbalat.problem.known_set import EstimateSet, Gain, gain, limit, project
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Value
from barbalat.roles import Role
from barbalat.validate import Array, Matrix, Vector


class State(NamedTuple):
    """The controller's states."""

    theta_hat: Value  # (p,) estimate of theta
    x_c: Value  # (n,) the closed-loop model's state


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations:
    """The law (4) with x_c in place of x_m, and P for A_m + L."""

    known: Known
    L: Array  # (n, n)
    P: Array  # (n, n)
    gamma: Gain
    theta_hat0: Array
    estimate_set: EstimateSet | None

    roles: ClassVar[Mapping[str, Role]] = {"x_c": Role.predictor("state of the closed-loop reference model")}

    def initial(self) -> State:
        return State(self.theta_hat0, self.known.x0)

    def control(self, state: State, x: Value, x_m: Value, r: Value) -> Value:
        return -self.known.matched.phi(x).T @ state.theta_hat + self.known.k_0 * r  # (3)

    def regressor_at(self, state: State, x: Value, u: Value) -> Value:
        return self.known.matched.phi(x)

    def derivative(self, state: State, x: Value, x_m: Value, r: Value, u: Value) -> State:
        A_m, b, k_0, e_c = self.known.A_m, self.known.b, self.known.k_0, x - state.x_c
        rate = self.gamma.scaled(e_c @ (self.P @ b), self.regressor_at(state, x, u))  # (4) with e_c
        x_c_dot = A_m @ state.x_c + b * (k_0 * r) + self.known.commanded(r) - self.L @ e_c
        return State(project(rate, state.theta_hat, self.estimate_set, self.gamma), x_c_dot)

    def limit(self, state: State) -> State:
        return state._replace(theta_hat=limit(state.theta_hat, self.estimate_set))


@dataclass(frozen=True, eq=False)
class MracClosedLoop(Scheme):
    """u = -theta_hat'phi(x) + k_0 r, theta_hat' = proj(Gamma (e_c'P b) phi(x)), e_c = x - x_c, x_c' = A_m x_c + b k_0 r - L e_c.

    P solves P (A_m + L) + (A_m + L)'P = -I. Results still report the error with respect to the open-loop model (2).

    gamma           adaptive gain Gamma > 0: a number, a diagonal (p,) or an s.p.d. matrix (p, p)
    model_feedback  L, (n, n): A_m + L must be Hurwitz; L = 0 gives the standard MRAC
    theta_hat0      (p,), zero by default; inside the known set
    projection      onto the known set; on by default if there is one

    Source: Gibson, Annaswamy and Lavretsky, On adaptive control with closed-loop reference models, IEEE Access 1 (2013).
    """

    gamma: float | Array
    _: KW_ONLY
    model_feedback: Matrix
    theta_hat0: Vector | None = None
    projection: bool | None = None
    name: str = "MRAC, closed-loop model"

    beyond: ClassVar[tuple[str, ...]] = ("several inputs", "an unknown input gain")

    def __post_init__(self) -> None:
        check_common(self)
        object.__setattr__(self, "gamma", gain.accept("gamma", self.gamma))
        validate.freeze(self, model_feedback=validate.square_matrix("model_feedback", self.model_feedback))

    @classmethod
    def knobs(cls, reach: TuningScale) -> TuningGrid:
        return TuningGrid(
            scheme="MRAC, closed-loop model",
            values={"gamma": reach.gains(1e-8, 8 * reach.density), "ell": reach.frequencies},
            make=lambda gamma, ell: cls(gamma=gamma, model_feedback=-ell * np.eye(reach.known.n), theta_hat0=reach.theta_hat0),
            traded=False,
            aims=("error_bound",),
        )

    def bind(self, known: Known) -> Equations:
        require_taken(MracClosedLoop, known)
        gamma, L = Gain(self.gamma), validate.array("model_feedback", self.model_feedback, known.A_m.shape)
        gamma.require_size("gamma", known.parameters)
        closed, estimate_set = replace(known, A_m=known.A_m + L), projection_set(self.projection, known)
        require_hurwitz("A_m + model_feedback", closed.A_m)
        theta_hat0 = initial_estimate(self.theta_hat0, estimate_set, known)
        return Equations(known=known, L=L, P=closed.P, gamma=gamma, theta_hat0=theta_hat0, estimate_set=estimate_set)
