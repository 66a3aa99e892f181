"""Controllers as a user writes them outside the package: a correct one, and faulty ones named by their fault."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np


@dataclass(frozen=True)
class Plain:
    """u = -theta_hat'x + k_0 r with theta_hat' = gamma x (e'P b), by hand and without the package's settings."""

    gamma: float
    name: str = "plain"

    def bind(self, known):
        return PlainEquations(self.gamma, known.P @ known.b, known.k_0, known.n)


class PlainState(NamedTuple):
    theta_hat: np.ndarray


@dataclass(frozen=True, eq=False)
class PlainEquations:
    gamma: float
    P_b: np.ndarray
    k_0: float
    n: int

    def initial(self):
        return PlainState(np.zeros(self.n))

    def control(self, state, x, x_m, r):
        return self.k_0 * r - state.theta_hat @ x

    def derivative(self, state, x, x_m, r, u):
        return state._replace(theta_hat=self.gamma * ((x - x_m) @ self.P_b) * x)

    def limit(self, state):
        return state


class Bare:
    """The law without dataclasses: attributes are set in __init__, and the equations are in the same object."""

    def __init__(self, gamma, name="bare"):
        self.gamma, self.name = gamma, name

    def bind(self, known):
        bound = Bare(self.gamma, self.name)
        bound.P_b, bound.k_0, bound.n = known.P @ known.b, known.k_0, known.n
        return bound

    initial, control = PlainEquations.initial, PlainEquations.control
    derivative, limit = PlainEquations.derivative, PlainEquations.limit


class Proportional:
    """A controller without estimates, u = k_0 r - K'x."""

    name = "proportional"

    def __init__(self, K):
        self.K = np.asarray(K, dtype=float)

    def bind(self, known):
        self.k_0 = known.k_0
        return self

    def initial(self):
        return PlainState(np.zeros(0))

    def control(self, state, x, x_m, r):
        return self.k_0 * r - self.K @ x

    def derivative(self, state, x, x_m, r, u):
        return state

    def limit(self, state):
        return state


def wrong(**equations):
    """A ``Plain`` with some equations replaced, each by a function of (self, *arguments)."""
    kind = type("WrongEquations", (PlainEquations,), equations)

    @dataclass(frozen=True)
    class Wrong(Plain):
        def bind(self, known):
            return kind(self.gamma, known.P @ known.b, known.k_0, known.n)

    return Wrong(2.0, "wrong")


class NoEstimate(NamedTuple):
    z: np.ndarray


class Listed(NamedTuple):
    theta_hat: list


def _filled(self, state, x, x_m, r, u):
    rates = np.zeros(2)
    for i in range(2):
        rates[i] = self.gamma * x[i]
    return PlainState(rates)


def _branching(self, state, x, x_m, r):
    if x[0] > 0:
        return self.k_0 * r
    return -state.theta_hat @ x


def _forgetful(self, state, x, x_m, r):
    _forgetful.calls += 1
    return _forgetful.calls * (self.k_0 * r)


_forgetful.calls = 0


def _leaving(self, s, x, x_m, r):
    raise SystemExit(4)


WRONG = {
    "math": (wrong(control=lambda self, s, x, x_m, r: math.tanh(x[0]) + r), "control", "math's"),
    "float": (wrong(control=lambda self, s, x, x_m, r: float(x[0]) + r), "control", "NaN"),
    "filled": (wrong(derivative=_filled), "derivative", "np.stack"),
    "if": (wrong(control=_branching), "control", "np.where"),
    "max": (wrong(control=lambda self, s, x, x_m, r: max(x[0], 0.0)), "control", "np.maximum"),
    "np.array": (wrong(derivative=lambda self, s, x, x_m, r, u: PlainState(np.array([x[0], r]))), "derivative", "np.stack"),
    "sort": (wrong(control=lambda self, s, x, x_m, r: np.sort(x)[0]), "control", "NumPy functions"),
    "0/0": (wrong(control=lambda self, s, x, x_m, r: (x[0] - x[0]) / (x_m[0] - x_m[0])), "control", "as 0/0 does"),
    "arctan2": (wrong(control=lambda self, s, x, x_m, r: np.arctan2(x[0], x[1])), "control", "uses atan2, for which there is no"),
    "sinh": (wrong(derivative=lambda self, s, x, x_m, r, u: PlainState(np.sinh(x))), "derivative", "uses sinh, for which"),
    "nan in it": (wrong(control=lambda self, s, x, x_m, r: x[0] + np.nan * r), "control", "gives nan on all numbers"),
    "infinite": (wrong(derivative=lambda self, s, x, x_m, r, u: PlainState(np.inf * x)), "derivative", "on all numbers"),
    "exit": (wrong(control=_leaving), "control", "SystemExit: 4"),
    "remembers": (wrong(control=_forgetful), "control", "keep any memory in the state"),
    "vector u": (wrong(control=lambda self, s, x, x_m, r: x * r), "control", "(2,)"),
    "None": (wrong(limit=lambda self, s: None), "limit", "None"),
    "other fields": (wrong(derivative=lambda self, s, x, x_m, r, u: NoEstimate(x)), "derivative", "with the fields theta_hat"),
    "list": (wrong(derivative=lambda self, s, x, x_m, r, u: Listed([x[0], x[1]])), "derivative", "a list"),
    "array": (wrong(derivative=lambda self, s, x, x_m, r, u: x), "derivative", "PlainState"),
    "size": (wrong(derivative=lambda self, s, x, x_m, r, u: PlainState(np.concatenate([x, x]))), "derivative", "(4,)"),
    "column": (wrong(derivative=lambda self, s, x, x_m, r, u: PlainState(x.reshape(2, 1))), "derivative", "(2, 1)"),
    "attribute": (wrong(control=lambda self, s, x, x_m, r: self.K @ x), "control", "no attribute 'K'"),
    "arguments": (wrong(control=lambda self, s, x: x[0]), "control", "TypeError"),
    "complex": (wrong(control=lambda self, s, x, x_m, r: 1j * r), "control", "a number"),
    "initial list": (wrong(initial=lambda self: Listed([0.0, 0.0])), "initial", "np.zeros"),
    "initial tuple": (wrong(initial=lambda self: (np.zeros(2),)), "initial", "NamedTuple"),
    "no theta_hat": (wrong(initial=lambda self: NoEstimate(np.zeros(2))), "initial", "theta_hat"),
    "nan": (wrong(initial=lambda self: PlainState(np.full(2, np.nan))), "initial", "finite"),
}
"""By fault: the controller, the equation that the message names, and a word of the remedy."""
