"""The output-feedback schemes and the linear controllers from sample to sample: midpoint steps in closed form.

docs/sampled.md has what holds. Linear parts go by the trapezoidal rule (Tustin).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from barbalat.adaptation import implicit
from barbalat.adaptation.projection import limit
from barbalat.controllers import linear_feedback
from barbalat.controllers.midpoint import Filter, LinearStep
from barbalat.controllers.output import l1, linear, mrac
from barbalat.controllers.output.lyapunov import LyapunovLaw
from barbalat.controllers.windup import applied
from barbalat.protocols import Sample, Value
from barbalat.validate import InputError


@dataclass(frozen=True, eq=False)
class OutputPredictor:
    """(21): predictor and sigma in one implicit step, for every gamma and T; the predictor is fed with sigma inside its bounds.

    With y_next = y + T (-m y_mid + m (u + s) + w), s what sigma estimates, y_tilde = y - y_hat and sigma_tilde = sigma - s,
    V = y_tilde^2 + m sigma_tilde^2/gamma changes by at most -2 m T y_tilde^2 + 2 T y_tilde w, y_tilde that at the end.
    """

    continuous: l1.Equations
    sample_time: float
    filter: Filter

    @classmethod
    def of(cls, equations: l1.Equations, T: float) -> OutputPredictor:
        return cls(equations, T, Filter.of(equations.C, T))

    def initial(self) -> l1.State:
        return self.continuous.initial()

    def control(self, state: l1.State, y: Value, y_m: Value, r: Value) -> Value:
        return self.continuous.control(state, y, y_m, r)

    def advance(self, state: l1.State, before: Sample, u: Value, now: Sample) -> l1.State:
        c, T, m = self.continuous, self.sample_time, self.continuous.m
        end = 1 / (1 + m * T)
        at_rest = end * (state.y_hat + T * m * ((now.x - before.x) / 2 + u + state.theta_hat))  # y_hat, were sigma to rest
        moved = T * c.gamma * (now.x - at_rest) / (1 + T**2 * m * c.gamma * end)
        sigma = limit(state.theta_hat + moved, c.box)
        y_hat = at_rest + end * T * m * (sigma - state.theta_hat)
        wanted = before.r - state.theta_hat[0], now.r - sigma[0]
        return l1.State(sigma, y_hat, self.filter.end(state.filter, *wanted))


@dataclass(frozen=True, eq=False)
class OutputEstimator:
    """The laws on the parametric model z = W_m[u] = theta'phi_p: filters by midpoint, the law as in ``adaptation.implicit``."""

    continuous: mrac.Equations
    sample_time: float
    regressors: LinearStep
    model: LinearStep
    filter: Filter | None

    @classmethod
    def of(cls, equations: mrac.Equations, T: float) -> OutputEstimator:
        if isinstance(equations.law, LyapunovLaw):
            raise InputError(
                "discretization = 'midpoint' is not known for the Lyapunov law of output feedback, whose predictor would need "
                "the plant's gain (docs/sampled.md); take 'euler', or a law on the parametric model such as gradient"
            )
        implicit.require_implicit(equations.law, equations.box)
        Q = None if equations.Q is None else Filter.of(equations.Q, T)
        regressors, model = LinearStep.of(equations.regressor_filter.A, T), LinearStep.of(equations.W_m.A, T)
        return cls(equations, T, regressors, model, Q)

    def initial(self) -> mrac.State:
        return self.continuous.initial()

    def control(self, state: mrac.State, y: Value, y_m: Value, r: Value) -> Value:
        return self.continuous.control(state, y, y_m, r)

    def advance(self, state: mrac.State, before: Sample, u: Value, now: Sample) -> mrac.State:
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
        law: Any = c.law
        theta_hat, memory = implicit.step(law, T, state.theta_hat, state.memory, W_m.C @ xi, phi, m_s_squared, c.box)
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


@dataclass(frozen=True, eq=False)
class Tustin:
    """A linear controller on the output or on the state, by the trapezoidal rule."""

    continuous: linear.Equations | linear_feedback.Equations
    sample_time: float
    step: LinearStep

    @classmethod
    def of(cls, equations: linear.Equations | linear_feedback.Equations, T: float) -> Tustin:
        return cls(
            equations, T, LinearStep.of(equations.K.A if isinstance(equations, linear_feedback.Equations) else equations.A, T)
        )

    def initial(self) -> Any:
        return self.continuous.initial()

    def control(self, state: Any, x: Value, x_m: Value, r: Value) -> Value:
        return self.continuous.control(state, x, x_m, r)

    def advance(self, state: Any, before: Sample, u: Value, now: Sample) -> Any:
        rest = self.continuous.initial()  # at the origin the derivative is the forcing alone
        forcings = [self.continuous.derivative(rest, *sample, u)[1] for sample in (before, now)]  # type: ignore[arg-type]
        return type(state)(state.theta_hat, self.step.end(state[1], (forcings[0] + forcings[1]) / 2))
