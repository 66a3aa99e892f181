"""The laws of the example with Lyapunov functions of their own, an MRAC with deliberate faults, and random problems for them."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from importlib import util
from pathlib import Path
from typing import NamedTuple

import numpy as np

from barbalat import ParameterBox, Plant, Problem, ReferenceModel
from barbalat.interfaces import Lyapunov
from barbalat.signals import Sine, Square

EXAMPLES = Path(__file__).parents[3] / "examples" / "laws_with_lyapunov.py"
spec = util.spec_from_file_location("laws_with_lyapunov", EXAMPLES)
laws = sys.modules["laws_with_lyapunov"] = util.module_from_spec(spec)
spec.loader.exec_module(laws)


def a_problem(rng, n=2, *, projected=True, size=1.0, x0=True):
    A_m = rng.normal(size=(n, n))
    A_m -= (np.linalg.eigvals(A_m).real.max() + rng.uniform(0.7, 2)) * np.eye(n)
    theta = rng.uniform(-size, size, n)
    plant = Plant(A_m=A_m, b=rng.normal(size=n), theta=theta, x0=rng.normal(size=n) * x0)
    known = ParameterBox(lower=-size * np.ones(n), upper=size * np.ones(n)) if projected else None
    command = Square(amplitude=2.0, frequency=1.5) if rng.random() < 0.5 else Sine(amplitude=2.0, frequency=rng.uniform(0.5, 3))
    return Problem(plant=plant, reference_model=ReferenceModel(k_0=1.0), reference=command, uncertainty=known)


class State(NamedTuple):
    theta_hat: np.ndarray


@dataclass(frozen=True, eq=False)
class Equations:
    law: object
    known: object

    def initial(self):
        return State(np.zeros(self.known.parameters))

    def control(self, state, x, x_m, r):
        return self.known.k_0 * r - state.theta_hat @ self.known.matched.phi(x if self.law.regressor == "x" else x_m)

    def derivative(self, state, x, x_m, r, u):
        phi = self.known.matched.phi(x if self.law.regressor == "x" else x_m)
        weights = np.arange(1, self.known.parameters + 1) if self.law.diagonal else 1.0
        rate = (
            self.law.sign * self.law.gamma / weights * phi * ((x - x_m) @ self.known.P @ self.known.b)
            - self.law.sigma * state.theta_hat
        )
        if self.law.projects:
            rate = self.known.estimate_set.project(rate, state.theta_hat)
        return State(rate)

    def limit(self, state):
        return state if not self.law.projects else State(self.known.estimate_set.limit(state.theta_hat))

    def lyapunov(self, state, x, x_m, theta):
        e, off = x - x_m, state.theta_hat - theta
        weights = np.arange(1, len(off) + 1) if self.law.diagonal else np.ones(len(off))
        share = self.law.share
        return Lyapunov(V=e @ self.known.P @ e + (off * weights) @ off / self.law.gamma * share, W=self.law.claimed * (e @ e))


@dataclass(frozen=True)
class Own:
    """MRAC with a deliberate fault. With ``regressor`` "x_m" it is the desired compensation law of Sadegh and Horowitz (1990)."""

    gamma: float = 4.0
    sign: float = 1.0
    sigma: float = 0.0
    claimed: float = 1.0
    share: float = 1.0
    regressor: str = "x"
    projects: bool = False
    diagonal: bool = False
    name: str = "own"

    def bind(self, known):
        return Equations(self, known)
