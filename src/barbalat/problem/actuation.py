"""The path from the controller's output to the plant: converter, limits, actuator and delay. No controller knows it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from barbalat import validate
from barbalat.linear.systems import StateSpace, TransferFunction
from barbalat.problem.measurement import nearest_multiple
from barbalat.protocols import Value
from barbalat.settings import Settings
from barbalat.validate import Array, InputError, Vector


@dataclass(frozen=True, eq=False, kw_only=True)
class PlantInput(Settings):
    """The path of u to the plant. u is quantised, saturated and rate-limited, passes omega (1 + Delta_m(s)), and is then delayed.

    quantization    step of a converter's output [unit of u]: u becomes the nearest multiple
    saturation      (lower, upper) limits of u, with lower <= 0 <= upper; one of them may be 0
    rate_limit      largest |rate| [unit of u per s]; slower inputs pass unchanged, with a lag of less than one solver step if
                    steps are fixed
    actuator        G_a(s) = 1 + Delta_m(s), proper and stable: eq. (11)
    multiplicative  Delta_m(s) itself, proper and stable; with an actuator the two are in series
    gain            the effectiveness omega > 0; 1 by default
    delay           exact delay [s]; 0 by default. With fixed steps a delay must be at least one solver step
    history         the constant value that reaches the plant until t = delay, 0 by default. Without a delay it has no effect

    The dynamics start at rest. A delay commutes with all other time-invariant parts of the path. Raises InputError.
    """

    quantization: float | None = None
    saturation: Vector | None = None
    rate_limit: float | None = None
    actuator: TransferFunction | None = None
    multiplicative: TransferFunction | None = None
    gain: float = 1.0
    delay: float = 0.0
    history: float = 0.0

    def __post_init__(self) -> None:
        for name in ("quantization", "rate_limit"):
            if getattr(self, name) is not None:
                validate.freeze(self, **{name: validate.positive(f"plant.input.{name}", getattr(self, name))})
        if self.saturation is not None:
            low, high = limits = validate.vector("plant.input.saturation", self.saturation, 2)
            if not (low <= 0 <= high and low < high):
                raise InputError.of(
                    "plant.input.saturation", f"must be [lower, upper] with lower <= 0 <= upper, got {validate.show(limits)}"
                )
            validate.freeze(self, saturation=limits)
        parts = {"actuator": self.actuator, "multiplicative": self.multiplicative}
        for name, part in parts.items():
            if part is None:
                continue
            system = TransferFunction.accept(f"plant.input.{name}", part)
            if system.relative_degree < 0 or not system.is_stable:
                raise InputError.of(
                    f"plant.input.{name}",
                    f"must be proper and stable, got num = {validate.show(system.num)}, den = {validate.show(system.den)}",
                )
            validate.freeze(self, **{name: system})
        validate.freeze(self, gain=validate.positive("plant.input.gain", self.gain))
        validate.freeze(self, delay=validate.not_negative("plant.input.delay", self.delay))
        validate.freeze(self, history=validate.number("plant.input.history", self.history))

    @cached_property
    def dynamics(self) -> TransferFunction | None:
        """The linear part without the delay, omega (1 + Delta_m(s)); ``None`` if that is 1."""
        total: TransferFunction | None = self.actuator
        if self.multiplicative is not None:
            one_plus = TransferFunction(np.polyadd(self.multiplicative.den, self.multiplicative.num), self.multiplicative.den)
            total = one_plus if total is None else total * one_plus
        if self.gain == 1:
            return total
        return TransferFunction([self.gain], [1.0]) * (total or TransferFunction([1.0], [1.0]))

    @property
    def is_linear(self) -> bool:
        """Whether nothing is quantised, saturated or rate-limited."""
        return self.quantization is None and self.saturation is None and self.rate_limit is None

    @cached_property
    def path(self) -> InputPath | None:
        """The equations of the path without the delay; ``None`` if u reaches the plant unchanged."""
        if self.dynamics is None and self.is_linear:
            return None
        return self._path_through(self.dynamics)

    @cached_property
    def path_of_unknown_gain(self) -> InputPath:
        """The path's equations, which contain the gain even if it is 1, so plants with any gain have the same structure."""
        return self._path_through(self.dynamics or TransferFunction([1.0], [1.0]))

    def _path_through(self, dynamics: TransferFunction | None) -> InputPath:
        return InputPath(self.quantization, self.saturation, self.rate_limit, None if dynamics is None else dynamics.realise())


class InputState(NamedTuple):
    """The state of the input path."""

    limited: Value  # (1,) output of the rate limiter, (0,) without one
    dynamics: Value  # (order of 1 + Delta_m,)


@dataclass(frozen=True, eq=False)
class InputPath:
    """The equations of a PlantInput without its delay.

    following  time [s] within which a rate limiter follows its demand as far as the limit allows. It is a solver's step, which
               may be a symbol, or infinity if other equations move the limiter's output. It is None before the step is known;
               then only paths without a rate limit have equations
    """

    quantum: float | None
    saturation: Array | None
    rate_limit: float | None
    dynamics: StateSpace | None
    following: Value = None

    @property
    def linear(self) -> InputPath | None:
        """The linear part of the path: its dynamics; None without dynamics."""
        return None if self.dynamics is None else InputPath(None, None, None, self.dynamics)

    def initial(self) -> InputState:
        return InputState(
            np.zeros(0 if self.rate_limit is None else 1), np.zeros(0 if self.dynamics is None else self.dynamics.order)
        )

    def asked(self, u: Value) -> Value:
        """Return u after the converter and the limits."""
        if self.quantum is not None:
            u = nearest_multiple(u, self.quantum)
        return u if self.saturation is None else np.clip(u, self.saturation[0], self.saturation[1])

    def derivative(self, state: InputState, u: Value) -> InputState:
        """Return the derivative of the state."""
        asked = self.asked(u)
        limited, dynamics = state
        if self.rate_limit is not None:
            if self.following is None:
                raise ValueError("a rate limiter has no equations before the solver's step is known")
            if isinstance(self.following, float) and self.following == np.inf:
                limited = 0 * state.limited
            else:
                limited = np.clip((asked - state.limited) / self.following, -self.rate_limit, self.rate_limit)
            asked = state.limited[0]
        if self.dynamics is not None:
            dynamics = self.dynamics.derivative(state.dynamics, asked)
        return InputState(limited, dynamics)

    def output(self, state: InputState, u: Value) -> Value:
        """Return the output of the path, a scalar."""
        passed = self.asked(u) if self.rate_limit is None else state.limited[0]
        return passed if self.dynamics is None else self.dynamics.output(state.dynamics, passed)
