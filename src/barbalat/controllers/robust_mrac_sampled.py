"""The estimator of the schemes with a parametric model from sample to sample by the midpoint rule."""

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
    from barbalat.controllers import robust_mrac


@dataclass(frozen=True, eq=False)
class Estimator:
    """The normalised laws on the parametric model (13): the filters by midpoint, the law as in ``adaptation.implicit``."""

    continuous: robust_mrac.Equations
    sample_time: float
    law: SampledLaw
    model: LinearStep
    filter: Filter | None

    explicit: ClassVar[bool] = False

    @classmethod
    def of(cls, equations: robust_mrac.Equations, T: float) -> Estimator:
        law = implicit.require_sampled(equations.law, equations.box)
        Q = None if equations.Q is None else Filter.of(equations.Q, T)
        return cls(equations, T, law, LinearStep.of(equations.A_m, T), Q)

    def initial(self) -> robust_mrac.State:
        return self.continuous.initial()

    def control(self, state: robust_mrac.State, x: Value, x_m: Value, r: Value) -> Value:
        return self.continuous.control(state, x, x_m, r)

    def advance(self, state: robust_mrac.State, before: Sample, u: Value, now: Sample) -> robust_mrac.State:
        c, T = self.continuous, self.sample_time
        u = applied(u, c.limits)
        x_mid = (before.x + now.x) / 2
        xi_mid = self.model.middle(state.xi, c.b * u)
        Xi_mid = self.model.middle(state.Xi, np.outer(c.b, (c.regressor(before.x) + c.regressor(now.x)) / 2))
        phi = c.c_0 @ Xi_mid  # (13)
        z = c.c_0 @ (x_mid - xi_mid)  # (13)
        decay = np.exp(-c.normalization.delta_0 * T)
        n_d = decay * state.n_d + (1 - decay) / c.normalization.delta_0 * (u * u)  # (16), exact for the u that was held
        m_s_squared = c.normalization.m_s_squared(phi, (state.n_d + n_d) / 2)
        theta_hat, memory = self.law.sampled_step(state.theta_hat, state.memory, SampleData(T, z, phi, m_s_squared), c.box)
        following = state._replace(
            theta_hat=theta_hat, memory=memory, xi=2 * xi_mid - state.xi, Xi=2 * Xi_mid - state.Xi, n_d=n_d
        )
        if self.filter is None:
            return following
        following = following._replace(swapping=self.model.end(state.swapping, Xi_mid @ (theta_hat - state.theta_hat) / T))
        wanted = c.auxiliary_input_argument(state, before.x), c.auxiliary_input_argument(following, now.x)
        return following._replace(filter=self.filter.end(state.filter, *wanted))
