"""Laws as a user writes them outside the package, whose estimates are not the plant's parameters one by one.

``HighOrder`` has a second layer behind its estimates, ``Predicting`` a predictor that starts where the plant does, ``Weighing``
estimates the sixteen weights of a network, ``Sliding`` estimates nothing. All are for two states and one input. The file is not
imported under the package's name, because ``--controllers`` loads it directly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np


class TwoLayers(NamedTuple):
    theta_hat: np.ndarray
    ahead: np.ndarray


@dataclass(frozen=True, eq=False)
class HighOrderEquations:
    """theta_hat follows a second estimate, which is the gradient's."""

    law: HighOrder
    P_b: np.ndarray
    k_0: float

    def initial(self):
        return TwoLayers(np.zeros(2), np.zeros(2))

    def control(self, state, x, x_m, r):
        return self.k_0 * r - state.theta_hat @ x

    def derivative(self, state, x, x_m, r, u):
        normal = 1 + self.law.mu * (x @ x)
        behind = self.law.beta * (state.ahead - state.theta_hat) * normal
        return TwoLayers(behind, self.law.gamma * ((x - x_m) @ self.P_b) * x)

    def limit(self, state):
        return state


@dataclass(frozen=True)
class HighOrder:
    gamma: float
    beta: float = 20.0
    mu: float = 0.1
    name: str = "high order"

    def bind(self, known):
        return HighOrderEquations(self, known.P @ known.b, known.k_0)


class WithPredictor(NamedTuple):
    theta_hat: np.ndarray
    x_hat: np.ndarray


@dataclass(frozen=True, eq=False)
class PredictingEquations:
    """The tracking error and a predictor's error drive the estimates. The initial state consists only of floats."""

    gamma: float
    known: Any
    P_b: np.ndarray

    def initial(self):
        return WithPredictor(np.zeros(2), np.array([float(value) for value in self.known.x0]))

    def control(self, state, x, x_m, r):
        return self.known.k_0 * r - state.theta_hat @ x

    def derivative(self, state, x, x_m, r, u):
        ahead = state.x_hat - x
        rate = self.known.A_m @ x + self.known.b * (state.theta_hat @ x + u) - 10.0 * ahead
        return WithPredictor(self.gamma * ((x - x_m - ahead) @ self.P_b) * x, rate)

    def limit(self, state):
        return state


@dataclass(frozen=True)
class Predicting:
    gamma: float
    name: str = "predicting"

    def bind(self, known):
        return PredictingEquations(self.gamma, known, known.P @ known.b)


class Weights(NamedTuple):
    theta_hat: np.ndarray


@dataclass(frozen=True, eq=False)
class WeighingEquations:
    """Gaussians on a grid of four by four. ``box`` is the known set of theta, which says nothing about the weights."""

    gamma: float
    centres: np.ndarray
    P_b: np.ndarray
    k_0: float
    estimate_set: Any

    def initial(self):
        return Weights(np.zeros(len(self.centres)))

    def basis(self, x):
        away = (x[0] - self.centres[:, 0]) ** 2 + (x[1] - self.centres[:, 1]) ** 2
        return np.exp(-away / 18)

    def control(self, state, x, x_m, r):
        return self.k_0 * r - state.theta_hat @ self.basis(x)

    def derivative(self, state, x, x_m, r, u):
        return Weights(self.gamma * (((x - x_m) @ self.P_b) * self.basis(x) - 0.01 * state.theta_hat))

    def limit(self, state):
        return state


@dataclass(frozen=True)
class Weighing:
    gamma: float
    name: str = "weighing"

    def bind(self, known):
        grid = np.linspace(-6.0, 6.0, 4)
        centres = np.array([[one, two] for one in grid for two in grid])
        return WeighingEquations(self.gamma, centres, known.P @ known.b, known.k_0, known.estimate_set)


class Twisted(NamedTuple):
    theta_hat: np.ndarray
    v: np.ndarray
    alpha: np.ndarray


@dataclass(frozen=True, eq=False)
class SlidingEquations:
    """A smoothed twisting term with an adaptive gain. No parameter is estimated."""

    w: float
    k_0: float

    def initial(self):
        return Twisted(np.zeros(0), np.zeros(1), np.array([0.5]))

    def control(self, state, x, x_m, r):
        s = np.sum(x - x_m)
        return self.k_0 * r - state.alpha[0] * s / np.sqrt(np.abs(s) + 0.01) + state.v[0]

    def derivative(self, state, x, x_m, r, u):
        s = np.sum(x - x_m)
        return Twisted(np.zeros(0), np.stack([-2 * state.alpha[0] * np.tanh(10 * s)]), np.stack([self.w * s * s]))

    def limit(self, state):
        return state


@dataclass(frozen=True)
class Sliding:
    w: float
    name: str = "sliding"

    def bind(self, known):
        return SlidingEquations(self.w, known.k_0)


CONTROLLERS = [HighOrder(20.0), Predicting(10.0), Weighing(50.0), Sliding(5.0)]
