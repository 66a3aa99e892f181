"""Sampled controllers whose steps are dissipative in x_tilde and theta_hat: implicit steps in closed form, O(n^2) per sample.

docs/sampled.md states and proves the guarantees. Measurements are taken at the middle of the sample, x_mid = (x + x_next)/2,
and estimates at its end.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from barbalat.linear.systems import StateSpace
from barbalat.protocols import Equations, Sample, Value
from barbalat.validate import Array


def half_step(A: Array, T: float) -> Array:
    """(I - T/2 A)^-1, which exists for every T > 0 if A is Hurwitz."""
    return np.linalg.inv(np.eye(len(A)) - T / 2 * A)


@dataclass(frozen=True, eq=False)
class LinearStep:
    """x' = A x + forcing over one sample, with the forcing held at its midpoint value."""

    half: Array  # (I - T/2 A)^-1
    T: float

    @classmethod
    def of(cls, A: Array, T: float) -> LinearStep:
        return cls(half_step(A, T), T)

    def middle(self, state: Value, forcing: Value) -> Value:
        return self.half @ (state + self.T / 2 * forcing)

    def end(self, state: Value, forcing: Value) -> Value:
        return 2 * self.middle(state, forcing) - state


@dataclass(frozen=True, eq=False)
class Filter:
    """C(s) or Q(s) by the trapezoidal rule (Tustin), which is stable for every T and keeps the gain at DC."""

    system: StateSpace
    step: LinearStep

    @classmethod
    def of(cls, system: StateSpace, T: float) -> Filter:
        return cls(system, LinearStep.of(system.A, T))

    def end(self, state: Value, before: Value, now: Value) -> Value:
        middle = (before + now) / 2
        return self.step.end(state, self.system.B * middle if state.ndim == 1 else np.outer(self.system.B, middle))


class Unmoved(NamedTuple):
    """The values at the end of the sample if the estimates were zero or did not change."""

    x_hat: Value  # (n,) predictor with zero estimates
    error: Value  # x_tilde'P b with the present estimates; (m,) with m inputs
    phi: Value  # regressor in the middle


class SampledForm:
    """A sampled form with the initial state and the control of its continuous equations."""

    continuous: Equations

    def initial(self) -> Any:
        return self.continuous.initial()

    def control(self, state: Any, x: Value, x_m: Value, r: Value) -> Value:
        return self.continuous.control(state, x, x_m, r)


@dataclass(frozen=True, eq=False)
class Still(SampledForm):
    """A controller without a changing state."""

    continuous: Equations
    sample_time: float

    explicit: ClassVar[bool] = False

    def advance(self, state: Any, before: Sample, u: Value, now: Sample) -> Any:
        return state


@dataclass(frozen=True, eq=False)
class Tustin(SampledForm):
    """A linear controller that acts on the output or on the state. Its NamedTuple contains the state of its linear system."""

    continuous: Equations
    sample_time: float
    step: LinearStep

    explicit: ClassVar[bool] = False

    def advance(self, state: Any, before: Sample, u: Value, now: Sample) -> Any:
        rest = type(state)(np.zeros(state[0].shape))  # at the origin, the derivative is just the forcing
        forcings = [self.continuous.derivative(rest, *sample, u)[0] for sample in (before, now)]
        return type(state)(self.step.end(state[0], (forcings[0] + forcings[1]) / 2))
