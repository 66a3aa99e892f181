"""The estimator of the state-feedback schemes with a parametric model from sample to sample by the midpoint rule."""

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
    from barbalat.controllers import robust_mrac
    from barbalat.controllers.robust_mrac_state import State


@dataclass(frozen=True, eq=False)
class StateEstimator(Estimator):
    """The normalised laws on the parametric model (13)."""

    continuous: robust_mrac.Equations

    @classmethod
    def of(cls, equations: robust_mrac.Equations, T: float) -> StateEstimator:
        law = implicit.require_sampled(equations.law, equations.box)
        Q = None if equations.Q is None else Filter.of(equations.Q, T)
        return cls(equations, T, law, LinearStep.of(equations.A_m, T), Q)

    def advance(self, state: State, before: Sample, u: Value, now: Sample) -> State:
        c = self.continuous
        u = applied(u, c.limits)
        x_mid = (before.x + now.x) / 2
        xi_mid = self.model.middle(state.xi, c.b * u)
        Xi_mid = self.model.middle(state.Xi, np.outer(c.b, (c.regressor(before.x) + c.regressor(now.x)) / 2))
        learnt = self.learnt(state, z=c.c_0 @ (x_mid - xi_mid), phi=c.c_0 @ Xi_mid, driven=u * u)  # (13)
        following = state._replace(**learnt._asdict(), xi=2 * xi_mid - state.xi, Xi=2 * Xi_mid - state.Xi)
        following = following._replace(swapping=self.swapped(state, following, Xi_mid))
        return following._replace(filter=self.filtered(state, following, before, now))
