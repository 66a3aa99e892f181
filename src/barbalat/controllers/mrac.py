"""Standard model reference adaptive control: eqs (3)-(4)."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field
from typing import Any, NamedTuple

import numpy as np

from barbalat import validate
from barbalat.adaptation.learning import CompositeLearning
from barbalat.adaptation.lyapunov import Modifications
from barbalat.adaptation.modifications import DeadZone, Leakage
from barbalat.controllers import l1
from barbalat.controllers.l1 import Predictor
from barbalat.controllers.settings import Scheme, bound_with_lyapunov_law, check_common
from barbalat.controllers.tuning_grid import TuningGrid, TuningScale
from barbalat.controllers.windup import ModifiedError, applied, known_limits
from barbalat.linear.systems import StateSpace
from barbalat.problem.known_set import EstimateSet, Gain, gain, limit
from barbalat.problem.regressors import MatchedTerm
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Value
from barbalat.roles import Role, within
from barbalat.validate import Array, InputError, Vector


class State(NamedTuple):
    """The controller's states."""

    theta_hat: Value  # (p,) estimate of theta, and of omega if the input gain is unknown
    memory: Any = ()  # of composite learning
    e_d: Value = np.zeros(0)  # (n,) the error due to the input limit; (0,) without the windup remedy


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations:
    """The law is driven by the tracking error."""

    A_m: Array
    b: Array
    k_0: Array | float
    P: Array
    matched: MatchedTerm
    gamma: Gain
    theta_hat0: Array
    x0: Array
    estimate_set: EstimateSet | None
    modifications: Modifications = field(default_factory=Modifications)
    enters: Array | None = None  # the matrix by which the command enters the state directly
    windup: ModifiedError | None = None
    limits: Array | None = None  # limits of the input, with a windup remedy

    @property
    def roles(self) -> dict[str, Role]:
        return {"e_d": Role.other("error that the input's limit causes")} | within("memory", self.modifications)

    def initial(self) -> State:
        memory = self.modifications.initial(self.b, self.x0, len(self.theta_hat0))
        return State(self.theta_hat0, memory, np.zeros(0 if self.windup is None else len(self.x0)))

    def control(self, state: State, x: Value, x_m: Value, r: Value) -> Value:
        u_c = self.unlimited_control(state, x, r)
        return u_c if self.windup is None else self.windup.control(u_c, self.limits)

    def unlimited_control(self, state: State, x: Value, r: Value) -> Value:
        theta_hat, omega_hat = self.matched.split(state.theta_hat)
        return (-self.matched.phi(x).T @ theta_hat + np.dot(self.k_0, r)) / omega_hat  # (3)

    def regressor_at(self, state: State, x: Value, u: Value) -> Value:
        return self.matched.with_input(x, applied(u, self.limits))

    def derivative(self, state: State, x: Value, x_m: Value, r: Value, u: Value) -> State:
        e, e_d = x - x_m, state.e_d
        if self.windup is not None:
            e, u_c, u = e - e_d, self.unlimited_control(state, x, r), applied(u, self.limits)
            _, omega_hat = self.matched.split(state.theta_hat)
            e_d = self.A_m @ e_d + np.dot(self.b, omega_hat * (u - u_c))
        phi, known = self.matched.with_input(x, u), self.matched.known_input(u)
        return State(
            self.modifications.rate(self.gamma, e, self.P, self.b, phi, state.theta_hat, state.memory, self.estimate_set),  # (4)
            self.modifications.memory_rates(state.memory, self.A_m, self.b, x, phi, known),
            e_d,
        )

    def limit(self, state: State) -> State:
        return state._replace(theta_hat=limit(state.theta_hat, self.estimate_set))

    def sampled(self, T: float) -> Predictor:
        """Return the sampled form, which is that of L1-AC with C = 1. Its predictor is then the model, adapted to ``limits`` if
        there are any."""
        with_predictor = l1.Equations(
            A_m=self.A_m,
            b=self.b,
            k_0=self.k_0,
            P=self.P,
            matched=self.matched,
            gamma=self.gamma,
            C=StateSpace.gain(1.0),
            theta_hat0=self.theta_hat0,
            x0=self.x0,
            estimate_set=self.estimate_set,
            modifications=self.modifications,
            enters=self.enters,
            limits=self.limits,
        )
        return Predictor.of(with_predictor, T, self.windup)


@dataclass(frozen=True, eq=False)
class Mrac(Scheme):
    """u = -theta_hat'phi(x) + k_0 r with the Lyapunov law theta_hat' = proj(Gamma (e'P b) phi(x)); phi(x) = x in the paper.

    With an unknown input gain omega, u = (-theta_hat'phi + k_0 r)/omega_hat and omega_hat' = proj(Gamma (e'P b) u).

    gamma       adaptive gain Gamma > 0: a number, a diagonal (p,) or an s.p.d. matrix (p, p)
    theta_hat0  (p,), zero by default; inside the known set
    projection  onto the known set; on by default if there is one. The estimate of an unknown input gain is always projected
    leakage, dead_zone  modifications of the law, none by default: see ``adaptation.lyapunov``
    learning    a memory of past data; none by default
    modified_error  against windup when the input saturates: see ``ModifiedError``; none by default

    Source: eqs (3)-(4); Ioannou and Sun, Robust Adaptive Control, section 6.2.
    """

    gamma: float | Array
    _: KW_ONLY
    theta_hat0: Vector | None = None
    projection: bool | None = None
    leakage: Leakage | None = None
    dead_zone: DeadZone | None = None
    learning: CompositeLearning | None = None
    modified_error: ModifiedError | None = None
    name: str = "MRAC"

    def __post_init__(self) -> None:
        check_common(self)
        if self.modified_error is not None:
            validate.instance("modified_error", self.modified_error, ModifiedError)
            if self.learning is not None:
                raise InputError(
                    "modified_error cannot be combined with composite learning, whose memory assumes that u reaches the plant"
                )
        object.__setattr__(self, "gamma", gain.accept("gamma", self.gamma))
        Modifications.of(self)  # rejects parts that can't be combined

    @classmethod
    def knobs(cls, reach: TuningScale) -> TuningGrid:
        return TuningGrid(
            scheme="MRAC",
            values={"gamma": reach.gains(1e-8, 8 * reach.density)},
            make=lambda gamma: cls(
                gamma=gamma, theta_hat0=reach.theta_hat0, modified_error=ModifiedError() if reach.saturated else None
            ),
            aims=("error_bound",),
        )

    def bind(self, known: Known) -> Equations:
        return Equations(
            **bound_with_lyapunov_law(self, known),
            windup=self.modified_error,
            limits=None if self.modified_error is None else known_limits("modified_error", known),
        )
