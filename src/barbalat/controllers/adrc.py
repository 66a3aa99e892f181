"""Active disturbance rejection: what acts with the input is observed and taken away. Linear; nothing adapts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from barbalat import validate
from barbalat.controllers.disturbance_observer import Observer
from barbalat.controllers.knobs import Knobs, Reach
from barbalat.controllers.settings import Scheme
from barbalat.controllers.steps import LinearStep
from barbalat.controllers.tustin import Tustin
from barbalat.controllers.windup import applied, limits_of_predictor
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Value
from barbalat.roles import Role
from barbalat.validate import Array, Vector


class State(NamedTuple):
    """What the controller integrates; it estimates no parameters."""

    xi: Value  # the observer's


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations:
    """u = (k_0 r - theta_0'x_hat - f_hat)/b_0."""

    observer: Observer
    theta_0: Array  # (n, m)
    b_0: float
    k_0: Array | float
    x0: Array
    limits: Array | None = None  # of the input, where the observer is fed with what is left of u

    roles: ClassVar[Mapping[str, Role]] = {"xi": Role.predictor("state of the observer")}

    def initial(self) -> State:
        return State(self.observer.started(self.x0))

    def control(self, state: State, x: Value, x_m: Value, r: Value) -> Value:
        x_hat, f_hat = self.observer.estimates(state.xi, x)
        u = (np.dot(self.k_0, r).reshape(-1) - self.theta_0.T @ x_hat - f_hat) / self.b_0
        return u[0] if self.theta_0.shape[1] == 1 else u

    def derivative(self, state: State, x: Value, x_m: Value, r: Value, u: Value) -> State:
        return State(self.observer.derivative(state.xi, x, self.b_0 * applied(u, self.limits).reshape(-1)))

    def limit(self, state: State) -> State:
        return state

    def sampled(self, T: float) -> Tustin:
        return Tustin(self, T, LinearStep.of(self.observer.F, T))


@dataclass(frozen=True, eq=False)
class Adrc(Scheme):
    """u = (k_0 r - theta_0'x_hat - f_hat)/b_0, f_hat of an observer of x' = A x + b (b_0 u + f), f' = 0; A = A_m + b theta_0'.

    bandwidth  omega_o [rad/s]: every pole of the observer is at -omega_o
    output     c, (n,): the extended-state observer of order n + 1 that measures c'x alone, as in the textbooks. By default the
               whole state is measured, and the disturbance alone observed: f_hat = omega_o/(s + omega_o) [f]
    nominal    theta_0, (n,), or (n m,) with m inputs: the parameters that the observer assumes; zero by default, so that it has
               the model's A_m. A chain of integrators, as in the textbooks, is the theta_0 that makes A one
    b_0        the assumed effectiveness of the input, > 0; 1 by default
    saturated_predictor  against windup: the observer is fed with sat(u); off by default

    The bandwidth of the textbooks' state feedback, omega_c, is that of the reference model.

    Source: Gao, Scaling and bandwidth-parameterization based controller tuning, ACC 2003; Han, From PID to active disturbance
    rejection control, IEEE Trans. Industrial Electronics 56(3), 2009.
    """

    bandwidth: float
    _: KW_ONLY
    output: Vector | None = None
    nominal: Vector | None = None
    b_0: float = 1.0
    saturated_predictor: bool = False
    name: str = "ADRC"

    def __post_init__(self) -> None:
        validate.label("name", self.name)
        validate.freeze(self, bandwidth=validate.positive("bandwidth", self.bandwidth), b_0=validate.positive("b_0", self.b_0))
        for field, value in (("output", self.output), ("nominal", self.nominal)):
            if value is not None:
                validate.freeze(self, **{field: validate.vector(field, value)})

    @classmethod
    def knobs(cls, reach: Reach) -> Knobs:
        return Knobs(
            scheme="ADRC",
            values={"bandwidth": reach.frequencies},
            make=lambda bandwidth: cls(bandwidth=bandwidth, nominal=reach.nominal, saturated_predictor=reach.saturated),
            traded=False,
            aims=("complementary_sensitivity_peak", "condition"),
        )

    def bind(self, known: Known) -> Equations:
        n, m = known.n, known.inputs
        nominal = np.zeros(n * m) if self.nominal is None else validate.vector("nominal", self.nominal, n * m)
        theta_0, b = nominal.reshape(n, m), known.b.reshape(n, m)
        A = known.A_m + b @ theta_0.T
        return Equations(
            observer=Observer.of_state(A, b, self.bandwidth)
            if self.output is None
            else Observer.of_output(A, b, validate.vector("output", self.output, n), self.bandwidth),
            theta_0=theta_0,
            b_0=self.b_0,
            k_0=known.k_0,
            x0=known.x0,
            limits=limits_of_predictor(self.saturated_predictor, known),
        )
