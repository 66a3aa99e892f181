"""Commands that no tuning saw: the case's own, larger or smaller, faster or slower."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from barbalat.problem.state_feedback import Problem
from barbalat.protocols import BreakingSignal, Signal
from barbalat.validate import Array

AMPLITUDE_FACTORS = (0.5, 1.5)
"""Of the case's command: what a tuning on one size of it says of others is what a neutral comparison must ask."""
PACE_FACTORS = (0.5, 2.0)
"""Of the case's command, an octave to either side."""


@dataclass(frozen=True)
class Paced:
    """size times the signal, ``pace`` times as fast."""

    signal: Signal
    size: float
    pace: float

    def __call__(self, t: Array) -> Array:
        return self.size * self.signal(self.pace * np.asarray(t))

    def before(self, t: Array) -> Array:
        return self.size * self.signal.before(self.pace * np.asarray(t))

    def breaks(self, start: float, stop: float) -> Array:
        if not isinstance(self.signal, BreakingSignal):
            return np.zeros(0)
        return np.asarray(self.signal.breaks(self.pace * start, self.pace * stop) / self.pace)


def with_command(problem: Problem, size: float, pace: float) -> Problem:
    """The problem with each of its commands changed; a disturbance stays what it is."""
    commands = tuple(Paced(command, size, pace) for command in problem.commands)
    return replace(problem, reference=commands if isinstance(problem.reference, tuple) else commands[0])


def drawn(count: int, seed: int) -> Array:
    """(count, 2) sizes and paces, a Latin hypercube over both: evenly in the size, in the logarithm of the pace."""
    from scipy.stats import qmc

    shares = qmc.LatinHypercube(2, rng=np.random.default_rng(seed)).random(count)
    sizes = AMPLITUDE_FACTORS[0] + (AMPLITUDE_FACTORS[1] - AMPLITUDE_FACTORS[0]) * shares[:, 0]
    return np.column_stack([sizes, PACE_FACTORS[0] * (PACE_FACTORS[1] / PACE_FACTORS[0]) ** shares[:, 1]])
