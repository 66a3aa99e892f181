"""The classical output-feedback MRAC for relative degree one: the law is driven by y - y_m, without normalisation.

Source: Ioannou and Sun, section 6.4.1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from barbalat.adaptation.law import OutputErrorLaw
from barbalat.linear.systems import StateSpace
from barbalat.problem.known_set import ParameterBox, limit
from barbalat.protocols import SampledEquations, Value
from barbalat.roles import Role
from barbalat.validate import Array, InputError

REGRESSOR_FILTERS = {
    "omega_1": Role.filter("filtered control, alpha(s)/Lambda(s)[u]"),
    "omega_2": Role.filter("filtered output, alpha(s)/Lambda(s)[y]"),
}
"""Roles of the filters in both forms of the law."""


class State(NamedTuple):
    """The controller's states."""

    theta_hat: Value  # (2 n,): theta_1 (n - 1), theta_2 (n - 1), theta_3, c_0
    omega_1: Value  # (n - 1,) alpha(s)/Lambda(s)[u]
    omega_2: Value  # (n - 1,) alpha(s)/Lambda(s)[y]


@dataclass(frozen=True, eq=False)
class Equations:
    """u = theta_hat'omega, omega = [alpha/Lambda u; alpha/Lambda y; y; r]."""

    regressor_filter: StateSpace
    sign: float  # of k_p/k_m
    law: OutputErrorLaw
    theta_hat0: Array
    estimate_set: ParameterBox | None

    roles: ClassVar[Mapping[str, Role]] = REGRESSOR_FILTERS

    def initial(self) -> State:
        rest = np.zeros(self.regressor_filter.order)
        return State(self.theta_hat0, rest, rest)

    def omega(self, state: State, y: Value, r: Value) -> Value:
        return np.concatenate([self.regressor_at(state, y, r), r.reshape(1)])

    def regressor_at(self, state: State, y: Value, u: Value) -> Value:
        """omega without the command."""
        return np.concatenate([state.omega_1, state.omega_2, y.reshape(1)])

    def control(self, state: State, y: Value, y_m: Value, r: Value) -> Value:
        return state.theta_hat @ self.omega(state, y, r)

    def derivative(self, state: State, y: Value, y_m: Value, r: Value, u: Value) -> State:
        return State(
            self.law.rate(state.theta_hat, self.omega(state, y, r), y - y_m, self.sign, self.estimate_set),
            self.regressor_filter.derivative(state.omega_1, u),
            self.regressor_filter.derivative(state.omega_2, y),
        )

    def limit(self, state: State) -> State:
        return state._replace(theta_hat=limit(state.theta_hat, self.estimate_set))

    def sampled(self, T: float) -> SampledEquations:
        raise InputError(
            "discretization = 'midpoint' is not available for the Lyapunov law of output feedback, because its predictor would "
            "need the plant's gain (docs/sampled.md); use 'euler', or a law on the parametric model such as gradient"
        )
