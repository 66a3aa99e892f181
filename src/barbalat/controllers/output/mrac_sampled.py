"""The output-feedback MRAC from sample to sample by the midpoint rule: docs/sampled.md has what holds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from barbalat.adaptation import implicit
from barbalat.adaptation.law import SampleData, SampledLaw
from barbalat.controllers.steps import Filter, LinearStep
from barbalat.controllers.windup import applied
from barbalat.protocols import Sample, Value

if TYPE_CHECKING:
    from barbalat.controllers.output import mrac_normalized


@dataclass(frozen=True, eq=False)
class OutputEstimator:
    """The laws on the parametric model z = W_m[u] = theta'phi_p: filters by midpoint, the law as in ``adaptation.implicit``."""

    continuous: mrac_normalized.Equations
    sample_time: float
    law: SampledLaw
    regressors: LinearStep
    model: LinearStep
    filter: Filter | None

    explicit: ClassVar[bool] = False

    @classmethod
    def of(cls, equations: mrac_normalized.Equations, T: float) -> OutputEstimator:
        law = implicit.require_sampled(equations.law, equations.box)
        Q = None if equations.Q is None else Filter.of(equations.Q, T)
        regressors, model = LinearStep.of(equations.regressor_filter.A, T), LinearStep.of(equations.W_m.A, T)
        return cls(equations, T, law, regressors, model, Q)

    def initial(self) -> mrac_normalized.State:
        return self.continuous.initial()

    def control(self, state: mrac_normalized.State, y: Value, y_m: Value, r: Value) -> Value:
        return self.continuous.control(state, y, y_m, r)

    def advance(self, state: mrac_normalized.State, before: Sample, u: Value, now: Sample) -> mrac_normalized.State:
        c, T = self.continuous, self.sample_time
        y, r, u = (before.x + now.x) / 2, (before.r + now.r) / 2, applied(u, c.limits)
        g, W_m = c.regressor_filter.B, c.W_m
        omega_1, omega_2 = self.regressors.middle(state.omega_1, g * u), self.regressors.middle(state.omega_2, g * y)
        omega = np.concatenate([omega_1, omega_2, y.reshape(1), r.reshape(1)])
        xi, Xi = self.model.middle(state.xi, W_m.B * u), self.model.middle(state.Xi, np.outer(W_m.B, omega))
        phi = np.concatenate([(W_m.C @ Xi)[:-1], y.reshape(1)])
        decay = np.exp(-c.normalization.delta_0 * T)
        n_d = decay * state.n_d + (1 - decay) / c.normalization.delta_0 * (u * u + y * y)
        m_s_squared = c.normalization.m_s_squared(phi, (state.n_d + n_d) / 2)
        data = SampleData(T, W_m.C @ xi, phi, m_s_squared)
        theta_hat, memory = self.law.sampled_step(state.theta_hat, state.memory, data, c.box)
        following = state._replace(
            theta_hat=theta_hat,
            memory=memory,
            omega_1=2 * omega_1 - state.omega_1,
            omega_2=2 * omega_2 - state.omega_2,
            xi=2 * xi - state.xi,
            Xi=2 * Xi - state.Xi,
            n_d=n_d,
        )
        if self.filter is None:
            return following
        following = following._replace(swapping=self.model.end(state.swapping, Xi @ (theta_hat - state.theta_hat) / T))
        wanted = c.auxiliary_input_argument(state, before.x), c.auxiliary_input_argument(following, now.x)
        return following._replace(filter=self.filter.end(state.filter, *wanted))
