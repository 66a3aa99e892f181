"""A linear controller on the same problem: nominal state feedback, feedforward, and K(s) on the model-following error."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import NamedTuple

import numpy as np

from barbalat import validate
from barbalat.controllers.knobs import Knobs, Reach
from barbalat.controllers.settings import Scheme, require_one_input
from barbalat.controllers.steps import LinearStep
from barbalat.controllers.tustin import Tustin
from barbalat.linear.systems import StateSpace, TransferFunction
from barbalat.problem.regressors import Linear as LinearRegressor
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Value
from barbalat.validate import Array, InputError, Vector, freeze


class State(NamedTuple):
    """What the controller integrates; it estimates nothing."""

    theta_hat: Value  # (0,)
    K: Value  # (order of K,) state of the controller K(s)


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations:
    """With theta = theta_0 the loop around K(s) is that of c'(sI - A_m)^-1 b."""

    k_0: float
    c: Array
    theta_0: Array
    K: StateSpace

    def initial(self) -> State:
        return State(np.zeros(0), np.zeros(self.K.order))

    def control(self, state: State, x: Value, x_m: Value, r: Value) -> Value:
        return self.k_0 * r - self.theta_0 @ x + self.K.output(state.K, self.c @ (x_m - x))

    def derivative(self, state: State, x: Value, x_m: Value, r: Value, u: Value) -> State:
        return State(state.theta_hat, self.K.derivative(state.K, self.c @ (x_m - x)))

    def limit(self, state: State) -> State:
        return state

    def sampled(self, T: float) -> Tustin:
        return Tustin(self, T, LinearStep.of(self.K.A, T))


@dataclass(frozen=True, eq=False)
class LinearFeedback(Scheme):
    """u = k_0 r - theta_0'x + K(s)[c'(x_m - x)]: model following without adaptation.

    controller  K(s), proper, a TransferFunction, StateSpace or python-control system; an integrator is allowed. Starts at rest
    output      c, (n,): the combination of the states that is fed back, P b by default
    nominal     theta_0, (n,): the parameters that are assumed; by default the middle of the known set, zero without one
    unmodelled  W(s), stable and proper: the size of the unmodelled dynamics that mu is computed for; none by default

    Any linear controller of the measured states closes some loop L(s) at the plant's input, and with c'(sI - A_m)^-1 b
    minimum phase a scalar K(s) can give every such loop of its relative degree: nothing is lost by feeding back c'x.
    """

    controller: StateSpace | TransferFunction
    _: KW_ONLY
    output: Vector | None = None
    nominal: Vector | None = None
    unmodelled: TransferFunction | None = None
    name: str = "Linear"

    def __post_init__(self) -> None:
        validate.label("name", self.name)
        freeze(self, controller=StateSpace.accept("controller", self.controller))
        for field in ("output", "nominal"):
            if getattr(self, field) is not None:
                freeze(self, **{field: validate.vector(field, getattr(self, field))})
        if self.unmodelled is not None:
            W = TransferFunction.accept("unmodelled", self.unmodelled)
            if W.relative_degree < 0 or not W.is_stable:
                raise InputError(
                    f"unmodelled must be proper and stable, got num = {validate.show(W.num)}, den = {validate.show(W.den)}"
                )
            freeze(self, unmodelled=W)

    @classmethod
    def knobs(cls, reach: Reach) -> Knobs:
        """A PI controller on b'P(x_m - x), of which b'(sI - A_m)^-1'P b is an integrator where it is fast."""
        known = reach.known
        fast = float(np.reshape(known.b, (known.n, -1))[:, 0] @ known.P @ np.reshape(known.b, (known.n, -1))[:, 0])

        def pi(crossover: float, T_i: float) -> LinearFeedback:
            k_p = crossover / fast
            return cls(controller=TransferFunction([k_p * T_i, k_p], [T_i, 0.0]), name="PI")

        return Knobs(
            scheme="PI",
            values={"crossover": reach.frequencies, "T_i": reach.times},
            make=pi,
            traded=False,
            aims=("sensitivity_peak", "condition"),
        )

    def bind(self, known: Known) -> Equations:
        require_linear_plant(known)
        middle = np.zeros(known.n) if known.theta_set is None else known.theta_set.middle
        return Equations(
            k_0=known.k_0,
            c=known.P @ known.b if self.output is None else validate.vector("output", self.output, known.n),
            theta_0=middle if self.nominal is None else validate.vector("nominal", self.nominal, known.n),
            K=StateSpace.accept("controller", self.controller),
        )


def require_linear_plant(known: Known) -> None:
    """InputError for several inputs, an unknown input gain, a regressor other than x."""
    require_one_input("linear", known)
    if not isinstance(known.uncertainty.regressor, LinearRegressor):
        raise InputError("linear takes plants with the regressor phi(x) = x")
