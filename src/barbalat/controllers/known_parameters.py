"""The ideal of all adaptive controllers: the parameters are known, and nothing is estimated."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import NamedTuple

import numpy as np

from barbalat import validate
from barbalat.controllers.settings import Scheme
from barbalat.problem.regressors import MatchedTerm
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Value
from barbalat.validate import Array, InputError


class State(NamedTuple):
    """The controller's states."""

    theta_hat: Value  # (p,) the parameters, constant


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations:
    """Eq. (3) with constant parameters."""

    k_0: Array | float
    matched: MatchedTerm
    theta: Array

    def initial(self) -> State:
        return State(self.theta)

    def control(self, state: State, x: Value, x_m: Value, r: Value) -> Value:
        theta, omega = self.matched.split(state.theta_hat)
        return (-self.matched.phi(x).T @ theta + np.dot(self.k_0, r)) / omega  # (3)

    def derivative(self, state: State, x: Value, x_m: Value, r: Value, u: Value) -> State:
        return State(0 * state.theta_hat)

    def limit(self, state: State) -> State:
        return state


@dataclass(frozen=True, eq=False)
class KnownParameters(Scheme):
    """u = k_0 r - theta'phi(x), divided by omega if the plant's input gain is unknown. The estimates of adaptive schemes should
    converge to these values.

    With ``theta=problem.parameters`` the loop equals the reference model if no dynamics, limits or delay lie between controller
    and plant. Otherwise it shows how a delay, a limit or noise alone affects the tracking.

    theta  (p,), with the input gains last if the problem has unknown ones; checked neither against the plant nor against the
           known set

    Source: the matching condition below (2).
    """

    theta: Array
    _: KW_ONLY
    name: str = "Known parameters"

    def __post_init__(self) -> None:
        validate.label("name", self.name)
        validate.freeze(self, theta=validate.vector("theta", self.theta))

    def bind(self, known: Known) -> Equations:
        theta = validate.vector("theta", self.theta, known.parameters)
        gains = theta[len(theta) - known.inputs :] if known.matched.gain_unknown else np.ones(1)
        if not (gains > 0).all():
            raise InputError(f"theta must end with the input gains, all above zero, got {validate.show(theta)}")
        return Equations(k_0=known.k_0, matched=known.matched, theta=theta)
