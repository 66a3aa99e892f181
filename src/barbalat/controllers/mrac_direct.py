"""Direct MRAC, which adapts its feedforward too: of the input's gain only the sign is known, and it is never divided by."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, replace
from typing import NamedTuple

import numpy as np

from barbalat import validate
from barbalat.controllers.settings import check_common, initial_estimate, projection_box
from barbalat.problem.known_set import Gain, KnownSet, ParameterBox, gain, limit, project
from barbalat.problem.regressors import Uncertainty
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Value
from barbalat.validate import Array, InputError, Vector


class State(NamedTuple):
    """What the controller integrates."""

    theta_hat: Value  # (p,) the feedback's gains, estimate of k_x = theta/omega
    k_r_hat: Value  # (1,) the feedforward's, of k_r = k_0/omega


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations:
    """The Lyapunov law of both gains, driven by the tracking error; omega > 0 of b omega u stands nowhere."""

    b: Array
    P: Array
    uncertainty: Uncertainty
    gamma: Gain
    gamma_r: float
    theta_hat0: Array
    k_r0: float
    box: KnownSet | None  # of k_x
    interval: ParameterBox | None  # of k_r

    def initial(self) -> State:
        return State(self.theta_hat0, np.array([self.k_r0]))

    def control(self, state: State, x: Value, x_m: Value, r: Value) -> Value:
        return -self.uncertainty.phi(x).T @ state.theta_hat + state.k_r_hat[0] * r

    def regressor_at(self, state: State, x: Value, u: Value) -> Value:
        """phi(x) and u: as long as k_r_hat is not zero they span what phi(x) and r do."""
        return np.concatenate([self.uncertainty.phi(x), u.reshape(1)])

    def reported(self, state: State) -> dict[str, Value]:
        return {"k_r_hat": state.k_r_hat}

    def ideal_gains(self, theta: Array, omega: Array) -> Array:
        """k_x, by the matching condition omega k_x = theta."""
        return np.asarray(theta / omega)

    def derivative(self, state: State, x: Value, x_m: Value, r: Value, u: Value) -> State:
        e_P_b = (x - x_m) @ (self.P @ self.b)
        k_x_dot = self.gamma.scaled(e_P_b, self.uncertainty.phi(x))
        k_r_dot = (-self.gamma_r * e_P_b * r).reshape(1)
        return State(project(k_x_dot, state.theta_hat, self.box, self.gamma), project(k_r_dot, state.k_r_hat, self.interval))

    def limit(self, state: State) -> State:
        return State(limit(state.theta_hat, self.box), limit(state.k_r_hat, self.interval))


@dataclass(frozen=True, eq=False)
class DirectMrac:
    """u = -k_x_hat'phi(x) + k_r_hat r, k_x_hat' = proj(Gamma (e'P b) phi(x)), k_r_hat' = proj(-gamma_r (e'P b) r).

    The plant's input may have any effectiveness omega > 0: its sign is that of b, and nothing more need be known of it. The
    estimates are of k_x = theta/omega, reported as theta_hat, and k_r = k_0/omega, reported as k_r_hat.

    gamma       adaptive gain Gamma > 0 of the feedback: a number, a diagonal (p,) or an s.p.d. matrix (p, p)
    gamma_r     of the feedforward, > 0; by default gamma, where that is a number
    theta_hat0  k_x_hat(0), (p,), zero by default; inside the known set
    k_r0        k_r_hat(0), by default k_0, or the nearest that an interval of the input's gain allows
    projection  onto what the known set, divided by the input's gain, leaves possible; by default on where one is given

    Source: Ioannou and Sun, Robust Adaptive Control, section 6.2; Lavretsky and Wise, Robust and Adaptive Control, section 9.2;
    for first order Astrom and Wittenmark, Adaptive Control, example 5.7.
    """

    gamma: float | Array
    _: KW_ONLY
    gamma_r: float | None = None
    theta_hat0: Vector | None = None
    k_r0: float | None = None
    projection: bool | None = None
    name: str = "Direct MRAC"

    def __post_init__(self) -> None:
        check_common(self)
        object.__setattr__(self, "gamma", gain.accept("gamma", self.gamma))
        if self.gamma_r is not None:
            validate.freeze(self, gamma_r=validate.positive("gamma_r", self.gamma_r))
        elif Gain(self.gamma).dimensions:
            raise InputError("gamma_r is missing: give the feedforward's gain, a number, where gamma is a list or a matrix")
        if self.k_r0 is not None:
            validate.freeze(self, k_r0=validate.number("k_r0", self.k_r0))

    @property
    def feedforward_gain(self) -> float:
        """gamma_r, or gamma in its place."""
        return float(self.gamma if self.gamma_r is None else self.gamma_r)

    def bind(self, known: Known) -> Equations:
        if known.inputs > 1 or np.ndim(known.k_0):
            raise InputError(
                f"mrac-direct takes plants with one input and one command, got {known.inputs} inputs; mrac takes several"
            )
        projection_box(self.projection, known)  # refuses what is no switch, and a projection onto nothing
        regressor, gamma = known.uncertainty.regressor, Gain(self.gamma)
        gamma.require_size("gamma", regressor.size(known.n))
        onto = self.projection is None or self.projection
        box, interval = ideal_gains(known) if onto else (None, None)
        single = replace(known, box=box, uncertainty=Uncertainty(regressor, inputs=1))
        return Equations(
            b=known.b,
            P=known.P,
            uncertainty=single.uncertainty,
            gamma=gamma,
            gamma_r=self.feedforward_gain,
            theta_hat0=initial_estimate(self.theta_hat0, box, single),
            k_r0=self._initial_feedforward(float(known.k_0), interval),
            box=box,
            interval=interval,
        )

    def _initial_feedforward(self, k_0: float, interval: ParameterBox | None) -> float:
        given = k_0 if self.k_r0 is None else self.k_r0
        if interval is None or interval.contains(np.array([given])):
            return given
        if self.k_r0 is None:
            return float(interval.limit(np.array([k_0]))[0])
        raise InputError(f"k_r0 must lie {interval}, which is k_0 over the interval of the input's gain, got {given:g}")


def ideal_gains(known: Known) -> tuple[KnownSet | None, ParameterBox | None]:
    """Sets that hold k_x = theta/omega and k_r = k_0/omega, as far as theta and omega are known; else omega counts as 1."""
    theta, gains = known.theta_set, known.gains
    if gains is None:
        return theta, None
    k_0 = np.array([float(known.k_0)])
    return None if theta is None else theta.over(gains), ParameterBox(lower=k_0, upper=k_0).over(gains)
