"""
A law of your own
=================

Two small classes of plain NumPy run together with the built-in ones. This law adapts on the smoothed sign of the error's
direction.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from barbalat import Mrac, Simulation, load_case, simulate
from barbalat.results import plot


class State(NamedTuple):
    """What the law integrates."""

    theta_hat: np.ndarray


@dataclass(frozen=True)
class SmoothSign:
    """Settings, and with ``known`` the equations as well."""

    gamma: float
    name: str = "smooth sign"
    known: object = None

    def bind(self, known):
        return SmoothSign(self.gamma, self.name, known)

    def initial(self):
        return State(np.zeros(self.known.n))

    def control(self, state, x, x_m, r):
        return self.known.k_0 * r - state.theta_hat @ x

    def derivative(self, state, x, x_m, r, u):
        return State(self.gamma * np.tanh((x - x_m) @ self.known.P @ self.known.b) * x)

    def limit(self, state):
        return state


plot(simulate(load_case("paper").problem, [Mrac(gamma=1), SmoothSign(gamma=1.0)], Simulation(t_end=60, dt=1e-3)))
