"""Three user-defined laws that declare their state by roles: one with sixteen weights, one with two adaptive layers, and one
without an estimate.

None has a field ``theta_hat``. All are for two states and one input. The file is not imported under the package's name, because
``--controllers`` loads it directly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from barbalat.interfaces import Role, TuningGrid


class Weights(NamedTuple):
    W_hat: np.ndarray
    low: np.ndarray


@dataclass(frozen=True, eq=False)
class WeighingEquations:
    """Sixteen Gaussians on a grid. The error is filtered before the law learns from it."""

    gamma: float
    centres: np.ndarray
    P_b: np.ndarray
    k_0: float

    roles = {"W_hat": Role.estimates("W", meaning="weights of the network"), "low": Role.filter("filtered error")}

    def initial(self):
        return Weights(np.zeros(len(self.centres)), np.zeros(1))

    def basis(self, x):
        away = (x[0] - self.centres[:, 0]) ** 2 + (x[1] - self.centres[:, 1]) ** 2
        return np.exp(-away / 18)

    def control(self, state, x, x_m, r):
        return self.k_0 * r - state.W_hat @ self.basis(x)

    def derivative(self, state, x, x_m, r, u):
        error = (x - x_m) @ self.P_b
        learnt = self.gamma * (state.low[0] * self.basis(x) - 0.01 * state.W_hat)
        return Weights(learnt, np.stack([20 * (error - state.low[0])]))

    def limit(self, state):
        return state


@dataclass(frozen=True)
class Sixteen:
    """A law with sixteen weights."""

    gamma: float = 20.0
    name: str = "sixteen"

    def bind(self, known):
        grid = np.linspace(-6.0, 6.0, 4)
        centres = np.array([[one, two] for one in grid for two in grid])
        return WeighingEquations(self.gamma, centres, known.P @ known.b, known.k_0)

    def knobs(self, reach):
        return TuningGrid(
            scheme="Sixteen", values={"gamma": np.array([1.0, 10.0])}, make=lambda gamma: replace(self, gamma=gamma)
        )


class Layers(NamedTuple):
    k_hat: np.ndarray
    ahead: np.ndarray
    covariance: np.ndarray
    x_hat: np.ndarray


@dataclass(frozen=True, eq=False)
class LayeredEquations:
    """The gains in the control follow a second layer, whose gain is a matrix P(t). A predictor drives the second layer."""

    beta: float
    A_m: np.ndarray
    b: np.ndarray
    P_b: np.ndarray
    k_0: float
    x0: np.ndarray

    @property
    def roles(self):
        return {
            "k_hat": Role.estimates("k", true=lambda theta, omega: theta),
            "ahead": Role.estimates("h", true=lambda theta, omega: theta),
            "covariance": Role.memory("covariance of the second layer", symbol="P"),
        }

    def initial(self):
        return Layers(np.zeros(2), np.zeros(2), 10.0 * np.eye(2), np.array([float(value) for value in self.x0]))

    def control(self, state, x, x_m, r):
        return self.k_0 * r - state.k_hat @ x

    def derivative(self, state, x, x_m, r, u):
        P_x = state.covariance @ x
        normal = 1 + x @ x
        ahead = P_x * ((x - state.x_hat) @ self.P_b)
        x_hat = self.A_m @ x + self.b * (state.ahead @ x + u) + 5.0 * (x - state.x_hat)
        return Layers(self.beta * (state.ahead - state.k_hat), ahead, -np.outer(P_x, P_x) / normal, x_hat)

    def limit(self, state):
        return state


@dataclass(frozen=True)
class TwoLayers:
    """A law with a second adaptive layer."""

    beta: float = 20.0
    name: str = "two layers"

    def bind(self, known):
        return LayeredEquations(self.beta, known.A_m, known.b, known.P @ known.b, known.k_0, known.x0)

    def knobs(self, reach):
        return TuningGrid(scheme="TwoLayers", values={"beta": np.array([5.0, 20.0])}, make=lambda beta: replace(self, beta=beta))


class Lead(NamedTuple):
    z: np.ndarray


@dataclass(frozen=True, eq=False)
class LeadEquations:
    """A lead on the error, without estimates."""

    k: float
    k_0: float
    row: np.ndarray

    roles = {}

    def initial(self):
        return Lead(np.zeros(1))

    def control(self, state, x, x_m, r):
        return self.k_0 * r - self.k * ((x - x_m) @ self.row - state.z[0])

    def derivative(self, state, x, x_m, r, u):
        return Lead(np.stack([5.0 * ((x - x_m) @ self.row - state.z[0])]))

    def limit(self, state):
        return state


@dataclass(frozen=True)
class NoEstimate:
    """A controller without any estimate."""

    k: float = 2.0
    name: str = "no estimate"

    def bind(self, known):
        return LeadEquations(self.k, known.k_0, known.P @ known.b)

    def knobs(self, reach):
        return TuningGrid(scheme="NoEstimate", values={"k": np.array([1.0, 4.0])}, make=lambda k: replace(self, k=k))


CONTROLLERS = [Sixteen(), TwoLayers(), NoEstimate()]
