"""A controller that slides along a jump of its equations: the steps of a tolerance don't advance it."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np


class State(NamedTuple):
    theta_hat: Any


@dataclass(frozen=True, eq=False)
class Equations:
    known: Any
    relay: float
    share: float

    def initial(self) -> State:
        return State(np.zeros(2))

    def control(self, state, x, x_m, r):
        s = self.known.b @ self.known.P @ (x - x_m)
        return self.known.k_0 * r - self.share * np.array([4.0, -3.0]) @ x - np.where(s > 0.0, self.relay, -self.relay)

    def derivative(self, state, x, x_m, r, u) -> State:
        return State(0.0 * state.theta_hat)

    def limit(self, state: State) -> State:
        return state


@dataclass(frozen=True, eq=False)
class Relay:
    """Feedback that cancels a fraction of theta, with a relay of the error: with one, s = b'P e reaches 0 and stays there."""

    relay: float
    share: float = 1.0
    name: str = "relay"

    def bind(self, known) -> Equations:
        return Equations(known, self.relay, self.share)
