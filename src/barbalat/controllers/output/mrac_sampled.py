"""The output-feedback MRAC on a parametric model from sample to sample by the midpoint rule: docs/sampled.md has what holds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from barbalat.adaptation import implicit
from barbalat.controllers.estimator import Estimator
from barbalat.controllers.steps import Filter, LinearStep
from barbalat.controllers.windup import applied
from barbalat.protocols import Sample, Value

if TYPE_CHECKING:
    from barbalat.controllers.output import mrac_normalized


@dataclass(frozen=True, eq=False)
class OutputEstimator(Estimator):
    """The laws on the parametric model z = W_m[u] = theta'phi_p; ``regressors`` advances omega_1 and omega_2."""

    continuous: mrac_normalized.Equations
    regressors: LinearStep

    @classmethod
    def of(cls, equations: mrac_normalized.Equations, T: float) -> OutputEstimator:
        law = implicit.require_sampled(equations.law, equations.box)
        Q = None if equations.Q is None else Filter.of(equations.Q, T)
        regressors, model = LinearStep.of(equations.regressor_filter.A, T), LinearStep.of(equations.W_m.A, T)
        return cls(equations, T, law, model, Q, regressors)

    def advance(self, state: mrac_normalized.State, before: Sample, u: Value, now: Sample) -> mrac_normalized.State:
        c = self.continuous
        y, r, u = (before.x + now.x) / 2, (before.r + now.r) / 2, applied(u, c.limits)
        g, W_m = c.regressor_filter.B, c.W_m
        omega_1, omega_2 = self.regressors.middle(state.omega_1, g * u), self.regressors.middle(state.omega_2, g * y)
        omega = np.concatenate([omega_1, omega_2, y.reshape(1), r.reshape(1)])
        xi, Xi = self.model.middle(state.xi, W_m.B * u), self.model.middle(state.Xi, np.outer(W_m.B, omega))
        phi = np.concatenate([(W_m.C @ Xi)[:-1], y.reshape(1)])
        learnt = self.learnt(state, z=W_m.C @ xi, phi=phi, driven=u * u + y * y)
        following = state._replace(
            **learnt._asdict(),
            omega_1=2 * omega_1 - state.omega_1,
            omega_2=2 * omega_2 - state.omega_2,
            xi=2 * xi - state.xi,
            Xi=2 * Xi - state.Xi,
        )
        following = following._replace(swapping=self.swapped(state, following, Xi))
        return following._replace(filter=self.filtered(state, following, before, now))
