"""The controller to which all adaptive ones aspire: the parameters are known, and nothing is left to estimate."""

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
    """What the controller keeps."""

    theta_hat: Value  # (p,) the parameters, at rest


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations:
    """Eq. (3) with the estimate at rest."""

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
    """u = k_0 r - theta'phi(x), over omega where the plant's input gain is unknown: what every estimate is to converge to.

    With ``theta=problem.parameters`` the loop is the reference model as long as nothing stands between controller and plant:
    the benchmark for what a delay, a limit or noise does to the tracking alone.

    theta  (p,), the input gains last where the problem has them unknown; not checked against the plant, nor the known set

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
