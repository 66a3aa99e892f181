"""A linear controller for comparison: nominal state feedback, feedforward, and K(s) acting on the model-following error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from barbalat import validate
from barbalat.controllers.settings import Scheme, require_taken
from barbalat.controllers.steps import LinearStep, Tustin
from barbalat.controllers.tuning_grid import TuningGrid, TuningScale
from barbalat.controllers.windup import applied, limits_of_predictor
from barbalat.linear.systems import StateSpace, TransferFunction
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Value
from barbalat.roles import Role
from barbalat.validate import Array, InputError, Vector, freeze


class State(NamedTuple):
    """The controller's states; it estimates nothing."""

    K: Value  # (order of K,) state of the controller K(s)


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations:
    """The equations of the linear controller; with theta = theta_0 its loop is K(s) around c'(sI - A_m)^-1 b."""

    k_0: float
    c: Array
    theta_0: Array
    K: StateSpace
    L: Array  # (order of K,) gain on the part of u beyond the limits, fed to K(s); zero without anti_windup
    limits: Array | None = None

    roles: ClassVar[Mapping[str, Role]] = {"K": Role.other("state of the linear controller K(s)")}

    def initial(self) -> State:
        return State(np.zeros(self.K.order))

    def control(self, state: State, x: Value, x_m: Value, r: Value) -> Value:
        return self.k_0 * r - self.theta_0 @ x + self.K.output(state.K, self.c @ (x_m - x))

    def derivative(self, state: State, x: Value, x_m: Value, r: Value, u: Value) -> State:
        K_dot = self.K.derivative(state.K, self.c @ (x_m - x))
        return State(K_dot if self.limits is None else K_dot + self.L * (applied(u, self.limits) - u))

    def limit(self, state: State) -> State:
        return state

    def sampled(self, T: float) -> Tustin:
        return Tustin(self, T, LinearStep.of(self.K.A, T))


@dataclass(frozen=True, eq=False)
class LinearFeedback(Scheme):
    """u = k_0 r - theta_0'x + K(s)[c'(x_m - x)]: model following without adaptation; an unknown input gain is taken as 1.

    controller  K(s), proper, a TransferFunction, StateSpace or python-control system; it may contain an integrator. Starts at
                rest
    output      c, (n,): the combination of states that is fed back; P b by default
    nominal     theta_0, (n,): the assumed parameters; the default is the first that exists of a baseline's theta_0, theta_0 at
                the declared values of [parameters], the middle of the known set, and zero
    unmodelled  W(s), stable and proper: the size of the unmodelled dynamics for which mu is computed; none by default
    anti_windup  > 0 [u for each unit of c'e]: K(s) also receives L (sat(u) - u). L is the gain of a Kalman filter that
                 measures the output of K(s) with noise of this size, for an error of size 1. For a PI controller whose k_p has
                 this value, this is back-calculation with the time constant T_i. Off by default

    Any linear controller of the measured states closes some loop L(s) at the plant's input. If c'(sI - A_m)^-1 b is minimum
    phase, a scalar K(s) can produce every such loop of the same relative degree, so feeding back c'x is no restriction.
    """

    controller: StateSpace | TransferFunction
    _: KW_ONLY
    output: Vector | None = None
    nominal: Vector | None = None
    unmodelled: TransferFunction | None = None
    anti_windup: float | None = None
    name: str = "Linear"

    beyond: ClassVar[tuple[str, ...]] = ("several inputs", "a regressor other than x")

    def __post_init__(self) -> None:
        validate.label("name", self.name)
        freeze(self, controller=StateSpace.accept("controller", self.controller))
        for field in ("output", "nominal"):
            if getattr(self, field) is not None:
                freeze(self, **{field: validate.vector(field, getattr(self, field))})
        if self.anti_windup is not None:
            freeze(self, anti_windup=validate.positive("anti_windup", self.anti_windup))
        if self.unmodelled is not None:
            W = TransferFunction.accept("unmodelled", self.unmodelled)
            if W.relative_degree < 0 or not W.is_stable:
                raise InputError(
                    f"unmodelled must be proper and stable, got num = {validate.show(W.num)}, den = {validate.show(W.den)}"
                )
            freeze(self, unmodelled=W)

    @classmethod
    def knobs(cls, reach: TuningScale) -> TuningGrid:
        """A PI controller on b'P(x_m - x), for which b'(sI - A_m)^-1'P b behaves as an integrator at high frequencies."""
        known = reach.known
        fast = float(np.reshape(known.b, (known.n, -1))[:, 0] @ known.P @ np.reshape(known.b, (known.n, -1))[:, 0])

        def pi(crossover: float, T_i: float) -> LinearFeedback:
            k_p = crossover / fast
            return cls(controller=TransferFunction([k_p * T_i, k_p], [T_i, 0.0]), name="PI")

        return TuningGrid(
            scheme="PI",
            values={"crossover": reach.frequencies, "T_i": reach.times},
            make=pi,
            traded=False,
            aims=("sensitivity_peak", "condition"),
        )

    def bind(self, known: Known) -> Equations:
        require_linear_plant(known)
        K = StateSpace.accept("controller", self.controller)
        middle = np.zeros(known.n) if known.theta_set is None else known.theta_set.middle
        assumed = next(one for one in (known.theta_0, known.nominal, middle) if one is not None)
        return Equations(
            k_0=known.k_0,
            c=known.P @ known.b if self.output is None else validate.vector("output", self.output, known.n),
            theta_0=assumed if self.nominal is None else validate.vector("nominal", self.nominal, known.n),
            K=K,
            L=np.zeros(K.order) if self.anti_windup is None else _learning(K, self.anti_windup),
            limits=limits_of_predictor(self.anti_windup is not None, known, remedy="anti_windup"),
        )


def _learning(K: StateSpace, noise: float) -> Array:
    """L of the Kalman filter for xi' = A xi + B w, y = C xi + noise v, such that A - L C is stable; raises InputError if there is
    none."""
    from scipy.linalg import solve_continuous_are

    try:
        Q = solve_continuous_are(K.A.T, K.C[:, None], np.outer(K.B, K.B), np.array([[noise**2]]))
    except np.linalg.LinAlgError:
        raise InputError("anti_windup needs a controller in whose output every mode that does not decay is observable") from None
    return np.asarray(Q @ K.C / noise**2)


def require_linear_plant(known: Known) -> None:
    """Raise InputError for a plant that has features not supported by linear feedback."""
    require_taken(LinearFeedback, known)
