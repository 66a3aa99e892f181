"""Adapted feedback and feedforward gains, u = -k_x_hat'phi(x) + k_r_hat r, whose ideal values are theta/omega and k_0/omega."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from barbalat import validate
from barbalat.controllers.settings import Adaptive, check_common, initial_estimate, projection_set
from barbalat.problem.known_set import Gain, KnownSet, ParameterBox, gain, limit, project
from barbalat.problem.regressors import MatchedTerm
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Value
from barbalat.roles import Role
from barbalat.validate import Array, InputError


class GainSettings(Adaptive, Protocol):
    """Settings of a scheme that adapts both gains."""

    @property
    def gamma(self) -> float | Array: ...

    @property
    def gamma_r(self) -> float | None: ...

    @property
    def k_r0(self) -> float | Array | None: ...

    @property
    def projection(self) -> bool | None: ...


def check_gains(settings: GainSettings) -> None:
    """Check and store the settings as far as possible without the plant."""
    check_common(settings)
    object.__setattr__(settings, "gamma", gain.accept("gamma", settings.gamma))
    if settings.gamma_r is not None:
        validate.freeze(settings, gamma_r=validate.positive("gamma_r", settings.gamma_r))
    elif Gain(settings.gamma).dimensions:
        raise InputError(
            "gamma_r is missing: if gamma is a list or a matrix, give the adaptive gain of the feedforward as a number"
        )
    if settings.k_r0 is not None:
        matrix = validate.dimensions(settings.k_r0) == 2
        given = validate.array("k_r0", settings.k_r0, (None, None)) if matrix else validate.number("k_r0", settings.k_r0)
        object.__setattr__(settings, "k_r0", given)


def feedforward_gain(settings: GainSettings) -> float:
    """gamma_r, or gamma if it is not given."""
    return float(settings.gamma if settings.gamma_r is None else settings.gamma_r)


@dataclass(frozen=True, eq=False, kw_only=True)
class ControlGains:
    """Both gains for a plant: initial values, sets onto which the gains are projected, and the resulting control.

    With m inputs and q commands, k_x (p m,) and k_r (m q,) are stored row by row, and each input has its own omega.
    """

    matched: MatchedTerm
    gamma: Gain
    gamma_r: float
    theta_hat0: Array
    k_r0: Array
    k_0: Array
    estimate_set: KnownSet | None  # of k_x
    interval: ParameterBox | None  # of k_r

    @classmethod
    def of(cls, settings: GainSettings, known: Known) -> ControlGains:
        """Raise InputError if the settings don't fit the plant."""
        projection_set(settings.projection, known)  # rejects a value that is not a boolean, and a projection without a set
        regressor, gamma = known.matched.regressor, Gain(settings.gamma)
        gamma.require_size("gamma", regressor.size(known.n) * known.inputs)
        if known.inputs > 1 and gamma.is_matrix:
            raise InputError(
                "for several inputs gamma must be a number or a list, because V has an unknown factor for each input"
            )
        onto = settings.projection is None or settings.projection
        estimate_set, interval = sets_of_ideal_gains(known) if onto else (None, None)
        without = replace(known, estimate_set=estimate_set, matched=MatchedTerm(regressor, inputs=known.inputs))
        return cls(
            matched=without.matched,
            gamma=gamma,
            gamma_r=feedforward_gain(settings),
            theta_hat0=initial_estimate(settings.theta_hat0, estimate_set, without),
            k_r0=_initial_feedforward(settings.k_r0, known, interval),
            k_0=_feedforward(known),
            estimate_set=estimate_set,
            interval=interval,
        )

    @property
    def inputs(self) -> int:
        return self.matched.inputs

    def control(self, k_x_hat: Value, k_r_hat: Value, x: Value, r: Value) -> Value:
        if self.inputs == 1:
            return -self.matched.phi(x).T @ k_x_hat + k_r_hat[0] * r
        return -self.matched.phi(x).T @ k_x_hat + k_r_hat.reshape(self.inputs, -1) @ r.reshape(-1)

    def exciting(self, k_x_hat: Value, k_r_hat: Value, x: Value, u: Value) -> Value:
        """The exciting signals: phi(x) and, with several inputs, K_r'K_r r, which is r up to scaling of its directions."""
        if self.inputs == 1:
            return self.with_input(x, u)
        Phi, m = self.matched.phi(x), self.inputs
        of_r = k_r_hat.reshape(m, -1).T @ (u + Phi.T @ k_x_hat)
        return np.concatenate([Phi, np.outer(of_r, np.eye(m).reshape(-1)).reshape(of_r.shape[0] * m, m)])

    def with_input(self, x: Value, u: Value) -> Value:
        """phi(x) and u. If k_r_hat is not zero, they span the same space as phi(x) and r, which excite the gains."""
        return np.concatenate([self.matched.phi(x), u.reshape(1)])

    def ideal(self, theta: Array, omega: Array) -> Array:
        """k_x, by the matching condition omega k_x = theta."""
        return np.asarray(theta / np.tile(omega, len(theta) // self.inputs))

    def ideal_feedforward(self, omega: Array) -> Array:
        """k_r, by the matching condition omega k_r = k_0."""
        return np.asarray(self.k_0 / np.repeat(omega, len(self.k_0) // self.inputs))

    def rates(self, error: Value, of_x: Value, of_r: Value, k_x_hat: Value, k_r_hat: Value) -> tuple[Value, Value]:
        """proj(Gamma of_x error) and proj(-gamma_r error of_r'), row by row."""
        if self.inputs == 1:
            k_x_dot, k_r_dot = self.gamma.scaled(error, of_x), (-self.gamma_r * error * of_r).reshape(1)
        else:
            k_x_dot, k_r_dot = self.gamma.times(of_x @ error), (-self.gamma_r * np.outer(error, of_r)).reshape(-1)
        return project(k_x_dot, k_x_hat, self.estimate_set, self.gamma), project(k_r_dot, k_r_hat, self.interval)

    def limited(self, k_x_hat: Value, k_r_hat: Value) -> tuple[Value, Value]:
        return limit(k_x_hat, self.estimate_set), limit(k_r_hat, self.interval)


class GainEquations:
    """Equations that adapt both gains, for any law. Their state has the fields theta_hat and k_r_hat."""

    gains: ControlGains

    def control(self, state: Any, x: Value, x_m: Value, r: Value) -> Value:
        return self.gains.control(state.theta_hat, state.k_r_hat, x, r)

    def regressor_at(self, state: Any, x: Value, u: Value) -> Value:
        return self.gains.exciting(state.theta_hat, state.k_r_hat, x, u)

    @property
    def estimate_set(self) -> KnownSet | None:
        return self.gains.estimate_set

    @property
    def roles(self) -> dict[str, Role]:
        return {
            "theta_hat": Role.estimates(
                "k_x", true=self.gains.ideal, within=self.estimate_set, meaning="estimates of the feedback gains k_x"
            ),
            "k_r_hat": Role.estimates(
                "k_r",
                true=lambda _, omega: self.gains.ideal_feedforward(omega),
                within=self.gains.interval,
                meaning="estimates of the feedforward gains k_r",
            ),
        }


def _feedforward(known: Known) -> Array:
    """k_0, (m q,)."""
    return np.array(known.k_0, dtype=float).reshape(-1)


def _initial_feedforward(given: float | Array | None, known: Known, interval: ParameterBox | None) -> Array:
    k_0 = _feedforward(known)
    if given is None:
        return k_0 if interval is None or interval.contains(k_0) else np.asarray(interval.limit(k_0))
    if np.shape(given) != np.shape(known.k_0):
        shape = " x ".join(map(str, np.shape(known.k_0))) or "a number"
        raise InputError(f"k_r0 must have the shape of k_0, {shape}, got {validate.show(given)}")
    wanted = np.array(given, dtype=float).reshape(-1)
    if interval is None or interval.contains(wanted):
        return wanted
    raise InputError(
        f"k_r0 must lie {interval}, which is k_0 divided by the interval of the input gain, got {validate.show(given)}"
    )


def sets_of_ideal_gains(known: Known) -> tuple[KnownSet | None, ParameterBox | None]:
    """Sets that contain k_x = theta/omega and k_r = k_0/omega, if theta and omega are known; an unknown omega counts as 1."""
    theta, gains = known.theta_set, known.gains
    if gains is None:
        return theta, None
    k_0, m = _feedforward(known), known.inputs
    rows, columns = known.parameters // m - 1, len(k_0) // m
    of_x = ParameterBox(lower=np.tile(gains.lower, rows), upper=np.tile(gains.upper, rows))
    of_r = ParameterBox(lower=np.repeat(gains.lower, columns), upper=np.repeat(gains.upper, columns))
    return None if theta is None else theta.over(of_x), ParameterBox(lower=k_0, upper=k_0).over(of_r)
