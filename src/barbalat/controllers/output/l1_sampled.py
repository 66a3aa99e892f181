"""L1 output feedback from sample to sample by the midpoint rule."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from barbalat.controllers.sampled_form import SampledForm
from barbalat.controllers.steps import Filter
from barbalat.problem.known_set import limit
from barbalat.protocols import Sample, Value, kept

if TYPE_CHECKING:
    from barbalat.controllers.output import l1


@dataclass(frozen=True, eq=False)
class OutputPredictor(SampledForm):
    """(21): predictor and sigma in one implicit step, for every gamma and T; the predictor is fed with sigma inside its bounds.

    With y_next = y + T (-m y_mid + m (u + s) + w), s what sigma estimates, y_tilde = y - y_hat and sigma_tilde = sigma - s,
    V = y_tilde^2 + m sigma_tilde^2/gamma changes by at most -2 m T y_tilde^2 + 2 T y_tilde w, y_tilde that at the end.
    """

    continuous: l1.Equations
    sample_time: float
    filter: Filter
    frozen: Value = None  # where it holds, sigma rests; None: it never does

    explicit: ClassVar[bool] = False

    @classmethod
    def of(cls, equations: l1.Equations, T: float) -> OutputPredictor:
        return cls(equations, T, Filter.of(equations.C, T))

    def freezing(self, frozen: Value) -> OutputPredictor:
        return replace(self, frozen=frozen)

    def advance(self, state: l1.State, before: Sample, u: Value, now: Sample) -> l1.State:
        c, T, m = self.continuous, self.sample_time, self.continuous.m
        end = 1 / (1 + m * T)
        at_rest = end * (state.y_hat + T * m * ((now.x - before.x) / 2 + u + state.theta_hat))  # y_hat, were sigma to rest
        moved = T * c.gamma * (now.x - at_rest) / (1 + T**2 * m * c.gamma * end)
        sigma = kept(self.frozen, state.theta_hat, limit(state.theta_hat + moved, c.box))
        y_hat = at_rest + end * T * m * (sigma - state.theta_hat)
        wanted = before.r - state.theta_hat[0], now.r - sigma[0]
        return state._replace(theta_hat=sigma, y_hat=y_hat, filter=self.filter.end(state.filter, *wanted))
